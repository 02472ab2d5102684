"""Patterns of spots enter, brightest first; the first hypothesis beyond doubt leaves."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.identification.code import place, separation, squared_chords
from startrack.identification.index import ACROSS, UNIT, UPRIGHT, column, upright
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
    smallest: float,
    largest: float,
    base_star: NDArray[np.int32],
    pattern: NDArray[np.unsignedinteger[Any]],
    code: NDArray[np.int16],
    start: NDArray[np.int32],
    sky: SkyGrid,
    rank: NDArray[np.int16],
    fewest: int,
    log_accepted: float,
    most_hypotheses: int,
) -> tuple[Floats, float, int, float, int]:  # pragma: no cover
    """Look up pattern after pattern until a hypothesis is beyond doubt.

    choices          (k, 4) spots, in the order to try
    code_tolerance   1, error of a code beyond the noise
    smallest ... start, sky, rank    of the index
    fewest           as in `verify`
    log_accepted     ln of the chance bound to stay below
    most_hypotheses  after so many the search ends
    Returns          icrs_to_camera, scale, matches, ln of the chance bound, hypotheses tried
    """
    tried = 0
    stretch = math.log1p(seen.focal)
    square = squared_chords(seen.direction[: choices.max() + 1])
    spots, four = np.empty(4, np.int64), np.empty(4, np.int64)
    wanted = np.empty(4)
    for choice in choices:
        longest = 0.0
        for i in range(4):
            for j in range(i):
                longest = max(longest, square[choice[i], choice[j]])
        base = 2 * math.asin(min(math.sqrt(longest) / 2, 1.0))
        if not smallest / (1 + seen.focal) <= base <= largest * (1 + seen.focal):
            continue
        noise, off_axis = 0.0, 0.0
        for i in range(4):
            noise = max(noise, seen.sigma[choice[i]])
            x, y = seen.plane[choice[i]]
            off_axis = max(off_axis, x * x + y * y)
        # A wrong focal length is no similarity away from the axis: it stretches radii by
        # tan'(theta) more than circles.
        noise = SIGMAS * noise / base
        error = noise + code_tolerance + seen.focal * off_axis
        for i in range(4):
            for j in range(4):
                # Noise may have swapped which pair is the farthest, and the canonical order.
                if i == j or square[choice[i], choice[j]] < longest * (1 - error) ** 2:
                    continue
                a, b = choice[i], choice[j]
                k = 0
                while k in (i, j):
                    k += 1
                c, d = choice[k], choice[6 - i - j - k]
                for _ in range(2):
                    c, d = d, c
                    xc, yc = place(seen.direction[a], seen.direction[b], seen.direction[c])
                    xd, yd = place(seen.direction[a], seen.direction[b], seen.direction[d])
                    if xc - xd > 2 * error or xc + xd - 1 > 2 * error:
                        continue
                    wanted[0], wanted[1], wanted[2], wanted[3] = xc, yc, xd, yd
                    spots[0], spots[1], spots[2], spots[3] = a, b, c, d
                    for p in _within(wanted, error, code, start):
                        for n in range(4):
                            four[n] = base_star[pattern[p, n]]
                        true = separation(sky.direction[four[0]], sky.direction[four[1]])
                        if abs(math.log(base / true)) > stretch + noise + seen.focal * off_axis:
                            continue
                        tried += 1
                        rotation, scale, matches, log_p = verify(
                            seen, spots, sky, rank, four, fewest
                        )
                        if log_p < log_accepted:
                            return rotation, scale, matches, log_p, tried
                        if tried >= most_hypotheses:
                            return np.eye(3), 1.0, 0, 0.0, tried
    return np.eye(3), 1.0, 0, 0.0, tried


@njit(cache=True, error_model="numpy")
def _within(
    wanted: Floats, error: float, code: NDArray[np.int16], start: NDArray[np.int32]
) -> NDArray[np.int64]:  # pragma: no cover
    """Which patterns have a code within `error` of the one wanted."""
    found = np.empty(64, np.int64)
    count = 0
    limit = (error / UNIT) ** 2
    x1, y1, x2, y2 = wanted / UNIT
    for i in range(column(wanted[0] - error), column(wanted[0] + error) + 1):
        for j in range(upright(wanted[1] - error), upright(wanted[1] + error) + 1):
            for k in range(column(wanted[2] - error), column(wanted[2] + error) + 1):
                row = ((i * UPRIGHT + j) * ACROSS + k) * UPRIGHT
                low = row + upright(wanted[3] - error)
                high = row + upright(wanted[3] + error)
                for p in range(start[low], start[high + 1]):
                    e1, e2 = code[p, 0] - x1, code[p, 1] - y1
                    e3, e4 = code[p, 2] - x2, code[p, 3] - y2
                    if e1 * e1 + e2 * e2 + e3 * e3 + e4 * e4 <= limit:
                        if count == len(found):
                            found = np.concatenate((found, np.empty_like(found)))
                        found[count] = p
                        count += 1
    return found[:count]
