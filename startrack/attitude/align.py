"""Attitudes from many sets of matched unit vectors, to rounding error."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.attitude.linear import best_rotation, invert, largest_eigenvalue, least_squares
from startrack.core import Floats, Ints, Refused, kernel, rotated, turn_by

EPS = 2.0**-52
MOST_STEPS = 100  # two or three suffice, except for stars that contradict each other
LARGEST_CONDITION = (100 * EPS) ** -2  # beyond it, directions differ only by their rounding
# Curvature of the loss over the curvature without residuals. Chosen by hand: a larger limit reports
# more sets as contradictory, a smaller one accepts nearly flat minima.
SMALLEST_CURVATURE = 1e-6


class Observability(IntEnum):
    """Whether a set of stars determines an attitude."""

    OBSERVED = 0
    ONE_DIRECTION = 1  # or two opposite directions, or none: the rotation about it is unobservable
    CONTRADICTORY = 2  # the residuals are so large that other attitudes fit as well


@core.printed
@dataclass(frozen=True, eq=False)
class Alignment:
    """Attitudes at the minimum of Wahba's loss.

    source_to_target  m rotations; if not observable, one of many solutions
    covariance        (m, 3, 3) radian^2, of the small rotation about the target's axes, if the
                      weights are inverse variances; infinite if not observable
    condition         (m,) 1, condition number of the information (inverse of the covariance)
    loss              (m,) 1, half the weighted squared residuals; its mean for n stars is n - 3/2
    observability     (m,) values of `Observability`
    """

    source_to_target: Rotation
    covariance: Annotated[Floats, core.Unit("rad2", "arcsec2")]
    condition: Floats
    loss: Floats
    observability: Ints


def align(observed: Floats, reference: Floats, weight: Floats) -> Alignment:
    """Minimise Wahba's loss, over the whole sphere.

        loss = 1/2 sum_i weight_i |observed_i - R reference_i|^2

    Source: Wahba (1965), SIAM Review 7, 409. The iteration starts from the singular value
    decomposition of the vectors' products. Products lose half of the digits; Gauss-Newton steps on
    the residuals restore these. A set that does not determine the attitude is reported by
    `observability`, not by an exception.

    observed   (m, n, 3) unit vectors in the target's axes
    reference  (m, n, 3) unit vectors in the source's axes
    weight     (m, n) inverse variances, 1 / radian^2; zero for missing vectors
    Returns    Alignment
    Raises     ValueError if shapes differ, a number is not finite, or a weight is negative.
    Accuracy   numerical: a few eps sqrt(condition), the error from rounding the vectors.
    """
    b, r, w = (np.ascontiguousarray(values, float) for values in (observed, reference, weight))
    if w.ndim != 2 or b.shape != r.shape or b.shape != (*w.shape, 3):
        raise Refused(
            "observed, reference and weight must have shapes (m, n, 3), (m, n, 3) and (m, n), "
            f"got {b.shape}, {r.shape} and {w.shape}"
        )
    wrong = ~(np.isfinite(w) & (w >= 0))
    if wrong.any():
        raise Refused(f"weight must be finite and not negative, got {w[wrong][0]}")
    if not (np.isfinite(b).all() and np.isfinite(r).all()):
        raise Refused("observed and reference must be finite, got NaN or infinity")
    many = len(w)
    matrix, covariance = np.empty((many, 3, 3)), np.empty((many, 3, 3))
    condition, loss, status = np.empty(many), np.empty(many), np.empty(many, np.int64)
    _align(b, r, w, matrix, covariance, condition, loss, status)
    return Alignment(core.rotation_of(matrix), covariance, condition, loss, status)


@kernel
def _align(b, r, weight, matrix, covariance, condition, loss, status):  # type: ignore[no-untyped-def]
    """Write the results of each set, one after the other."""
    count = weight.shape[1]
    columns = np.empty((4, 3 * count))
    products, triangle, inverse = np.empty((3, 3)), np.zeros((3, 3)), np.empty((3, 3))
    w, step, square = np.empty(count), np.empty(3), np.empty((3, 3))
    for k in range(len(weight)):
        largest = 0.0
        for i in range(count):
            largest = max(largest, weight[k, i])
        scale = largest if largest > 0 else 1.0
        for i in range(count):
            w[i] = weight[k, i] / scale
        a = matrix[k]
        _multiply(b[k], r[k], w, products)
        axis = best_rotation(products, a)
        _turn_about(axis, b[k], r[k], w, a)
        for _ in range(MOST_STEPS):
            _linearise(b[k], r[k], w, a, columns)
            least_squares(columns, triangle, step)
            invert(triangle, inverse)
            least = math.sqrt(
                _square(triangle) * _square(inverse)
            )  # of the condition's square root
            if not least < 1 / (100 * EPS):
                break
            turn_by(step, a)
            if math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2) < EPS * least:
                break
        _product(inverse, inverse, True, covariance[k])
        _product(triangle, triangle, False, square)
        condition[k] = largest_eigenvalue(square) * largest_eigenvalue(covariance[k])
        loss[k], curved = _loss(b[k], r[k], w, a, inverse)
        loss[k] *= largest
        if not condition[k] < LARGEST_CONDITION:
            status[k] = 1
        else:
            status[k] = 0 if curved else 2
        if status[k] != 0:
            condition[k] = np.inf
        for i in range(3):
            for j in range(3):
                covariance[k, i, j] = covariance[k, i, j] / largest if status[k] == 0 else np.inf


@kernel
def _multiply(b, r, w, products):  # type: ignore[no-untyped-def]
    """Write sum_i w_i b_i r_i^T."""
    for j in range(3):
        for k in range(3):
            products[j, k] = 0.0
            for i in range(len(w)):
                products[j, k] += w[i] * b[i, j] * r[i, k]


@kernel
def _square(matrix):  # type: ignore[no-untyped-def]
    total = 0.0
    for j in range(3):
        for k in range(3):
            total += matrix[j, k] ** 2
    return total


@kernel
def _product(left, right, rows, out):  # type: ignore[no-untyped-def]
    """Write the scalar products of the rows of two matrices (3, 3), or of their columns.

    `@` is not used: its last digit depends on the processor, and it takes a second to compile.
    """
    for i in range(3):
        for j in range(3):
            out[i, j] = 0.0
            for k in range(3):
                if rows:
                    out[i, j] += left[i, k] * right[j, k]
                else:
                    out[i, j] += left[k, i] * right[k, j]


@kernel
def _turn_about(axis, b, r, w, a):  # type: ignore[no-untyped-def]
    """Rotate a about the axis to the least loss, from the components across the axis.

    In a narrow field the products have lost these components, but the vectors still have them. It
    is enough to remove the component along the axis from one vector of each pair.
    """
    sine = cosine = 0.0
    for i in range(len(w)):
        px, py, pz = rotated(a, r[i])
        bx, by, bz = b[i]
        along = px * axis[0] + py * axis[1] + pz * axis[2]
        px, py, pz = px - along * axis[0], py - along * axis[1], pz - along * axis[2]
        cosine += w[i] * (px * bx + py * by + pz * bz)
        sine += w[i] * (
            axis[0] * (py * bz - pz * by)
            + axis[1] * (pz * bx - px * bz)
            + axis[2] * (px * by - py * bx)
        )
    angle = math.atan2(sine, cosine)
    turn = np.empty(3)
    for k in range(3):
        turn[k] = angle * axis[k]
    turn_by(turn, a)


@kernel
def _linearise(b, r, w, a, columns):  # type: ignore[no-untyped-def]
    """Write sqrt(w) d(p) / d(rotation) and sqrt(w) (b - p) with p = a r, three columns a star."""
    for i in range(len(w)):
        px, py, pz = rotated(a, r[i])
        root = math.sqrt(w[i])
        x, y, z = 3 * i, 3 * i + 1, 3 * i + 2
        columns[0, x], columns[1, x], columns[2, x] = 0.0, root * pz, -root * py
        columns[0, y], columns[1, y], columns[2, y] = -root * pz, 0.0, root * px
        columns[0, z], columns[1, z], columns[2, z] = root * py, -root * px, 0.0
        columns[3, x] = root * (b[i, 0] - px)
        columns[3, y] = root * (b[i, 1] - py)
        columns[3, z] = root * (b[i, 2] - pz)


@kernel
def _loss(b, r, w, a, inverse):  # type: ignore[no-untyped-def]
    """The loss, and whether it curves upwards in every direction.

    Its second derivative is the Gauss-Newton matrix, G = triangle^T triangle, plus a term of the
    residuals e. Both are expressed in the axes in which G is the unit matrix.

        H = G + sum_i w_i ((e_i . p_i) I - (e_i p_i^T + p_i e_i^T) / 2)
    """
    loss = 0.0
    h, half = np.zeros((3, 3)), np.empty((3, 3))
    p, e = np.empty(3), np.empty(3)
    for i in range(len(w)):
        p[0], p[1], p[2] = rotated(a, r[i])
        along = square = 0.0
        for j in range(3):
            e[j] = b[i, j] - p[j]
            square += e[j] ** 2
            along += e[j] * p[j]
        loss += w[i] * square / 2
        for j in range(3):
            h[j, j] += w[i] * along
            for k in range(3):
                h[j, k] -= w[i] * (e[j] * p[k] + e[k] * p[j]) / 2
    _product(inverse, h, False, half)
    for i in range(3):
        for j in range(3):
            h[i, j] = 1 - SMALLEST_CURVATURE if i == j else 0.0
            for k in range(3):
                h[i, j] += half[i, k] * inverse[k, j]
    # LAPACK's determinant fails at the infinities of unobservable sets.
    minor = h[0, 0] * h[1, 1] - h[0, 1] ** 2
    determinant = (
        h[2, 2] * minor
        - h[1, 2] * (h[0, 0] * h[1, 2] - h[0, 1] * h[0, 2])
        + h[0, 2] * (h[0, 1] * h[1, 2] - h[1, 1] * h[0, 2])
    )
    return loss, h[0, 0] > 0 and minor > 0 and determinant > 0
