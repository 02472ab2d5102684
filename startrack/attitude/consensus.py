"""The largest set of matched directions that one attitude explains."""

import math

import numpy as np

from startrack.attitude.linear import best_rotation
from startrack.core import Flags, Floats, axes_of_pair, kernel


def consensus(observed: Floats, reference: Floats, sigma: Floats, gate: float) -> Flags:
    """Find the largest set of stars that one attitude explains.

    Every pair of stars whose measured and catalogue distances agree gives an attitude (TRIAD: Black
    1964, AIAA J. 2(7), 1350). The stars within the gate of this attitude are fitted, and the stars
    within the gate of the fit are counted. The result is the set with the most stars; among sets of
    equal size, the one with the smallest residuals. All pairs are tried, so that the result depends
    neither on random draws nor on the order.

    observed   (n, 3) unit vectors in camera axes
    reference  (n, 3) unit vectors, ICRS axes
    sigma      (n,) radian, error of each direction per axis
    gate       sigma, residual beyond which a star does not agree
    Returns    (n,) which stars agree; none if no pair agrees
    Accuracy   numerical: rounding only. It takes n^3 / 2 steps: 0.1 ms for 30 stars.
    """
    chosen = np.zeros(len(sigma), np.bool_)
    stars = (np.ascontiguousarray(values, float) for values in (observed, reference, sigma))
    _search(*stars, float(gate), chosen)
    return chosen


@kernel
def _search(observed: Floats, reference: Floats, sigma: Floats, gate: float, chosen: Flags) -> None:
    count = len(sigma)
    trial, products = np.zeros(count, np.bool_), np.empty((3, 3))
    seen, reference_axes, attitude = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    best_count, least = 2, np.inf
    for i in range(count):
        for j in range(i + 1, count):
            near, far = _apart(observed, i, j), _apart(reference, i, j)
            spread = math.sqrt(sigma[i] ** 2 + sigma[j] ** 2)
            if abs(near - far) > gate * spread or far <= gate * spread:
                continue
            axes_of_pair(observed[i], observed[j], seen)
            axes_of_pair(reference[i], reference[j], reference_axes)
            for m in range(3):
                for n in range(3):
                    attitude[m, n] = 0.0
                    for axis in range(3):
                        attitude[m, n] += seen[axis, m] * reference_axes[axis, n]
            agree = 0
            for k in range(count):
                # Error of the pair's middle: spread / 2; of the rotation about it: spread / far.
                square = 0.0
                for m in range(3):
                    square += (reference[k, m] - (reference[i, m] + reference[j, m]) / 2) ** 2
                arm = math.sqrt(square) / far
                total = math.sqrt(sigma[k] ** 2 + spread**2 * (0.25 + arm**2))
                trial[k] = _distance(observed[k], attitude, reference[k]) <= gate * total
                agree += trial[k]
            if agree < best_count:
                continue
            # The gate of a close pair is wide. Therefore the attitude of all these stars is tested
            # again.
            products[:] = 0.0
            for k in range(count):
                if trial[k]:
                    for m in range(3):
                        for n in range(3):
                            products[m, n] += observed[k, m] * reference[k, n] / sigma[k] ** 2
            best_rotation(products, attitude)
            agree, squares = 0, 0.0
            for k in range(count):
                ratio = _distance(observed[k], attitude, reference[k]) / sigma[k]
                trial[k] = ratio <= gate
                if trial[k]:
                    agree += 1
                    squares += ratio**2
            if agree > best_count or (agree == best_count and squares < least):
                best_count, least = agree, squares
                for k in range(count):
                    chosen[k] = trial[k]


@kernel
def _apart(direction: Floats, i: int, j: int) -> float:
    square = 0.0
    for k in range(3):
        square += (direction[j, k] - direction[i, k]) ** 2
    return math.sqrt(square)


@kernel
def _distance(seen: Floats, attitude: Floats, star: Floats) -> float:
    square = 0.0
    for k in range(3):
        turned = attitude[k, 0] * star[0] + attitude[k, 1] * star[1] + attitude[k, 2] * star[2]
        square += (seen[k] - turned) ** 2
    return math.sqrt(square)
