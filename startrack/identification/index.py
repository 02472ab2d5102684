"""Stars enter; the codes of their patterns leave, sorted so that like codes lie together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.checks import positive, whole, within
from startrack.identification.code import TALLEST, place
from startrack.identification.sky import SkyGrid, cone, sky_grid
from startrack.identification.thin import local_rank
from startrack.units import deg
from startrack.values import Floats, Stars

Indices = NDArray[np.int32]

CELL = 0.05  # edge of a cell of the code space: larger than the errors, so that few are looked at
ACROSS = round(1 / CELL)  # cells along x, from 0 to 1
UPRIGHT = 2 * math.ceil(TALLEST / CELL)  # cells along y, as many below the base as above
SMALLEST = 0.2  # of the field: shorter bases measure their code too badly
LARGEST = 1.2  # of the field: longer ones hardly fit into the diagonal
VOTING_RANK = 40  # stars per field that vote on hypotheses


class CodeTable(NamedTuple):
    """Patterns sorted by the cells of the code space, for compiled code.

    The codes themselves are not kept: those few that are looked at are computed again.

    smallest  radian, least separation of the base of a pattern
    largest   radian, greatest
    base      (s,) places in `PatternIndex.bright` of the stars that form patterns
    pattern   (k, 4) places in `base` of A, B, C, D
    start     (cells + 1,) where the patterns of a cell begin
    """

    smallest: float
    largest: float
    base: Indices
    pattern: NDArray[np.unsignedinteger[Any]]
    start: Indices


@dataclass(frozen=True, eq=False)
class PatternIndex:
    """Patterns of four stars over the whole sky, for cameras of one field of view.

    stars          how many stars the catalogue had that it was built from
    field_of_view  radian
    table          the patterns
    bright         the stars that vote on hypotheses, up to VOTING_RANK per field
    magnitude      (len(bright.member),) of these
    faint          all stars of the catalogue
    """

    stars: int
    field_of_view: float
    table: CodeTable
    bright: SkyGrid
    magnitude: Floats
    faint: SkyGrid

    def __len__(self) -> int:
        return len(self.table.pattern)

    @property
    def size(self) -> int:
        """Bytes that the arrays take."""
        arrays = [*self.table[2:], *self.bright[1:], self.magnitude, *self.faint[1:]]
        return sum(np.asarray(array).nbytes for array in arrays)


def build_index(
    stars: Stars, field_of_view: float, stars_per_field: int = 16, patterns: int = 1_150_000
) -> PatternIndex:
    """Index the patterns of four stars that a camera can see at once.

    The catalogue is thinned until about `stars_per_field` of the brightest stars lie in every
    field. Small patterns are made of all these; those of a longer base only of the brighter
    ones, so that there are equally many stars over each base. A base is a fifth of the field
    at least, and hardly fits into a larger image at most.

    stars            the tracker's catalogue, in any order
    field_of_view    radian, of the smaller side of the image
    stars_per_field  how many stars form patterns, in the mean over fields
    patterns         about how many patterns to index, most often fewer; each takes 8 bytes
    Errors           ValueError where a star's direction is no unit vector, or the field lies
                     outside (0, 90] deg. model: the number of patterns holds for stars strewn
                     at random.
    """
    positive(field_of_view=field_of_view)
    within(0, 90 * deg, field_of_view=field_of_view)
    whole(4, VOTING_RANK, stars_per_field=stars_per_field)
    whole(1, 2**28, patterns=patterns)
    length = np.linalg.norm(stars.direction, axis=1)
    if not (np.abs(length - 1) < 1e-6).all():
        worst = length[np.argmax(np.abs(length - 1))]
        raise ValueError(f"stars.direction must be unit vectors, got one of length {worst}")

    order = np.argsort(stars.magnitude_g, kind="stable")
    radius = field_of_view / math.sqrt(math.pi)  # of the disc with the area of the field
    rank = np.empty(len(stars), np.int16)
    rank[order] = local_rank(stars.direction[order], radius, VOTING_RANK)
    voting = np.flatnonzero(rank < VOTING_RANK)
    bright = sky_grid(stars.direction[voting], field_of_view / 2)
    bright = bright._replace(member=voting[bright.member].astype(np.int32))
    rank = rank[bright.member]

    base = np.flatnonzero(rank < stars_per_field).astype(np.int32)
    per_field = max(len(base), 1) * field_of_view**2 / (4 * math.pi)
    crowding = _crowding(len(base), per_field, patterns)
    return PatternIndex(
        len(stars),
        field_of_view,
        _table(bright.direction, rank, base, field_of_view, crowding),
        bright,
        stars.magnitude_g[bright.member],
        sky_grid(stars.direction, field_of_view / 2),
    )


def _table(
    direction: Floats, rank: NDArray[np.int16], base: Indices, field_of_view: float, crowding: float
) -> CodeTable:
    """All patterns of the stars `base`, sorted."""
    smallest, largest = SMALLEST * field_of_view, LARGEST * field_of_view
    grid = sky_grid(direction[base], largest)
    pattern = _patterns(
        grid, rank[base[grid.member]], smallest, largest, crowding * field_of_view**2
    )
    cell = _encode(direction[base], pattern)
    order = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[order], np.arange((ACROSS * UPRIGHT) ** 2 + 1))
    narrow = np.uint16 if len(base) <= 2**16 else np.uint32
    return CodeTable(
        smallest,
        largest,
        base,
        np.asarray(pattern[order], narrow),
        start.astype(np.int32),
    )


def _crowding(stars: int, per_field: float, patterns: int) -> float:
    """How many stars, in the mean, may lie in the square over a base, to get so many patterns.

        patterns = n pi L^2 / 12 c^3 (1 + 3 (1 - c / (m w^2)))

    A base of length r has s L r^2 stars in its lens of area L r^2, if s lie on the unit of
    area, any two of which make a pattern, but for the few farther apart than the base:
    (s L r^2)^2 / 2. There are n s pi r dr such bases. Up to the base with s r^2 = c this makes
    the first term; beyond it, up to w fields, s falls as c / r^2, which makes the second.

    stars      n, strewn at random
    per_field  m, stars in the area of a field
    patterns   how many to make
    """
    lens = 2 * math.pi / 3 - TALLEST
    low, high = 0.0, per_field * LARGEST**2
    for _ in range(60):
        c = (low + high) / 2
        made = stars * math.pi * lens**2 / 12 * c**3 * (4 - 3 * c / (per_field * LARGEST**2))
        low, high = (c, high) if made < patterns else (low, c)
    return low


@njit(cache=True, error_model="numpy")
def _patterns(
    grid: SkyGrid, rank: NDArray[np.int16], smallest: float, largest: float, crowding: float
) -> Indices:  # pragma: no cover
    """All (k, 4) stars A, B, C, D of the grid with their farthest pair in front.

    rank      (n,) of the stars, below crowding / base^2 for those of a pattern
    crowding  radian^2
    """
    found = np.empty((1024, 4), np.int32)
    count = 0
    shortest, longest = 2 * np.sin(smallest / 2), 2 * np.sin(largest / 2)
    for a in range(len(grid.member)):
        near = cone(grid, grid.direction[a], largest)
        chord = np.empty(len(near))
        for i in range(len(near)):
            chord[i] = np.sqrt(np.sum((grid.direction[near[i]] - grid.direction[a]) ** 2))
        lens = np.empty(len(near), np.int32)
        for i in range(len(near)):
            b = near[i]
            most = crowding / chord[i] ** 2
            if b <= a or not shortest <= chord[i] <= longest or max(rank[a], rank[b]) >= most:
                continue
            inside = 0
            for j in range(len(near)):
                c = near[j]
                if c == a or chord[j] >= chord[i] or rank[c] >= most:
                    continue
                if np.sum((grid.direction[c] - grid.direction[b]) ** 2) < chord[i] ** 2:
                    lens[inside] = c
                    inside += 1
            while count + inside * inside // 2 > len(found):
                found = np.concatenate((found, np.empty_like(found)))
            for j in range(inside):
                c = lens[j]
                for k in range(j):
                    d = lens[k]
                    # The lens is taller than the base is long, so C and D may be the farthest.
                    if np.sum((grid.direction[c] - grid.direction[d]) ** 2) < chord[i] ** 2:
                        found[count, 0], found[count, 1] = grid.member[a], grid.member[b]
                        found[count, 2], found[count, 3] = grid.member[c], grid.member[d]
                        count += 1
    return found[:count]


@njit(cache=True, error_model="numpy")
def _encode(direction: Floats, pattern: Indices) -> Indices:  # pragma: no cover
    """Put patterns into canonical order; return the cells that their codes lie in."""
    cell = np.empty(len(pattern), np.int32)
    for i in range(len(pattern)):
        a, b, c, d = pattern[i]
        xc, yc = place(direction[a], direction[b], direction[c])
        xd, yd = place(direction[a], direction[b], direction[d])
        if xc + xd > 1:
            a, b = b, a
            xc, yc, xd, yd = 1 - xc, -yc, 1 - xd, -yd
        if xc > xd:
            c, d = d, c
            xc, yc, xd, yd = xd, yd, xc, yc
        pattern[i] = a, b, c, d
        row = column(xc) * UPRIGHT + upright(yc)
        cell[i] = (row * ACROSS + column(xd)) * UPRIGHT + upright(yd)
    return cell


@njit(cache=True, error_model="numpy")
def column(x: float) -> int:  # pragma: no cover
    """Cell along x, the nearest one where x lies outside."""
    return min(max(int(np.floor(x / CELL)), 0), ACROSS - 1)


@njit(cache=True, error_model="numpy")
def upright(y: float) -> int:  # pragma: no cover
    """Cell along y, the nearest one where y lies outside."""
    return min(max(int(np.floor(y / CELL)) + UPRIGHT // 2, 0), UPRIGHT - 1)
