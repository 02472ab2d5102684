"""Case -> its guide stars: in the band of the instrument, thinned; and the triangles of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack.catalog import LIMITS, Sky, csv_table, open_sky, table_numbers
from startrack.core import Floats, Ints, Stars, arcsec, non_negative, one_of, whole, within
from startrack.design import Case
from startrack.identification import CELLS, PatternIndex, build_index, local_rank, merged
from startrack.io import shipped
from startrack.onboard.layout import DOUBLE, STILL, UNIT, VARIABLE, Guide
from startrack.trial import colour_correction, index_resolution

NEAR = 20 * arcsec  # of a variable star's place in its list, at J2000
CHOICES = ("mark", "omit")
MOST_STARS = 2**16 - 1  # their numbers have 16 bits
FAINTER = 2.0  # magnitude below the limit of stars that make others double: a sixth of the light
SHARE = 0.01  # of a star's light, from which on others within the resolution make it double


class Variable(NamedTuple):
    """A variable star of a list: place at J2000 (3,), name."""

    direction: tuple[float, float, float]
    name: str


@dataclass(frozen=True)
class GuideSettings:
    """How the guide stars of a design are chosen.

    limit           magnitude of the faintest, in the band of the instrument: that of a star of the
                    Sun's colour is its G; None: the limit of the tracker's catalogue
    epoch           Julian year of the directions, None for that of the tracker's catalogue
    resolution      radian, stars closer than this are one, at their centre of light; None: that of
                    the tracker's identification
    doubles         "mark" keeps stars that are several within the resolution, "omit" leaves them
                    out
    variables       the same for stars of the list
    per_field       guide stars in the area of a field: a star with as many brighter ones in the
                    circle of this area around it is left out
    pattern_stars   the brightest of these that form triangles
    triangles       approximate number of triangles; None: 100 per field of the sphere
    """

    limit: float | None = None
    epoch: float | None = None
    resolution: float | None = None
    doubles: str = "mark"
    variables: str = "mark"
    per_field: int = 16
    pattern_stars: int = 9
    triangles: int | None = None

    def __post_init__(self) -> None:
        if self.limit is not None:
            within(-2, 21, limit=self.limit)
        if self.resolution is not None:
            non_negative(resolution=self.resolution)
        one_of(CHOICES, doubles=self.doubles, variables=self.variables)
        whole(3, 40, per_field=self.per_field)
        whole(3, 40, pattern_stars=self.pattern_stars)
        if self.triangles is not None:
            whole(1, 2**24, triangles=self.triangles)


def read_variables(path: Path | None = None) -> list[Variable]:
    """Variable stars of a CSV file with the columns ra, dec (degree, J2000) and name.

    path     None: the shipped list
    Raises   ValueError for a file that is no such table.
    """
    path = shipped("stars/variables.csv") if path is None else path
    table = csv_table(path)
    for name in ("ra", "dec"):
        if name not in table.colnames:
            raise ValueError(f"{path} must have the column {name}, got {', '.join(table.colnames)}")
    ra, dec = (np.radians(table_numbers(path, table, name)) for name in ("ra", "dec"))
    if not np.isfinite(ra + dec).all():
        raise ValueError(f"{path} must have ra and dec in each row")
    x, y, z = np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)
    names = [str(one) for one in table["name"]] if "name" in table.colnames else [""] * len(table)
    return [Variable(*one) for one in zip(zip(x, y, z, strict=True), names, strict=True)]


def guide_stars(
    case: Case, settings: GuideSettings | None = None, variables: list[Variable] | None = None
) -> Guide:
    """The guide stars of a design, and the triangles of them; the same for the same arguments.

    Directions are seen from the barycentre: flight software adds aberration and parallax itself.

    variables  None: `read_variables()`
    Raises     ValueError where too few stars are left, or more than 65535.
    Accuracy   model: the brightness is that of blackbodies in the band of the instrument; double
               stars are known where both are in the catalogue; proper motions as the catalogue
               has them.  numerical: 0.1 mas.
    """
    settings = settings or GuideSettings()
    known = read_variables() if variables is None else variables
    camera = case.believed_camera
    field = min(camera.fov_x, camera.fov_y)
    believed = case.believed_catalog
    limit = believed.limit_g if settings.limit is None else settings.limit
    epoch = believed.year if settings.epoch is None else settings.epoch
    resolution = settings.resolution
    if resolution is None:
        resolution = index_resolution(camera)

    stars, still = _stars(case, limit, epoch)
    single, names = merged(stars, resolution)
    light = 10 ** (-0.4 * (single.magnitude_g - stars.magnitude_g[names]))
    flags = DOUBLE * (light > 1 + SHARE) + STILL * still[names]
    flags = flags + VARIABLE * _variable(case, single, known)
    kept = single.magnitude_g <= limit
    for bit, choice in ((DOUBLE, settings.doubles), (VARIABLE, settings.variables)):
        if choice == "omit":
            kept &= flags & bit == 0
    single, flags = single[kept], flags[kept]
    rank = local_rank(single.direction, field / math.sqrt(math.pi), settings.per_field)
    thin = rank < settings.per_field
    return _with_triangles(single[thin], flags[thin], field, settings, (epoch, limit, resolution))


def _stars(case: Case, limit: float, epoch: float) -> tuple[Stars, NDArray[np.bool_]]:
    """All stars that count, with magnitudes in the band; whether the motion of each is unknown."""
    believed = case.believed_catalog
    faintest = min(limit + FAINTER + 1, LIMITS.get(believed.source, 21.0))
    barycentric = replace(
        believed,
        limit_g=faintest,
        epoch=epoch,
        aberration=False,
        parallax=False,
        orbital_velocity=(),
        proper_motion=True,
    )
    stars = open_sky(barycentric).stars
    # A star without a proper motion stays where it is, to the last digit.
    other = open_sky(replace(barycentric, epoch=epoch + (-1 if epoch > 2100 else 1))).stars
    still = (stars.direction == other.direction).all(axis=1)
    magnitude = stars.magnitude_g + colour_correction(case, stars.colour)
    stars = Stars(stars.identifier, stars.direction, magnitude, stars.colour)
    near = magnitude <= limit + FAINTER
    return stars[near], still[near]


def _variable(case: Case, stars: Stars, known: list[Variable]) -> NDArray[np.bool_]:
    """Which stars are those of the list: the brightest near each place, at J2000."""
    found = np.zeros(len(stars), bool)
    old = open_sky(
        replace(
            case.believed_catalog, limit_g=LIMITS.get(case.believed_catalog.source, 21.0),
            epoch=2000.0, aberration=False, parallax=False, orbital_velocity=(),
        )
    )  # fmt: skip
    sky = Sky(old.stars)
    for one in known:
        near = sky.cone(np.array(one.direction), NEAR)
        if len(near):
            found |= stars.identifier == old.stars.identifier[near[0]]
    return found


def _with_triangles(
    stars: Stars,
    flags: Ints,
    field: float,
    settings: GuideSettings,
    named: tuple[float, float, float],
) -> Guide:
    epoch, limit, resolution = named
    if not 4 <= len(stars) <= MOST_STARS:
        raise ValueError(
            f"guide stars must number 4 to {MOST_STARS}, got {len(stars)} to the magnitude "
            f"{limit:g} with {settings.per_field} per field"
        )
    direction: Floats = np.round(stars.direction / UNIT) * UNIT  # as the file has them
    order = np.lexsort((*direction.T[:2], direction[:, 2]))
    stars, flags, direction = stars[order], flags[order], direction[order]
    triangles = settings.triangles
    if triangles is None:
        triangles = math.ceil(100 * 4 * math.pi / field**2)
    index = build_index(stars, field, settings.pattern_stars, triangles, 0.0)
    triangle, start = _by_cells(index)
    return Guide(
        direction,
        np.round(stars.magnitude_g, 3),
        flags,
        stars.identifier,
        triangle,
        start,
        CELLS[:2],
        epoch,
        field,
        limit,
        resolution,
        (index.table.smallest, index.table.largest),
        settings.per_field,
    )


def _by_cells(index: PatternIndex) -> tuple[Ints, Ints]:
    """Triangles of stars, sorted by the cells of their codes alone."""
    table = index.table
    star = index.bright.sky.member[table.sky.member]
    triangle = star[table.triangle.astype(np.int64)].astype(np.int64)
    return triangle, table.start[:: CELLS[2]].astype(np.int64)
