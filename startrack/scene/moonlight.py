"""DaySky and date -> the place of the Moon, and its irradiance."""

import math

import numpy as np

from startrack.core import Floats
from startrack.scene.bodies import moon_irradiance
from startrack.scene.day_sky import DaySky, SunPlace
from startrack.space import AU, EARTH_RADIUS, horizon_axes, moon_position, sun_direction


def moonlight(sky: DaySky, date: str) -> tuple[SunPlace, Floats]:
    """The place of the Moon above a dated sky, and its light without air.

    Returns   its place; (bins,) photon / s / m^2
    Accuracy  model: that of `moon_irradiance`; the place to 0.2 degrees, for a spherical Earth.
    """
    axes = horizon_axes(sky.latitude or 0.0, sky.longitude or 0.0)
    to_moon = moon_position(date) - (EARTH_RADIUS + sky.height) * axes[:, 2]
    distance = float(np.linalg.norm(to_moon))
    moon_to_sun = sun_direction(date) * AU - to_moon
    sun_distance = float(np.linalg.norm(moon_to_sun))
    cosine = float(-to_moon @ moon_to_sun) / distance / sun_distance
    phase_angle = math.acos(min(max(cosine, -1.0), 1.0))
    towards = to_moon @ axes / distance
    place = SunPlace(math.asin(float(towards[2])), sky.distance_of(towards))
    return place, moon_irradiance(phase_angle, distance, sun_distance)
