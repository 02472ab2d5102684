"""Patterns of spots enter, brightest first; the first hypothesis beyond doubt leaves."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.code import place, separation, squared_chords
from startrack.identification.index import ACROSS, UPRIGHT, CodeTable, column, upright
from startrack.identification.sky import SkyGrid
from startrack.identification.verify import Seen, verify
from startrack.values import Floats

SIGMAS = 4.0  # how far noise may move a code


@lru_cache(maxsize=64)
def breadth_first(spots: int) -> NDArray[np.int64]:
    """All (k, 4) choices of four spots, those of small sums of ranks first.

    So no bright spot that is no star can hold up the search for long.
    """
    choices = np.array(list(combinations(range(spots), 4)), np.int64).reshape(-1, 4)
    order = np.lexsort((choices[:, 3], choices.sum(axis=1)))
    return choices[order]


@njit(cache=True, error_model="numpy")
def search(
    seen: Seen,
    choices: NDArray[np.int64],
    code_tolerance: float,
    table: CodeTable,
    sky: SkyGrid,
    magnitude: Floats,
    fewest: int,
    log_accepted: float,
    most_hypotheses: int,
) -> tuple[Floats, float, int, float, int]:  # pragma: no cover
    """Look up pattern after pattern until a hypothesis is beyond doubt.

    choices          (k, 4) spots, in the order to try
    code_tolerance   1, error of a code beyond the noise
    table, sky       the patterns of the index, and its stars that vote
    magnitude        (n,) of the latter
    fewest           as in `verify`
    log_accepted     ln of the bound on chance to stay below
    most_hypotheses  after so many the search ends
    Returns          icrs_to_camera, scale, matches, ln of the bound on chance, hypotheses tried;
                     no matches where nothing was found
    """
    tried = 0
    square = squared_chords(seen.direction[: choices.max() + 1])
    orders, codes = np.empty((24, 4), np.int64), np.empty((24, 4))
    for choice in choices:
        base, noise, off_axis = _measure(seen, square, choice)
        if not table.smallest * (1 - seen.focal) <= base <= table.largest * (1 + seen.focal):
            continue
        # A wrong focal length is no similarity away from the axis: there it stretches along
        # the radius otherwise than across it, by its error times tan^2.
        error = noise + code_tolerance + 2 * seen.focal * off_axis
        stretch = noise - math.log1p(-seen.focal) + 2 * seen.focal * off_axis
        for k in range(_orders(seen.direction, square, choice, error, orders, codes)):
            for p in _within(codes[k], error, table, sky.direction):
                four = table.base[table.pattern[p]]
                true = separation(sky.direction[four[0]], sky.direction[four[1]])
                if abs(math.log(base / true)) > stretch:
                    continue
                tried += 1
                rotation, scale, matches, log_p = verify(
                    seen, orders[k], sky, magnitude, four, fewest
                )
                if log_p < log_accepted:
                    return rotation, scale, matches, log_p, tried
                if tried >= most_hypotheses:
                    return np.eye(3), 1.0, 0, 0.0, tried
    return np.eye(3), 1.0, 0, 0.0, tried


@njit(cache=True, error_model="numpy")
def _measure(
    seen: Seen, square: Floats, choice: NDArray[np.int64]
) -> tuple[float, float, float]:  # pragma: no cover
    """Base (radian), noise of the code, and the largest tan^2 of the angle off the axis."""
    longest, sigma, off_axis = 0.0, 0.0, 0.0
    for i in range(4):
        for j in range(i):
            longest = max(longest, square[choice[i], choice[j]])
        sigma = max(sigma, seen.sigma[choice[i]])
        x, y = seen.plane[choice[i]]
        off_axis = max(off_axis, x * x + y * y)
    base = 2 * math.asin(min(math.sqrt(longest) / 2, 1.0))
    return base, SIGMAS * sigma / base, off_axis


@njit(cache=True, error_model="numpy")
def _orders(
    direction: Floats,
    square: Floats,
    choice: NDArray[np.int64],
    error: float,
    orders: NDArray[np.int64],
    codes: Floats,
) -> int:  # pragma: no cover
    """All ways to name four spots A, B, C, D that are canonical, or may be without the error.

    orders, codes  (24, 4) are filled with the spots and their codes
    Returns        how many there are: one, but where two rules are close to a tie
    """
    count = 0
    longest = 0.0
    for i in range(4):
        for j in range(i):
            longest = max(longest, square[choice[i], choice[j]])
    for i in range(4):
        for j in range(4):
            if i == j or square[choice[i], choice[j]] < longest * (1 - error) ** 2:
                continue
            a, b = choice[i], choice[j]
            k = 0
            while k == i or k == j:  # noqa: SIM109, compiled code compares faster
                k += 1
            c, d = choice[k], choice[6 - i - j - k]
            xc, yc = place(direction[a], direction[b], direction[c])
            xd, yd = place(direction[a], direction[b], direction[d])
            if xc + xd > 1 + 2 * error:
                continue
            if xc <= xd + 2 * error:
                orders[count] = a, b, c, d
                codes[count] = xc, yc, xd, yd
                count += 1
            if xd <= xc + 2 * error:
                orders[count] = a, b, d, c
                codes[count] = xd, yd, xc, yc
                count += 1
    return count


@njit(cache=True, error_model="numpy")
def _within(
    wanted: Floats, error: float, table: CodeTable, direction: Floats
) -> NDArray[np.int64]:  # pragma: no cover
    """Which patterns have a code within `error` of the one wanted."""
    found = np.empty(64, np.int64)
    count = 0
    for i in range(column(wanted[0] - error), column(wanted[0] + error) + 1):
        for j in range(upright(wanted[1] - error), upright(wanted[1] + error) + 1):
            for k in range(column(wanted[2] - error), column(wanted[2] + error) + 1):
                row = ((i * UPRIGHT + j) * ACROSS + k) * UPRIGHT
                low = row + upright(wanted[3] - error)
                high = row + upright(wanted[3] + error)
                for p in range(table.start[low], table.start[high + 1]):
                    four = table.pattern[p]
                    a, b, c = table.base[four[0]], table.base[four[1]], table.base[four[2]]
                    x, y = place(direction[a], direction[b], direction[c])
                    square = (x - wanted[0]) ** 2 + (y - wanted[1]) ** 2
                    if square > error**2:
                        continue
                    x, y = place(direction[a], direction[b], direction[table.base[four[3]]])
                    square += (x - wanted[2]) ** 2 + (y - wanted[3]) ** 2
                    if square <= error**2:
                        if count == len(found):
                            found = np.concatenate((found, np.empty_like(found)))
                        found[count] = p
                        count += 1
    return found[:count]
