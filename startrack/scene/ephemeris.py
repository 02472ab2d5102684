"""Scene, Streams -> observer, and positions of the bodies of the solar system seen from there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache

import numpy as np

from startrack.core import Floats, Streams, installed_tables
from startrack.scene.parameters import J2000 as J2000_UTC
from startrack.scene.parameters import JULIAN_YEAR, Orbit, Scene
from startrack.space import (
    EARTH_RADIUS,
    GM,
    J2000,
    Body,
    barycentric,
    orbit_direction,
    seen_from,
)


@dataclass(frozen=True, eq=False)
class Observer:
    """Date and position of the observer.

    day       Julian day, TDB
    position  (3,) metre from the solar system's barycentre, ICRS axes
    earth     (3,) metre from the observer to the Earth's centre
    """

    day: float
    position: Floats
    earth: Floats

    @property
    def year(self) -> float:
        """Julian year."""
        return 2000 + (self.day - J2000) / 365.25

    def see(self, name: str) -> Body:
        """A body, or the Sun, by its name; see `startrack.space.seen_from`."""
        return seen_from(self.position, self.day, name)


def observer_of(scene: Scene, streams: Streams | None) -> Observer:
    """The observer of one trial.

    streams  of the trial; needed only where the scene draws a date or a phase of the orbit
    Raises   TypeError where they are needed and missing.
    """
    day = _start_day(scene)
    if scene.days:
        day += scene.days * _draw(streams, "date")
    earth = barycentric("earth", day)
    if scene.place is not None:
        position = np.array(scene.place)
    elif scene.orbit:
        phase = scene.orbit.phase
        phase = 2 * math.pi * _draw(streams, "orbit") if phase is None else phase
        position = earth + on_orbit(scene.orbit, phase)
    else:
        position = earth
    return Observer(day, position, earth - position)


def on_orbit(orbit: Orbit, phase: float) -> Floats:
    """(3,) metre from the Earth's centre, ICRS axes."""
    radius = EARTH_RADIUS + orbit.altitude
    return radius * orbit_direction(orbit.node, orbit.inclination, phase)


def orbital_velocity(orbit: Orbit, phase: float) -> Floats:
    """(3,) m/s against the Earth's centre, ICRS axes.

    Accuracy  model: a circular orbit of two bodies, 0.1 % of the speed of a low one.
    """
    speed = math.sqrt(GM / (EARTH_RADIUS + orbit.altitude))
    return speed * orbit_direction(orbit.node, orbit.inclination, phase + math.pi / 2)


@lru_cache(maxsize=64)
def _start_day(scene: Scene) -> float:
    """Julian day, TDB."""
    from astropy.time import Time  # costs 0.5 s, and only dated scenes need it

    with installed_tables():
        return float(Time(scene.start.replace(tzinfo=None), scale="utc").tdb.jd)


def date_of(scene: Scene, year: float, streams: Streams | None = None) -> datetime:
    """UTC of a trial: that of its scene, or of the Julian year that the sky is seen in.

    streams  of the trial; needed only where the scene draws a date
    """
    if scene.date is None:
        return J2000_UTC + (year - 2000) * JULIAN_YEAR
    days = scene.days * _draw(streams, "date") if scene.days else 0.0
    return scene.start + timedelta(days=days)


def _draw(streams: Streams | None, cause: str) -> float:
    if streams is None:
        raise TypeError(f"streams must be given where the {cause} is drawn, got None")
    return float(streams(cause).random())
