"""Scene, Streams -> observer, and positions of the bodies of the solar system seen from there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache

import numpy as np

from startrack.core import LIGHT_SPEED, Floats, Streams, installed_tables
from startrack.scene.parameters import J2000 as J2000_UTC
from startrack.scene.parameters import JULIAN_YEAR, Orbit, Scene

AU = 149_597_870_700.0  # metre, IAU 2012
EARTH_RADIUS = 6_378_137.0  # metre, WGS 84 at the equator
EARTH_GM = 3.986004418e14  # m^3 / s^2, WGS 84
DAY = 86400.0  # second
J2000 = 2451545.0  # Julian day


@dataclass(frozen=True, eq=False)
class Body:
    """A body, seen by the observer.

    direction  (3,) unit vector, ICRS axes
    distance   metre from the observer
    sun        (3,) metre from the body to the Sun
    """

    direction: Floats
    distance: float
    sun: Floats

    @property
    def sun_distance(self) -> float:
        """Metre from the Sun."""
        return float(np.linalg.norm(self.sun))

    @property
    def phase_angle(self) -> float:
        """Radian, angle between the Sun and the observer, seen from the body."""
        cosine = float(-self.direction @ self.sun) / self.sun_distance
        return math.acos(min(max(cosine, -1.0), 1.0))


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
        """A body, or the Sun, at the time when its light was emitted.

        name      "sun", "moon", or a planet
        Accuracy  model: no aberration (21 arcsec), no light deflection. numerical: astropy's
                  built-in ephemeris: Sun 1 arcsec, Moon 10 arcsec, planets 40 arcsec between 1900
                  and 2100.
        """
        late = 0.0
        for _ in range(2):
            there = _barycentric(name, self.day - late / DAY)
            line = there - self.position
            late = float(np.linalg.norm(line)) / LIGHT_SPEED
        distance = float(np.linalg.norm(line))
        sun = _barycentric("sun", self.day - late / DAY) - there
        return Body(line / distance, distance, sun)


def observer_of(scene: Scene, streams: Streams | None) -> Observer:
    """The observer of one trial.

    streams  of the trial; needed only where the scene draws a date or a phase of the orbit
    Raises   TypeError where they are needed and missing.
    """
    day = _start_day(scene)
    if scene.days:
        day += scene.days * _draw(streams, "date")
    earth = _barycentric("earth", day)
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
    return (EARTH_RADIUS + orbit.altitude) * _on_unit_orbit(orbit, phase)


def orbital_velocity(orbit: Orbit, phase: float) -> Floats:
    """(3,) m/s against the Earth's centre, ICRS axes.

    Accuracy  model: a circular orbit of two bodies, 0.1 % of the speed of a low one.
    """
    speed = math.sqrt(EARTH_GM / (EARTH_RADIUS + orbit.altitude))
    return speed * _on_unit_orbit(orbit, phase + math.pi / 2)


def _on_unit_orbit(orbit: Orbit, phase: float) -> Floats:
    """(3,) unit vector from the Earth's centre."""
    along, across = math.cos(phase), math.sin(phase)
    node, tilt = orbit.node, orbit.inclination
    return np.array(
        [
            along * math.cos(node) - across * math.cos(tilt) * math.sin(node),
            along * math.sin(node) + across * math.cos(tilt) * math.cos(node),
            across * math.sin(tilt),
        ]
    )


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


@lru_cache(maxsize=256)
def _barycentric(name: str, day: float) -> Floats:
    """(3,) metre, ICRS axes, read-only."""
    from astropy import units
    from astropy.coordinates import get_body_barycentric
    from astropy.time import Time

    with installed_tables():
        date = Time(day, format="jd", scale="tdb")
        position = get_body_barycentric(name, date, ephemeris="builtin")
    metre = np.array(position.xyz.to_value(units.m))
    metre.flags.writeable = False
    return metre


def _draw(streams: Streams | None, cause: str) -> float:
    if streams is None:
        raise TypeError(f"streams must be given where the {cause} is drawn, got None")
    return float(streams(cause).random())
