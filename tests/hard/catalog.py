"""Places and numbers for which catalogues fail."""

from __future__ import annotations

import numpy as np

from startrack.catalog import Selection, earth_observer, open_sky
from startrack.catalog.apparent import aberrate
from startrack.core.units import LIGHT_SPEED, arcsec
from tests.hard.case import hard, refused


@hard("catalog", "aberration at 0.99 of light: half of the sky is within, deg", (8.1, 8.12))
def _fast() -> float:
    """cos = beta for a star at right angles: 8.1096 degrees from the apex."""
    seen = aberrate(np.array([[1.0, 0, 0]]), np.array([0, 0.99 * LIGHT_SPEED, 0]))
    return float(np.degrees(np.arctan2(seen[0, 0], seen[0, 1])))


@hard("catalog", "aberration of no motion, rad", (0, 0))
def _still() -> float:
    seen = aberrate(np.array([[0.6, 0.8, 0]]), np.zeros(3))
    return float(np.abs(seen - [0.6, 0.8, 0]).max())


@hard("catalog", "yearly aberration of the pole, largest of 24 dates, arcsec", (20.15, 20.85))
def _pole() -> float:
    pole = np.array([[0.0, 0.0, 1.0]])
    velocities = [earth_observer(2026 + n / 24).velocity for n in range(24)]
    return max(float(np.linalg.norm(aberrate(pole, v) - pole)) for v in velocities) / arcsec


@hard("catalog", "stars brighter than G -1: Sirius alone", (1, 1))
def _bright() -> float:
    return float((open_sky(Selection(limit_g=6.0)).stars.magnitude_g < -1.0).sum())


@hard("catalog", "directions of the whole sky are unit vectors, largest error", (0, 4e-16))
def _unit() -> float:
    direction = open_sky(Selection(limit_g=8.0)).stars.direction
    return float(np.abs(np.linalg.norm(direction, axis=1) - 1).max())


@hard("catalog", "a limit that is not a number", "must be finite, got nan")
def _limit() -> str:
    return refused(lambda: Selection(limit_g=float("nan")))
