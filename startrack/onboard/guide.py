"""Case -> guide stars, with magnitudes in the instrument's band, thinned; and their triangles."""

import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from startrack import core
from startrack.catalog import LIMITS, Selection, Sky, csv_table, open_sky, table_numbers
from startrack.core import (
    NON_NEGATIVE,
    Flags,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    deg,
    parameter,
    within,
)
from startrack.design import Case
from startrack.identification import local_rank, merged
from startrack.io import shipped
from startrack.observation import colour_correction, index_resolution
from startrack.onboard.layout import DOUBLE, STILL, UNIT, VARIABLE, Guide, triangle_codes

NEAR = 20 * core.arcsec  # distance from a variable star's place in its list, at J2000
CHOICES = ("mark", "omit")
MOST_STARS = 2**16 - 1  # indices of stars have 16 bits
FAINTER = 4.0  # magnitudes below the limit: a companion of 2.5 % of the light still makes a double
# of the field, shortest longest side of a triangle: noise of its code grows as the inverse
SMALLEST = 0.2
CIRCLE = 0.45  # of the field, radius of the circles of triangles
NARROWEST = 1 * deg  # smaller fields need more than 3e5 circles, and have few stars to G = 8
COARSEST = 0.1  # of the field, largest resolution
# Chosen by hand, as is the number of stars of a circle: more circles identify more skies and
# enlarge the index.
CENTRES = 8  # circles per field of the sphere, a third of the field apart
# cells of codes, 0.02 wide: x to 1/2, and y to sqrt(3) / 2 on either side
CELLS_X, CELLS_Y = 25, 88
# least fraction of a star's light: brighter neighbours within the resolution make it a double
SHARE = 0.01


class GuideVariable(NamedTuple):
    """A variable star of a list: place at J2000 (3,), name."""

    direction: tuple[float, float, float]
    name: str


class GuideSettings(Parameters):
    """Settings for the choice of guide stars.

    limit           magnitude of the faintest star, in the band of the instrument, where a star of
                    the Sun's colour has its G magnitude; None: the limit of the tracker's catalogue
    epoch           Julian year of the directions; None: epoch of the tracker's catalogue
    resolution      radian; closer stars are merged at their centre of light; None: resolution of
                    the tracker's identification
    doubles         "mark" keeps stars that are doubles within the resolution, "omit" leaves them
                    out
    variables       likewise for stars of the list
    per_field       guide stars per field: a star is left out if the circle of a field's area around
                    it has this number of brighter stars
    pattern_stars   number of brightest stars of each circle within a field that form triangles
    """

    limit: float | None = parameter(limit=Range(-2, 21), default=None)
    epoch: float | None = None
    resolution: float | None = parameter(limit=NON_NEGATIVE, default=None)
    doubles: str = parameter(limit=Range(choices=CHOICES), default="mark")
    variables: str = parameter(limit=Range(choices=CHOICES), default="mark")
    per_field: int = parameter(limit=Range(3, 40), default=16)
    pattern_stars: int = parameter(limit=Range(3, 12), default=5)


def read_variables(path: Path | None = None) -> list[GuideVariable]:
    """Variable stars of a CSV file with the columns ra, dec (degree, J2000) and name.

    path     None: the shipped list
    Raises   ValueError if the file is not such a table.
    """
    path = shipped("stars/variables.csv") if path is None else path
    table = csv_table(path)
    for name in ("ra", "dec"):
        if name not in table.colnames:
            raise Refused(f"{path} must have the column {name}, got {', '.join(table.colnames)}")
    ra, dec = (np.radians(table_numbers(path, table, name)) for name in ("ra", "dec"))
    if not np.isfinite(ra + dec).all():
        raise Refused(f"{path} must have ra and dec in each row")
    x, y, z = np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)
    names = [str(name) for name in table["name"]] if "name" in table.colnames else [""] * len(table)
    return [GuideVariable(*star) for star in zip(zip(x, y, z, strict=True), names, strict=True)]


def guide_stars(
    case: Case, settings: GuideSettings | None = None, variables: list[GuideVariable] | None = None
) -> Guide:
    """The guide stars of a design and their triangles; equal for equal arguments.

    Directions are barycentric: flight software adds aberration and parallax.

    variables  None: `read_variables()`
    Raises     ValueError if fewer than 4 or more than 65535 stars are left; for a field below 1
               deg, or a resolution above a tenth of the field.
    Accuracy   model: brightness of blackbodies in the band of the instrument; double stars are
               marked if both stars are in the catalogue; proper motions of the catalogue.
               numerical: 0.1 mas.
    """
    settings = settings or GuideSettings()
    known_variables = read_variables() if variables is None else variables
    camera = case.believed_camera
    field = min(camera.fov_x, camera.fov_y)
    believed = case.believed_catalog
    limit = believed.limit_g if settings.limit is None else settings.limit
    epoch = believed.year if settings.epoch is None else settings.epoch
    within(NARROWEST, math.pi, **{"field of view (rad)": field})
    asked = settings.resolution
    resolution = index_resolution(camera) if asked is None else asked
    within(0, COARSEST * field, **{"resolution (rad)": resolution})

    stars, still = _stars(case, limit, epoch)
    single, names = merged(stars, resolution)
    light = 10 ** (-0.4 * (single.magnitude_g - stars.magnitude_g[names]))
    flags = DOUBLE * (light > 1 + SHARE) + STILL * still[names]
    flags = flags + VARIABLE * _variable(case, single, known_variables)
    kept = single.magnitude_g <= limit
    for bit, choice in ((DOUBLE, settings.doubles), (VARIABLE, settings.variables)):
        if choice == "omit":
            kept &= flags & bit == 0
    single, flags = single[kept], flags[kept]
    rank = local_rank(single.direction, field / math.sqrt(math.pi), settings.per_field)
    thin = rank < settings.per_field
    return _with_triangles(single[thin], flags[thin], settings, (epoch, field, limit, resolution))


def _stars(case: Case, limit: float, epoch: float) -> tuple[core.Stars, Flags]:
    """All relevant stars, with magnitudes in the band; whether the proper motion of each is
    unknown."""
    seen = _barycentric(case.believed_catalog, epoch, limit + FAINTER + 1)
    barycentric = replace(seen, proper_motion=True)
    stars = open_sky(barycentric).stars
    # A star without a proper motion keeps its direction to the last digit.
    other = open_sky(replace(barycentric, epoch=epoch + (-1 if epoch > 2100 else 1))).stars
    still = (stars.direction == other.direction).all(axis=1)
    magnitude = stars.magnitude_g + colour_correction(case, stars.colour)
    stars = core.Stars(stars.identifier, stars.direction, magnitude, stars.colour)
    near = magnitude <= limit + FAINTER
    return stars[near], still[near]


def _barycentric(catalog: Selection, epoch: float, limit: float = math.inf) -> Selection:
    """All stars of a catalogue to a magnitude, at barycentric directions of a Julian year."""
    limit = min(limit, LIMITS.get(catalog.source, 21.0))
    still = replace(catalog, aberration=False, parallax=False, orbital_velocity=())
    return replace(still, limit_g=limit, epoch=epoch)


def _variable(case: Case, stars: core.Stars, variables: list[GuideVariable]) -> Flags:
    """Variable stars: the brightest star near each place of the list, at J2000."""
    variable = np.zeros(len(stars), bool)
    old = open_sky(_barycentric(case.believed_catalog, 2000.0))
    sky = Sky(old.stars)
    for star in variables:
        near = sky.cone(np.array(star.direction), NEAR)
        if len(near):
            variable |= stars.identifier == old.stars.identifier[near[0]]
    return variable


def _with_triangles(
    stars: core.Stars,
    flags: Ints,
    settings: GuideSettings,
    named: tuple[float, float, float, float],
) -> Guide:
    _, field, limit, _ = named
    if not 4 <= len(stars) <= MOST_STARS:
        raise ValueError(
            f"guide stars must number 4 to {MOST_STARS}, got {len(stars)} to the magnitude "
            f"{limit:g} with {settings.per_field} per field"
        )
    direction: Floats = np.round(stars.direction / UNIT) * UNIT  # rounded as in the file
    order = np.lexsort((*direction.T[:2], direction[:, 2]))
    stars, flags, direction = stars[order], flags[order], direction[order]
    base = SMALLEST * field, field
    triangle = _canonical(direction, _triangles(stars, field, settings.pattern_stars, base))
    columns = direction, np.round(stars.magnitude_g, 3), flags, stars.identifier
    cells = *_by_cells(direction, triangle), (CELLS_X, CELLS_Y)
    return Guide(*columns, *cells, *named, base, settings.per_field)


def _triangles(stars: core.Stars, field: float, count: int, base: tuple[float, float]) -> Ints:
    """Triangles (k, 3) of the brightest stars of all circles within a field.

    Nearly every image contains such a circle, and so has triangles in any direction.

    count  number of stars of a circle
    base   radian, smallest and largest of the longest side
    """
    sky = Sky(stars)
    centres = round(CENTRES * 4 * math.pi / field**2)
    z = 1 - (2 * np.arange(centres) + 1) / centres
    turn, across = core.GOLDEN_ANGLE * np.arange(centres), np.sqrt(1 - z**2)
    places = np.column_stack([across * np.cos(turn), across * np.sin(turn), z])
    triangles = set[tuple[int, ...]]()
    for place in places:
        brightest = np.sort(sky.cone(place, CIRCLE * field)[:count]).tolist()
        triangles.update(combinations(brightest, 3))
    triangle = np.array(sorted(triangles), np.int64).reshape(-1, 3)
    side = [stars.direction[triangle[:, k]] - stars.direction[triangle[:, k - 1]] for k in range(3)]
    longest = 2 * np.arcsin(np.linalg.norm(side, axis=2).max(axis=0) / 2)
    return triangle[(longest >= base[0]) & (longest <= base[1])]


def _canonical(direction: Floats, triangle: Ints) -> Ints:
    """The stars of each triangle in the order A, B, C: A and B farthest apart, C nearer to A."""
    turns = np.stack([np.roll(triangle, k, axis=1) for k in range(3)])
    base = np.linalg.norm(direction[turns[..., 0]] - direction[turns[..., 1]], axis=2)
    chosen = turns[base.argmax(axis=0), np.arange(len(triangle))]
    far = triangle_codes(*(direction[chosen[:, k]] for k in range(3)))[:, 0] > 0.5
    return np.where(far[:, None], chosen[:, [1, 0, 2]], chosen)


def _by_cells(direction: Floats, triangle: Ints) -> tuple[Ints, Ints]:
    """Triangles sorted by the cells of their codes, and the first of each cell."""
    a, b, c = (direction[triangle[:, k]] for k in range(3))
    size = 0.5 / CELLS_X
    x, y = np.floor(triangle_codes(a, b, c) / size).astype(int).T
    cell = np.clip(x, 0, CELLS_X - 1) * CELLS_Y + np.clip(y + CELLS_Y // 2, 0, CELLS_Y - 1)
    order = np.lexsort((np.linalg.norm(a - b, axis=1), cell))
    return triangle[order], np.searchsorted(cell[order], np.arange(CELLS_X * CELLS_Y + 1))
