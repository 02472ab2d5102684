"""The first accepted hypothesis from triangles of spots, brightest first."""

import math
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Ints, kernel
from startrack.identification.grids import VerificationStars, spot_grid
from startrack.identification.index import (
    CELLS_BASE,
    CELLS_Y,
    CodeTable,
    cell_base,
    cell_x,
    cell_y,
    separation,
    triangle_code,
)
from startrack.identification.seen import Seen
from startrack.identification.verify import (
    FIRST_RADIUS,
    MatchVerdict,
    attempt_attitude,
    prefilter,
    verify,
)

# Chosen by hand.
# Tolerance of a code for noise: a larger one takes more time, a smaller one loses triangles.
SIGMAS = 3.5


@lru_cache(maxsize=128)
def breadth_first(spots: int, bright: int) -> Ints:
    """Choices (k, 3) of three bright spots, sorted by the sum of their ranks.

    In this order one bright false spot delays the search only a little. Choices of the fainter
    spots follow, because all bright spots may be false: the limb of the Moon may be brighter than
    all stars.

    spots   number of spots to choose from
    bright  number of spots of the first choices
    """
    first = _choices(0, min(bright, spots))
    return np.concatenate([first, _choices(bright, spots)]) if spots > bright + 2 else first


def _choices(start: int, stop: int) -> Ints:
    choices = np.array(list(combinations(range(start, stop), 3)), np.int64).reshape(-1, 3)
    return choices[np.lexsort((choices[:, 2], choices.sum(axis=1)))]


class TripleLimits(NamedTuple):
    """Limits of a search.

    voting           number of the brightest spots that verify a hypothesis
    code_tolerance   1, error of a code beyond the noise
    fewest           least number of matches
    log_accepted     ln of the largest accepted bound on chance
    most_hypotheses  number after which the search ends
    """

    voting: int
    code_tolerance: float
    fewest: int
    log_accepted: float
    most_hypotheses: int


@kernel
def search(
    seen: Seen, choices: Ints, table: CodeTable, voters: VerificationStars, limits: TripleLimits
) -> tuple[MatchVerdict, int]:
    """Look up one triangle after the other until a hypothesis is accepted.

    seen           the spots that verify
    choices        (k, 3) spots, in the order to try
    table, voters  the triangles of the index, and its stars that verify hypotheses
    Returns        the best verdict, which is the last one if accepted; number of hypotheses
    """
    _, code_tolerance, fewest, log_accepted, most_hypotheses = limits
    tried = 0
    best = MatchVerdict(np.eye(3), 1.0, 0, 0.0)
    screen = spot_grid(seen.plane, seen.low, seen.high, FIRST_RADIUS * seen.radius)
    names, codes = np.empty((6, 3), np.int64), np.empty((6, 2))
    direction = table.sky.direction
    for choice in choices:
        longest, noise, off_axis = _measure(seen, choice)
        if not table.smallest * (1 - seen.focal) <= longest <= table.largest * (1 + seen.focal):
            continue
        # Off the axis, a wrong focal length is not a similarity: the magnifications along and
        # across
        # the radius differ by the relative error times tan^2 of the angle.
        error = noise + code_tolerance + 2 * seen.focal * off_axis
        stretch = noise + code_tolerance - math.log1p(-seen.focal) + 2 * seen.focal * off_axis
        shortest = cell_base(longest * math.exp(-stretch), table.smallest)
        farthest = cell_base(longest * math.exp(stretch), table.smallest)
        for k in range(_namings(seen.direction, choice, longest, error, names, codes)):
            x, y = codes[k]
            for i in range(cell_x(x - error), cell_x(x + error) + 1):
                for j in range(cell_y(y - error), cell_y(y + error) + 1):
                    row = (i * CELLS_Y + j) * CELLS_BASE
                    for p in range(table.start[row + shortest], table.start[row + farthest + 1]):
                        a, b, c = table.triangle[p]
                        px, py = triangle_code(direction[a], direction[b], direction[c])
                        if (px - x) ** 2 + (py - y) ** 2 > error**2:
                            continue
                        true = separation(direction[a], direction[b])
                        if abs(math.log(longest / true)) > stretch:
                            continue
                        tried += 1
                        rotation, scale = attempt_attitude(
                            seen, names[k], direction[a], direction[b]
                        )
                        if not prefilter(seen, screen, table.sky, rotation, scale, fewest):
                            continue
                        verdict = verify(seen, voters, rotation, scale, fewest)
                        if verdict.log_p < best.log_p:
                            best = verdict
                        if best.log_p < log_accepted:
                            return best, tried
                    if tried >= most_hypotheses:
                        return best, tried
    return best, tried


@kernel
def _measure(seen: Seen, choice: Ints) -> tuple[float, float, float]:
    """Base (radian), noise of the code, and the largest tan^2 of the angle off the axis."""
    base, sigma, off_axis = 0.0, 0.0, 0.0
    for i in range(3):
        apart = separation(seen.direction[choice[i]], seen.direction[choice[i - 1]])
        base = max(base, apart)
        sigma = max(sigma, seen.sigma[choice[i]])
        x, y = seen.plane[choice[i]]
        off_axis = max(off_axis, x * x + y * y)
    return base, SIGMAS * sigma / base, off_axis


@kernel
def _namings(
    direction: Floats, choice: Ints, longest: float, error: float, names: Ints, codes: Floats
) -> int:
    """All orders A, B, C of three spots that are canonical, or may be canonical within the error.

    longest       radian, separation of the base
    names, codes  (6, 3), (6, 2) the spots and their codes; written in place
    Returns       number of orders: one, unless sides are nearly equal or x is near 1/2
    """
    count = 0
    for i in range(3):
        a, b, c = choice[i], choice[i - 1], choice[i - 2]
        if separation(direction[a], direction[b]) < longest * (1 - error):
            continue
        x, y = triangle_code(direction[a], direction[b], direction[c])
        if x <= 0.5 + error:
            names[count, 0], names[count, 1], names[count, 2] = a, b, c
            codes[count, 0], codes[count, 1] = x, y
            count += 1
        if x >= 0.5 - error:
            names[count, 0], names[count, 1], names[count, 2] = b, a, c
            codes[count, 0], codes[count, 1] = 1 - x, -y
            count += 1
    return count
