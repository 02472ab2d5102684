"""DaySky and date -> where the Moon stands, and how bright it is."""

import math

import numpy as np

from startrack.core import Floats
from startrack.scene.bodies import moon_irradiance
from startrack.scene.day_sky import DaySky, SunPlace, horizon_axes
from startrack.space import AU, EARTH_RADIUS, moon_position, sun_direction


def moonlight(sky: DaySky, date: str) -> tuple[SunPlace, Floats]:
    """Where the Moon stands above a dated sky, and its photons (bins,) / s / m^2 without air.

    Accuracy  model: that of `moon_irradiance`; the place to 0.2 degrees, for a spherical Earth.
    """
    axes = horizon_axes(sky.latitude or 0.0, sky.longitude or 0.0)
    line = moon_position(date) - (EARTH_RADIUS + sky.height) * axes[:, 2]
    distance = float(np.linalg.norm(line))
    sun = sun_direction(date) * AU - line
    towards = line @ axes / distance
    apart = float(np.linalg.norm(sun))
    phase = math.acos(min(max(float(-line @ sun) / distance / apart, -1.0), 1.0))
    place = SunPlace(math.asin(float(towards[2])), sky.distance_of(towards))
    return place, moon_irradiance(phase, distance, apart)
