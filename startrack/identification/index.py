"""The pattern index: codes of triangles of stars, sorted into cells."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from startrack import core
from startrack.core import Floats, Ints, Refused, deg, kernel, within
from startrack.identification.grids import (
    Indices,
    SkyGrid,
    VerificationStars,
    cone,
    cubes,
    sky_grid,
)

MAGNITUDE = 0.4 * np.log(10)  # change of ln(flux) per magnitude


def merged(
    stars: core.Stars, resolution: float, pairs: Ints | None = None
) -> tuple[core.Stars, Ints]:
    """Merge stars closer than the resolution into one star at the centre of their light.

    The brightest star of a close group is merged with the stars within the resolution of it.

    resolution  radian
    pairs       (k, 2) close stars, by their ranks in brightness; None: they are searched for
    Returns     the merged stars, brightest first, with identifier and colour of the brightest star
                of each group; and the indices of these brightest stars in `stars`
    """
    order = np.argsort(stars.magnitude_g, kind="stable")
    direction = stars.direction[order]
    if pairs is None:
        pairs = cKDTree(direction).query_pairs(2 * np.sin(resolution / 2), output_type="ndarray")
    taker = _merged_into(len(stars), pairs)
    flux = np.exp(-MAGNITUDE * stars.magnitude_g[order])
    light, is_left = flux.copy(), taker == np.arange(len(stars))
    lost = np.flatnonzero(~is_left)
    np.add.at(light, taker[lost], flux[lost])
    several = np.flatnonzero(light != flux)
    centre = np.zeros_like(direction)
    centre[several] = flux[several, None] * direction[several]
    np.add.at(centre, taker[lost], flux[lost, None] * direction[lost])
    direction[several] = centre[several] / np.linalg.norm(centre[several], axis=1, keepdims=True)
    names = order[is_left]
    magnitude = -np.log(light[is_left]) / MAGNITUDE
    left = core.Stars(stars.identifier[names], direction[is_left], magnitude, stars.colour[names])
    return left, names


def _merged_into(count: int, pairs: Ints) -> Ints:
    """Index (count,) of the star into which each star is merged, or its own; brightest first."""
    taker = np.arange(count)
    pairs = np.sort(pairs, axis=1)
    for brighter, fainter in pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]:
        if taker[brighter] == brighter and taker[fainter] == fainter:
            taker[fainter] = brighter
    return taker


Ranks = NDArray[np.int16]


def local_rank(direction: Floats, radius: float, most: int) -> Ranks:
    """Number of brighter stars within `radius` of each star.

    The brightest star of a region has rank 0. Selecting the stars below a rank thins dense regions
    and keeps sparse ones, so that each field has about the same number of patterns.

    direction  (n, 3) unit vectors, brightest first
    radius     radian
    most       largest rank; stars of this rank do not count as neighbours
    Returns    (n,) rank, at most `most`
    """
    return _rank(np.ascontiguousarray(direction), radius, most, cubes(radius))


@kernel
def _rank(direction: Floats, radius: float, most: int, side: int) -> Ranks:
    """`local_rank` by a grid of `side` cubes along an axis, from the brightest star on."""
    n = len(direction)
    rank = np.empty(n, np.int16)
    newest = np.full(side**3, -1, np.int32)  # each cube is a linked list: its last star
    before = np.empty(n, np.int32)  # and the star before each star
    limit = np.cos(radius)
    steps = int(np.ceil(radius / 2 * side))
    for s in range(n):
        x, y, z = direction[s]
        i0 = min(int((x + 1) / 2 * side), side - 1)
        j0 = min(int((y + 1) / 2 * side), side - 1)
        k0 = min(int((z + 1) / 2 * side), side - 1)
        count = 0
        for i in range(max(i0 - steps, 0), min(i0 + steps + 1, side)):
            for j in range(max(j0 - steps, 0), min(j0 + steps + 1, side)):
                for k in range(max(k0 - steps, 0), min(k0 + steps + 1, side)):
                    t = newest[(i * side + j) * side + k]
                    while t >= 0 and count < most:
                        d = direction[t]
                        if d[0] * x + d[1] * y + d[2] * z >= limit:
                            count += 1
                        t = before[t]
        rank[s] = count
        if count < most:
            home = (i0 * side + j0) * side + k0
            before[s] = newest[home]
            newest[home] = s
    return rank


TALLEST = math.sqrt(3) / 2  # largest |y| of a code: that of an equilateral triangle


@kernel
def triangle_code(a: Floats, b: Floats, c: Floats) -> tuple[float, float]:
    """Code of a triangle of directions: position of C over the base from A to B.

    The plane touches the sphere in the middle between A and B. With A at (0, 0) and B at (1, 0), C
    has the position (x, y). Neither rotation nor scale changes it; a mirror image has another code.
    A and B are the two directions farthest apart, so that C lies in the lens of points that are
    nearer to A and to B than A is to B. The canonical order of A and B has x <= 1/2.

    Source: after Lang et al. (2010), Astron. J. 139, 1782, sect. 2.2, who use four stars and the
    square on the base.

    a, b, c  (3,) unit vectors
    Returns  (x, y) 1, in units of the base
    """
    mx, my, mz = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    # m and e are normal to each other; |e| / |m| = tan(separation / 2)
    nx, ny, nz = my * ez - mz * ey, mz * ex - mx * ez, mx * ey - my * ex
    ee = ex * ex + ey * ey + ez * ez
    mm = mx * mx + my * my + mz * mz
    depth = c[0] * mx + c[1] * my + c[2] * mz
    along = c[0] * ex + c[1] * ey + c[2] * ez
    across = c[0] * nx + c[1] * ny + c[2] * nz
    return 0.5 + 0.5 * along * mm / (depth * ee), 0.5 * across * math.sqrt(mm) / (depth * ee)


@kernel
def separation(a: Floats, b: Floats) -> float:
    """Angle (radian) between two unit vectors (3,), accurate at small angles."""
    chord = math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    return 2 * math.asin(min(chord / 2, 1.0))


# Chosen by hand: smaller cells hold fewer triangles to compare, but more of them must be read.
CELL = 0.02  # edge of a cell of the code, larger than the errors of a code
CELLS_X = round(0.5 / CELL)  # cells along x, from 0 to 1/2
CELLS_Y = 2 * math.ceil(TALLEST / CELL)  # cells along y, equal numbers below and above the base
STRETCH = 0.02  # ln of the ratio of the bases of two neighbouring cells, as CELL
# Range of bases over the field of view. Chosen by hand: in a wider range, more stars of an image
# form triangles, but the index is larger.
SMALLEST = 0.2  # the noise of a code is inversely proportional to the base
LARGEST = 1.2  # few longer bases fit into the diagonal, sqrt(2)
CELLS_BASE = math.ceil(math.log(LARGEST / SMALLEST) / STRETCH)  # cells along the length of the base
# Radian, widest field of an index. Triangles with bases of 1.2 times this field still fit the plane
# that touches the sphere in the middle of the base. Wider images also have many such triangles.
WIDEST = 90 * deg
POINTS = 512  # resolved points across a field: two pixels of 1024; by hand for common cameras
VOTING_RANK = 40  # stars per field that verify hypotheses; by hand: success against time and memory
# Error of a star's magnitude in an unknown passband. Chosen by hand: larger errors make brightness
# weaker evidence, smaller ones refuse variable stars and unusual passbands.
BLUR = 0.3  # magnitude, of a star with the Sun's colour
COLOUR_BLUR = 0.2  # magnitude per magnitude of difference in BP - RP from the Sun
SUN_COLOUR = 0.82  # magnitude, BP - RP (Casagrande and VandenBerg 2018, MNRAS 479, L102)


class CodeTable(NamedTuple):
    """Triangles sorted by the cells of code and base, for compiled code.

    The codes are not stored: the search computes those of the few cells that it reads.

    smallest  radian, smallest base of a triangle
    largest   radian, largest base
    sky       the stars that form triangles; their members are indices into `PatternIndex.bright`
    triangle  (k, 3) indices into `sky` of A, B, C
    start     (cells + 1,) index of the first triangle of each cell
    """

    smallest: float
    largest: float
    sky: SkyGrid
    triangle: NDArray[np.unsignedinteger[Any]]
    start: Indices


@dataclass(frozen=True, eq=False)
class PatternIndex:
    """Triangles of stars over the whole sky, for cameras of one field of view.

    stars          number of stars in the catalogue that it was built from
    field_of_view  radian
    table          the triangles
    bright         the stars that verify hypotheses, up to VOTING_RANK per field
    faint          all stars of the catalogue, close ones merged
    """

    stars: int
    field_of_view: float
    table: CodeTable
    bright: VerificationStars
    faint: SkyGrid

    def __len__(self) -> int:
        return len(self.table.triangle)

    @property
    def size(self) -> int:
        """Memory of the arrays, byte."""
        return core.bytes_of(self)


def indexed_field(camera: core.Camera) -> float:
    """The field of view (radian) of a camera's index, the same for cameras of similar fields.

    It is the smaller side of the image, at most WIDEST, rounded down to a power of 1.1.
    """
    step, side = math.log(1.1), min(camera.fov_x, camera.fov_y, WIDEST)
    return math.exp(math.floor(math.log(side) / step) * step)


def build_index(
    stars: core.Stars,
    field_of_view: float,
    stars_per_field: int = 16,
    triangles: int = 1_200_000,
    resolution: float | None = None,
) -> PatternIndex:
    """Index the triangles of bright stars that a camera can see at once.

    The catalogue is thinned to about `stars_per_field` of the brightest stars in every field.
    All of these form small triangles. Only brighter stars form triangles with longer bases: their
    number per field is inversely proportional to the base, so that bases of all lengths are about
    equally frequent. Bases are 0.2 to 1.2 of the field.

    stars            the tracker's catalogue, in any order
    field_of_view    radian, of the smaller side of the image
    stars_per_field  number of stars that form triangles, mean over fields
    triangles        approximate number to index, usually fewer; each takes 6 bytes
    resolution       radian, stars closer than this form one spot; None: field_of_view / 512
    Returns          PatternIndex
    Raises           ValueError if a star's direction is not a unit vector, or the field lies
                     outside (0, 90] deg.
    Accuracy         model: the number of triangles holds for randomly distributed stars.
    """
    core.positive(field_of_view=field_of_view)
    within(0, WIDEST, field_of_view=field_of_view)
    core.whole(3, VOTING_RANK, stars_per_field=stars_per_field)
    core.whole(1, 2**28, triangles=triangles)
    length = np.linalg.norm(stars.direction, axis=1)
    if not (np.abs(length - 1) < 1e-6).all():
        worst = length[np.argmax(np.abs(length - 1))]
        raise Refused(f"stars.direction must be unit vectors, got one of length {worst}")

    single, names = merged(stars, field_of_view / POINTS if resolution is None else resolution)
    radius = field_of_view / math.sqrt(math.pi)  # of the disc with the area of the field
    rank = local_rank(single.direction, radius, VOTING_RANK)
    voting = rank < VOTING_RANK
    bright = _verification_stars(single[voting], field_of_view)
    rank = rank[voting][bright.sky.member]
    faint = sky_grid(single.direction, field_of_view / 2)

    base = np.flatnonzero(rank < stars_per_field)
    fields = 4 * math.pi / field_of_view**2
    crowding = _crowding(fields, len(base) / fields, triangles) * field_of_view
    sky = sky_grid(bright.sky.direction[base], field_of_view / 2)
    rank = rank[base][sky.member]
    return PatternIndex(
        len(stars),
        field_of_view,
        _table(_named(sky, base), rank, field_of_view, crowding),
        bright._replace(sky=_named(bright.sky, names[voting])),
        _named(faint, names),
    )


def _named(sky: SkyGrid, names: Ints) -> SkyGrid:
    """The grid with members that are indices into the catalogue."""
    return sky._replace(member=names[sky.member].astype(np.int32))


def _verification_stars(stars: core.Stars, field_of_view: float) -> VerificationStars:
    """The stars on a grid of the sky, with their magnitudes and the errors of the magnitudes."""
    sky = sky_grid(stars.direction, field_of_view / 2)
    stars = stars[sky.member.astype(np.int64)]
    red = np.where(np.isfinite(stars.colour), stars.colour - SUN_COLOUR, 1.0)
    return VerificationStars(sky, stars.magnitude_g, np.hypot(BLUR, COLOUR_BLUR * red))


def _table(
    sky: SkyGrid, rank: NDArray[np.int16], field_of_view: float, crowding: float
) -> CodeTable:
    """All triangles of these stars, sorted."""
    smallest, largest = SMALLEST * field_of_view, LARGEST * field_of_view
    triangle = _triangles(sky, rank, smallest, largest, crowding)
    cell = _encode(sky.direction, triangle, smallest)
    counts = np.bincount(cell, minlength=CELLS_X * CELLS_Y * CELLS_BASE)
    start = np.append(0, np.cumsum(counts))
    narrow = triangle.astype(np.uint16 if len(rank) <= 2**16 else np.uint32)
    return CodeTable(
        smallest, largest, sky, narrow.take(_order(cell), axis=0), start.astype(np.int32)
    )


def _order(cell: Indices) -> Ints:
    """The order that sorts cells; equal cells keep their order.

    It sorts by the lower 16 bits, then by the upper ones: for 16 bits numpy uses a radix sort.
    """
    order = np.argsort(cell.astype(np.uint16), kind="stable")
    return order[np.argsort((cell >> 16).astype(np.uint16)[order], kind="stable")]


def _crowding(fields: float, per_field: float, triangles: int) -> float:
    """The constant c: stars of rank below c / base form the wanted number of triangles.

        triangles = fields pi L Int min(s, c / r)^3 r^3 dr

    s is the number of stars per field. Each star has pi s r dr partners at a distance r, with each
    pair counted once. s L r^2 stars lie in the lens of area L r^2 on each such base.

    fields     number of fields on the sphere
    per_field  s, randomly distributed stars
    triangles  wanted number
    Returns    c, stars per field times a base in units of the field
    """
    lens = 2 * math.pi / 3 - TALLEST
    r = np.linspace(SMALLEST, LARGEST, 200)
    low, high = 0.0, per_field * LARGEST
    for _ in range(60):
        c = (low + high) / 2
        made = fields * math.pi * lens * np.trapezoid(np.minimum(per_field * r, c) ** 3, r)
        low, high = (c, high) if made < triangles else (low, c)
    return low


@kernel
def _triangles(
    grid: SkyGrid, rank: NDArray[np.int16], smallest: float, largest: float, crowding: float
) -> Indices:
    """All triangles (k, 3) of stars A, B, C of the grid, with A and B farthest apart.

    rank      (n,) ranks of the stars; a triangle has only stars of rank below crowding / base
    crowding  radian, `_crowding` times the field of view
    """
    triangles = np.empty((1024, 3), np.int32)
    count = 0
    shortest, longest = 2 * math.sin(smallest / 2), 2 * math.sin(largest / 2)
    for a in range(len(grid.member)):
        near = cone(grid, grid.direction[a], largest)
        chord = np.empty(len(near))
        for i in range(len(near)):
            chord[i] = math.sqrt(_square(grid.direction[near[i]], grid.direction[a]))
        for i in range(len(near)):
            b = near[i]
            most = crowding / chord[i]
            if b <= a or not shortest <= chord[i] <= longest or max(rank[a], rank[b]) >= most:
                continue
            if count + len(near) > len(triangles):
                more = np.empty((2 * len(triangles), 3), np.int32)
                for k in range(count):
                    more[k, 0], more[k, 1], more[k, 2] = (
                        triangles[k, 0],
                        triangles[k, 1],
                        triangles[k, 2],
                    )
                triangles = more
            for j in range(len(near)):
                c = near[j]
                if c == a or chord[j] >= chord[i] or rank[c] >= most:
                    continue
                if _square(grid.direction[c], grid.direction[b]) < chord[i] ** 2:
                    triangles[count, 0], triangles[count, 1], triangles[count, 2] = a, b, c
                    count += 1
    return triangles[:count]


@kernel
def _square(a: Floats, b: Floats) -> float:
    """The squared chord between two unit vectors (3,)."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@kernel
def _encode(direction: Floats, triangle: Indices, smallest: float) -> Indices:
    """Put triangles into canonical order; return the cells in which their codes lie."""
    cell = np.empty(len(triangle), np.int32)
    for i in range(len(triangle)):
        a, b, c = triangle[i]
        x, y = triangle_code(direction[a], direction[b], direction[c])
        if x > 0.5:
            a, b = b, a
            x, y = 1 - x, -y
        triangle[i, 0], triangle[i, 1], triangle[i, 2] = a, b, c
        row = cell_x(x) * CELLS_Y + cell_y(y)
        cell[i] = row * CELLS_BASE + cell_base(separation(direction[a], direction[b]), smallest)
    return cell


@kernel
def cell_x(x: float) -> int:
    """Cell along x; for x outside the table, the nearest cell."""
    return min(max(math.floor(x / CELL), 0), CELLS_X - 1)


@kernel
def cell_y(y: float) -> int:
    """Cell along y; for y outside the table, the nearest cell."""
    return min(max(math.floor(y / CELL) + CELLS_Y // 2, 0), CELLS_Y - 1)


@kernel
def cell_base(base: float, smallest: float) -> int:
    """Cell along the length of the base (radian); for a base outside the table, the nearest."""
    return min(max(math.floor(math.log(base / smallest) / STRETCH), 0), CELLS_BASE - 1)
