"""Selection -> Sky, which finds the stars around a direction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from startrack.catalog.apparent import apparent, earth_observer
from startrack.catalog.catalog import Catalog, join
from startrack.catalog.formats import read
from startrack.catalog.gaia import deep, read_bright
from startrack.catalog.random_stars import random_stars
from startrack.catalog.selection import Selection
from startrack.core import Floats, Ints, Refused, Stars, kept, kernel, within
from startrack.io import shipped

SLACK = 1e-12  # of a height, so that rounding leaves no star out


@dataclass(frozen=True, eq=False)
class Sky:
    """Stars that are found by direction.

    stars  the stars, in any order
    """

    stars: Stars

    def __len__(self) -> int:
        return len(self.stars)

    def cone(self, direction: Floats, radius: float) -> Ints:
        """Which stars lie within an angle of a direction.

        direction  (3,) ICRS, of any length
        radius     radian, in [0, pi]
        Returns    (k,) indices into the stars, brightest first
        Raises     ValueError for a direction without length.
        Accuracy   numerical: 3e-16 rad.
        """
        within(0, np.pi, radius=radius)
        length = math.hypot(*direction)
        if not 0 < length < math.inf:
            raise Refused("directions must be finite and have a length, got one that has not")
        unit = np.asarray(direction, float) / length
        return self._by_brightness[np.sort(_around(*self._by_height, unit, radius))]

    def cones(self, directions: Floats, radius: float) -> list[Ints]:
        """Which stars lie within an angle of each of many directions.

        directions  (m, 3) ICRS, of any length
        radius      radian, in [0, pi]
        Returns     m arrays of indices into the stars, each brightest first
        Raises      as `cone`.
        """
        directions = np.asarray(directions, float)
        if directions.ndim != 2 or directions.shape[1] != 3:
            raise Refused(f"directions must have the shape (m, 3), got {directions.shape}")
        return [self.cone(each, radius) for each in directions]

    @cached_property
    def _by_brightness(self) -> Ints:
        return np.argsort(self.stars.magnitude_g, kind="stable")

    @cached_property
    def _by_height(self) -> tuple[Floats, Ints]:
        """Directions in order of their last coordinate, and which star by brightness each is."""
        rank = np.empty(len(self), np.int64)
        rank[self._by_brightness] = np.arange(len(self))
        order = np.argsort(self.stars.direction[:, 2])
        return np.ascontiguousarray(self.stars.direction[order]), rank[order]


@kernel
def _around(direction, rank, centre, radius):  # type: ignore[no-untyped-def]
    """The ranks of the directions within an angle of a centre.

    Angles are compared by their chords, which are exact for small angles and insensitive close to
    pi. Beyond a right angle, the chord to the opposite point is compared instead.
    """
    wide = radius > math.pi / 2
    chord = 2 * math.sin((math.pi - radius if wide else radius) / 2)
    first, last = belt(direction, centre[2], radius)
    found = np.empty(last - first, np.int64)
    count = 0
    for k in range(first, last):
        square = 0.0
        for axis in range(3):
            apart = direction[k, axis] + centre[axis] if wide else direction[k, axis] - centre[axis]
            square += apart * apart
        if (square > chord * chord or radius == math.pi) if wide else square <= chord * chord:
            found[count] = rank[k]
            count += 1
    return found[:count]


@kernel
def belt(direction, height, radius):  # type: ignore[no-untyped-def]
    """The first and the last of directions in order of height that a circle's heights span.

    direction  (n, 3) unit vectors, in order of their last coordinate
    height     last coordinate of the circle's centre;  radius  radian
    Returns    places from the first on, and before the last
    """
    middle = math.asin(min(max(height, -1.0), 1.0))
    low = math.sin(max(middle - radius, -math.pi / 2)) - SLACK
    high = math.sin(min(middle + radius, math.pi / 2)) + SLACK
    return _first_from(direction, low), _first_from(direction, high)


@kernel
def _first_from(direction, height):  # type: ignore[no-untyped-def]
    """The place of the first direction of at least this height."""
    low, high = 0, len(direction)
    while low < high:
        middle = (low + high) // 2
        if direction[middle, 2] < height:
            low = middle + 1
        else:
            high = middle
    return low


@kept(8)
def open_sky(selection: Selection) -> Sky:
    """The sky of a selection, brightest star first; the same one for the same selection.

    Raises  FileNotFoundError, ImportError or ValueError where the catalogue cannot be read.
    """
    catalog = _catalog(selection)
    catalog = catalog[catalog.magnitude_g <= selection.limit_g]
    if selection.random_g is not None:
        fainter = random_stars(catalog, selection.limit_g, selection.random_g)
        catalog = join(catalog, fainter)
    catalog = catalog[np.argsort(catalog.magnitude_g, kind="stable")]
    epoch = selection.year if selection.proper_motion else catalog.epoch
    if not (selection.aberration or selection.parallax):
        return Sky(apparent(catalog, epoch))
    observer = earth_observer(
        selection.year, np.array(selection.orbital_velocity or (0.0, 0.0, 0.0))
    )
    return Sky(
        apparent(
            catalog,
            epoch,
            observer.position if selection.parallax else None,
            observer.velocity if selection.aberration else None,
        )
    )


def _catalog(selection: Selection) -> Catalog:
    if selection.source == "bright":
        return read_bright(shipped("stars/bright.fits"))
    if selection.source == "deep":
        return deep()
    return read(Path(selection.source), selection.format, selection.columns)
