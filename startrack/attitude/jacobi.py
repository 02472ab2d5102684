"""The best rotation of a 3 x 3 matrix of products, by one-sided Jacobi rotations."""

from __future__ import annotations

import math

import numpy as np

from startrack.core import kernel

EPS = 2.0**-52
MOST_SWEEPS = 12  # a limit: convergence is quadratic, so that a few are enough


@kernel
def best_rotation(b, rotation):  # type: ignore[no-untyped-def]
    """Write the rotation R of largest trace(R^T b), and return the direction of its largest part.

        b = U S V^T with falling S,   R = u1 v1^T + u2 v2^T + (u1 x u2) (v1 x v2)^T

    The cross products make both frames right-handed, and need no smallest singular value, which
    has no correct digits. Method: Golub and Van Loan (2013), Matrix Computations, 8.6.3.

    b         (3, 3); destroyed: its columns become U S
    rotation  (3, 3), written
    Returns   (3,) u1
    """
    v = np.zeros((3, 3))
    v[0, 0] = v[1, 1] = v[2, 2] = 1.0
    for _ in range(MOST_SWEEPS):
        turned = False
        for i, j in ((0, 1), (0, 2), (1, 2)):
            turned |= _make_orthogonal(b, v, i, j)
        if not turned:
            break
    length, first = np.empty(3), 0
    for j in range(3):
        length[j] = math.sqrt(b[0, j] ** 2 + b[1, j] ** 2 + b[2, j] ** 2)
        if length[j] > length[first]:
            first = j
    second = (first + 1) % 3
    if length[(first + 2) % 3] > length[second]:
        second = (first + 2) % 3
    u1, u2 = _frame(b[:, first], b[:, second])
    u3, v3 = _cross(u1, u2), _cross(v[:, first], v[:, second])
    for i in range(3):
        for j in range(3):
            rotation[i, j] = u1[i] * v[j, first] + u2[i] * v[j, second] + u3[i] * v3[j]
    return u1


@kernel
def _make_orthogonal(b, v, i, j):  # type: ignore[no-untyped-def]
    """Rotate columns i and j of b and of v so that those of b are orthogonal; whether needed."""
    ii = jj = ij = 0.0
    for k in range(3):
        ii += b[k, i] * b[k, i]
        jj += b[k, j] * b[k, j]
        ij += b[k, i] * b[k, j]
    if abs(ij) <= EPS * math.sqrt(ii * jj):
        return False
    zeta = (jj - ii) / (2 * ij)
    tangent = math.copysign(1.0, zeta) / (abs(zeta) + math.sqrt(1 + zeta * zeta))
    cosine = 1 / math.sqrt(1 + tangent * tangent)
    sine = cosine * tangent
    for m in (b, v):
        for k in range(3):
            one, other = m[k, i], m[k, j]
            m[k, i] = cosine * one - sine * other
            m[k, j] = sine * one + cosine * other
    return True


@kernel
def _frame(first, second):  # type: ignore[no-untyped-def]
    """Two orthogonal unit vectors: along the first, and as near as can be to the second."""
    size, least = math.sqrt(_dot(first, first)), 0
    u1, u2 = np.empty(3), np.empty(3)
    for k in range(3):
        u1[k] = first[k] / size if size > 0 else (1.0 if k == 0 else 0.0)
        if abs(u1[k]) < abs(u1[least]):
            least = k
    along = _dot(u1, second)
    for k in range(3):
        u2[k] = second[k] - u1[k] * along
    if math.sqrt(_dot(u2, u2)) <= EPS * size:
        for k in range(3):
            u2[k] = 1.0 if k == least else 0.0
    _normalise(u2)
    along = _dot(u1, u2)
    for k in range(3):
        u2[k] -= u1[k] * along  # again: a short or chosen vector is not orthogonal yet
    _normalise(u2)
    return u1, u2


@kernel
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _normalise(vector):  # type: ignore[no-untyped-def]
    """Make its length one."""
    length = math.sqrt(_dot(vector, vector))
    for k in range(3):
        vector[k] /= length


@kernel
def _cross(a, b):  # type: ignore[no-untyped-def]
    out = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k] = a[i] * b[j] - a[j] * b[i]
    return out
