"""Simulated fields: the spots of a perfect detector and detection."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.core import Floats
from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.core.values import Matches, Spots, Stars
from startrack.identification import Identification, PatternIndex, build_index, identify
from startrack.identification.index import WIDEST

SETTINGS = Identification()


def make_spots(pixel: Floats, sigma: float) -> Spots:
    """Spots at these pixels (n, 2), brightest first, with the covariance of their noise."""
    n = len(pixel)
    x, y = np.array(pixel, float).reshape(-1, 2).T.copy()
    covariance = np.tile(np.eye(2) * max(sigma, 0.01) ** 2, (n, 1, 1))
    flux = np.geomspace(1e5, 1e3, n) if n else np.empty(0)
    return Spots(x, y, flux, covariance, np.full(n, 50.0), np.full(n, 9))


@dataclass(frozen=True, eq=False)
class Seen:
    """Spots, and the index of the true star of each; -1 for none."""

    spots: Spots
    star: NDArray[np.int64]
    icrs_to_camera: Rotation
    camera: Camera

    def error(self, matches: Matches) -> float:
        """Pixel, distance of the found boresight from the true one; infinite if none was found."""
        if matches.icrs_to_camera is None:
            return np.inf
        found = matches.icrs_to_camera.apply(self.icrs_to_camera.inv().apply([0.0, 0.0, 1.0]))
        angle = np.arctan2(np.hypot(found[0], found[1]), found[2])
        return float(angle * self.camera.focal_length_px)


@dataclass(frozen=True, eq=False)
class Design:
    """A camera, the catalogue of its tracker, and the magnitude of the faintest detected star."""

    camera: Camera
    stars: Stars
    index: PatternIndex
    limit_g: float

    def solve(self, spots: Spots, settings: Identification = SETTINGS) -> Matches:
        return identify(spots, self.camera, self.stars, self.index, settings)

    def look(
        self,
        rng: np.random.Generator,
        *,
        noise: float = 0.2,
        false: int = 0,
        missing: float = 0.0,
        magnitude_noise: float = 0.3,
        attitude: Rotation | None = None,
    ) -> Seen:
        """A sky: true stars displaced by noise (pixel), some missing, and false spots among
        them."""
        camera, stars = self.camera, self.stars
        icrs_to_camera = attitude or Rotation.from_quat(rng.standard_normal(4))
        direction = icrs_to_camera.apply(stars.direction)
        pixel = camera.project(direction)
        # Far outside the field a distortion polynomial folds back into the image.
        ahead = direction[:, 2] > np.cos(1.1 * camera.half_diagonal)
        star = np.flatnonzero(ahead & camera.holds(pixel))
        magnitude = stars.magnitude_g[star] + magnitude_noise * rng.standard_normal(len(star))
        kept = (magnitude < self.limit_g) & (rng.random(len(star)) >= missing)
        star, magnitude = star[kept], magnitude[kept]
        pixel = pixel[star] + noise * rng.standard_normal((len(star), 2))
        anywhere = rng.random((false, 2)) * [camera.columns, camera.rows] - 0.5
        magnitude = np.append(magnitude, rng.choice(magnitude, false) if len(star) else [])
        brightest = np.argsort(magnitude, kind="stable")
        pixel = np.concatenate([pixel, anywhere[: len(magnitude) - len(star)]])[brightest]
        star = np.append(star, np.full(len(magnitude) - len(star), -1))[brightest]
        return Seen(make_spots(pixel, noise), star, icrs_to_camera, camera)


@lru_cache
def make_design(field_deg: float, limit_g: float, margin: float = 1.0) -> Design:
    """A square camera of 1024 pixels; its catalogue is deeper than its limit by a margin."""
    camera = Camera.from_field_of_view(1024, 1024, field_deg * deg)
    stars = open_sky(Selection(limit_g=limit_g + margin)).stars
    return Design(camera, stars, build_index(stars, min(field_deg * deg, WIDEST)), limit_g)


@pytest.fixture(scope="session")
def design() -> Callable[..., Design]:
    return make_design


@pytest.fixture(scope="session")
def spots_at() -> Callable[..., Spots]:
    return make_spots


def point(direction: Floats, roll: float = 0.3) -> Rotation:
    """The attitude whose boresight points in this direction (3,)."""
    z = np.array(direction, float) / np.linalg.norm(direction)
    x = np.cross(z, [0.3, -0.5, 0.81])
    x /= np.linalg.norm(x)
    turn = Rotation.from_matrix(np.array([x, np.cross(z, x), z]))
    return Rotation.from_rotvec([0, 0, roll]) * turn


@pytest.fixture(scope="session")
def towards() -> Callable[..., Rotation]:
    return point
