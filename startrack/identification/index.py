"""Stars enter; the codes of their patterns leave, sorted so that like codes lie together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from startrack.checks import positive, within, whole
from startrack.identification.code import TALLEST, place, separation
from startrack.identification.sky import SkyGrid, cone, sky_grid
from startrack.identification.thin import local_rank
from startrack.units import deg
from startrack.values import Floats, Stars

Indices = NDArray[np.int32]

CELL = 0.05  # edge of a cell of the code space: larger than the errors, so that few are looked at
ACROSS = round(1 / CELL)  # cells along x, from 0 to 1
UPRIGHT = 2 * math.ceil(TALLEST / CELL)  # cells along y, as many below the base as above
UNIT = 1 / 32767  # of the codes as they are stored
SMALLEST = 0.2  # of the field: shorter bases measure their code too badly
LARGEST = 1.2  # of the field: longer ones hardly fit into the diagonal
VOTING_RANK = 40  # stars per field that vote on hypotheses


@dataclass(frozen=True, eq=False)
class PatternIndex:
    """Patterns of four stars over the whole sky, for cameras of one field of view.

    stars             how many stars the catalogue had that it was built from
    field_of_view     radian
    smallest, largest radian, separation of the base of a pattern
    bright            the stars that vote on hypotheses, up to VOTING_RANK per field
    rank              (len(bright.member),) how many brighter ones share a field with each
    faint             all stars of the catalogue
    base              (s,) places in `bright` of the stars that form patterns
    pattern           (k, 4) places in `base` of A, B, C, D
    code              (k, 4) code in units of UNIT
    start             (cells + 1,) where the patterns of a cell of the code space begin
    """

    stars: int
    field_of_view: float
    smallest: float
    largest: float
    bright: SkyGrid
    rank: NDArray[np.int16]
    faint: SkyGrid
    base: Indices
    pattern: NDArray[np.uint16] | NDArray[np.uint32]
    code: NDArray[np.int16]
    start: Indices

    def __len__(self) -> int:
        return len(self.pattern)

    @property
    def size(self) -> int:
        """Bytes that the arrays take."""
        arrays = [self.rank, self.base, self.pattern, self.code, self.start]
        arrays += [a for grid in (self.bright, self.faint) for a in grid[1:]]
        return sum(a.nbytes for a in arrays)


def build_index(
    stars: Stars, field_of_view: float, stars_per_field: int = 12, patterns: int = 1_300_000
) -> PatternIndex:
    """Index the patterns of four stars that a camera can see at once.

    The catalogue is thinned until about `stars_per_field` of the brightest stars lie in every
    field. All patterns of these are indexed whose base lies between a fifth of the field and
    the size at which there are about `patterns` of them.

    stars            the tracker's catalogue, in any order
    field_of_view    radian, of the smaller side of the image
    stars_per_field  how many stars form patterns, in the mean over fields
    patterns         about how many patterns to index; each takes 16 bytes
    Errors           ValueError where a star's direction is no unit vector, or the field lies
                     outside (0, 90] deg. model: catalogues that are clumped after thinning
                     hold more patterns than asked for.
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
    smallest = SMALLEST * field_of_view
    largest = _largest(len(base), patterns, field_of_view)
    neighbours = sky_grid(bright.direction[base], largest)
    pattern = _patterns(neighbours, smallest, largest)
    code, cell = _encode(bright.direction[base], pattern)
    places = np.uint16 if len(base) <= 2**16 else np.uint32
    along = np.argsort(cell, kind="stable")
    start = np.searchsorted(cell[along], np.arange((ACROSS * UPRIGHT) ** 2 + 1))
    return PatternIndex(
        len(stars),
        field_of_view,
        smallest,
        largest,
        bright,
        rank,
        sky_grid(stars.direction, field_of_view / 2),
        base,
        pattern.astype(places)[along],
        code[along],
        start.astype(np.int32),
    )


def _largest(stars: int, patterns: int, field_of_view: float) -> float:
    """Largest base, radian, with which n stars strewn at random make so many patterns.

        patterns = n pi L^2 / 12 (s b^2)^3,   s = n / (4 pi) stars per steradian

    A base of length r has s L r^2 stars in its lens of area L r^2, any two of which make a
    pattern: (s L r^2)^2 / 2. The integral runs over the n s pi r dr bases of each length to b.
    """
    lens = 2 * math.pi / 3 - TALLEST
    cube = patterns / max(stars, 1) * 12 / (math.pi * lens**2)
    base = math.sqrt(cube ** (1 / 3) * 4 * math.pi / max(stars, 1))
    return min(max(base, 2 * SMALLEST * field_of_view), LARGEST * field_of_view)


@njit(cache=True, error_model="numpy")
def _patterns(grid: SkyGrid, smallest: float, largest: float) -> Indices:  # pragma: no cover
    """All (k, 4) stars A, B, C, D of the grid with their farthest pair in front."""
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
            if b <= a or not shortest <= chord[i] <= longest:
                continue
            inside = 0
            for j in range(len(near)):
                c = near[j]
                if c == a or c == b or chord[j] >= chord[i]:
                    continue
                if np.sum((grid.direction[c] - grid.direction[b]) ** 2) < chord[i] ** 2:
                    lens[inside] = c
                    inside += 1
            if count + inside * inside // 2 > len(found):
                found = np.concatenate((found, np.empty_like(found), np.empty_like(found)))
                while count + inside * inside // 2 > len(found):
                    found = np.concatenate((found, np.empty_like(found)))
            for j in range(inside):
                for k in range(j):
                    found[count] = grid.member[a], grid.member[b], grid.member[lens[j]], grid.member[lens[k]]
                    count += 1
    return found[:count]


@njit(cache=True, error_model="numpy")
def _encode(
    direction: Floats, pattern: Indices
) -> tuple[NDArray[np.int16], Indices]:  # pragma: no cover
    """Put patterns into canonical order; return their codes, and the cells these lie in."""
    code = np.empty(pattern.shape, np.int16)
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
        code[i] = round(xc / UNIT), round(yc / UNIT), round(xd / UNIT), round(yd / UNIT)
        row = column(xc) * UPRIGHT + upright(yc)
        cell[i] = (row * ACROSS + column(xd)) * UPRIGHT + upright(yd)
    return code, cell


@njit(cache=True, error_model="numpy")
def column(x: float) -> int:  # pragma: no cover
    """Cell along x, the nearest one where x lies outside."""
    return min(max(int(np.floor(x / CELL)), 0), ACROSS - 1)


@njit(cache=True, error_model="numpy")
def upright(y: float) -> int:  # pragma: no cover
    """Cell along y, the nearest one where y lies outside."""
    return min(max(int(np.floor(y / CELL)) + UPRIGHT // 2, 0), UPRIGHT - 1)
