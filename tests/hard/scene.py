"""Light that is absent, hidden, or outside of the field."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.units import deg
from startrack.core.values import Light, Stars
from startrack.scene import Scene, Sight, illuminate
from startrack.scene.ephemeris import observer_of
from tests.hard.case import hard, refused

DATE = "2026-03-25T12:00:00"
CAMERA = Camera.from_field_of_view(400, 300, 20 * deg)
NOBODY = Stars(np.empty(0, int), np.empty((0, 3)), np.empty(0), np.empty(0))


def lit(scene: Scene, direction, stars: Stars = NOBODY) -> Light:
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    attitude = Rotation.from_matrix(np.array([x, np.cross(z, x), z]))
    return illuminate(scene, stars, Sight(attitude, CAMERA, 8.0, Streams(1, 0)))


def star_at(direction, colour: float = np.nan) -> Stars:
    place = np.array(direction, float).reshape(1, 3)
    return Stars(np.array([1]), place, np.array([4.0]), np.array([colour]))


@hard("scene", "no light but the stars': background, photon / s / m^2 / sr", (0, 0))
def _nothing() -> float:
    return float(lit(Scene(), np.array([1.0, 0, 0])).background.sum())


@hard("scene", "a star just behind the middle of the Moon, sources that shine like it", (0, 0))
def _behind_the_moon() -> float:
    scene = Scene(lights=("moon",), date=DATE)
    moon = observer_of(Scene(lights=("sun",), date=DATE), None).see("moon").direction
    light = lit(scene, moon, star_at(moon))
    return float((light.direction @ moon > 1 - 1e-12).sum() if len(light.direction) == 1 else 0)


@hard("scene", "a star without a colour beside one of the Sun's, ratio of photons", (0.8, 1.25))
def _colourless() -> float:
    bare, solar = (
        lit(Scene(), np.array([1.0, 0, 0]), star_at([1, 0, 0], c)).photon_irradiance.sum()
        for c in (np.nan, 0.82)
    )
    return float(bare / solar)


@hard("scene", "a light that there is not", "lights must be")
def _unknown() -> str:
    return refused(lambda: Scene(lights=("moonn",), date=DATE))
