"""A selection enters; a sky that can be asked for the stars around a direction leaves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from startrack.catalog.apparent import apparent
from startrack.catalog.bright import read_bright
from startrack.catalog.catalog import Catalog
from startrack.catalog.formats import read
from startrack.catalog.gaia_deep import deep
from startrack.catalog.observer import earth
from startrack.catalog.selection import Selection
from startrack.checks import within
from startrack.shipped import shipped
from startrack.values import Floats, Ints, Stars


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
        Errors     ValueError for a direction without length. numerical: 3e-16 rad.
        """
        return self.cones(np.asarray(direction, float)[None], radius)[0]

    def cones(self, directions: Floats, radius: float) -> list[Ints]:
        """Which stars lie within an angle of each of many directions.

        directions  (m, 3) ICRS, of any length
        radius      radian, in [0, pi]
        Returns     m arrays of indices into the stars, each brightest first
        Errors      as `cone`.
        """
        within(0, np.pi, radius=radius)
        directions = np.asarray(directions, float)
        if directions.ndim != 2 or directions.shape[1] != 3:
            raise ValueError(f"directions must have the shape (m, 3), got {directions.shape}")
        length = np.linalg.norm(directions, axis=1, keepdims=True)
        if not (np.isfinite(length).all() and (length > 0).all()):
            raise ValueError("directions must be finite and have a length, got one that has not")
        return list(self._found(directions / length, radius))

    def _found(self, unit: Floats, radius: float) -> Iterator[Ints]:
        # Chords stand for angles: exact for small ones, blunt close to pi. So a cone of more
        # than half the sky is what the opposite cone leaves over.
        small = radius <= np.pi / 2
        chord = 2 * np.sin((radius if small else np.pi - radius) / 2)
        for inside in self._tree.query_ball_point(unit if small else -unit, chord):
            places = np.sort(self._rank[inside])
            if small:
                yield self._by_brightness[places]
            elif radius == np.pi:
                yield self._by_brightness.copy()
            else:
                yield np.delete(self._by_brightness, places)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.stars.direction)

    @cached_property
    def _by_brightness(self) -> Ints:
        return np.argsort(self.stars.magnitude_g, kind="stable")

    @cached_property
    def _rank(self) -> Ints:
        rank = np.empty(len(self), np.int64)
        rank[self._by_brightness] = np.arange(len(self))
        return rank


@lru_cache(maxsize=8)
def open_sky(selection: Selection) -> Sky:
    """The sky of a selection, brightest star first; the same one for the same selection.

    Errors  FileNotFoundError, ImportError or ValueError where the catalogue cannot be read.
    """
    catalog = _catalog(selection)
    catalog = catalog[catalog.magnitude_g <= selection.limit_g]
    catalog = catalog[np.argsort(catalog.magnitude_g, kind="stable")]
    epoch = selection.epoch if selection.proper_motion else catalog.epoch
    if not (selection.aberration or selection.parallax):
        return Sky(apparent(catalog, epoch))
    observer = earth(selection.epoch, np.array(selection.orbital_velocity or (0.0, 0.0, 0.0)))
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
    return read(Path(selection.source), selection.format)
