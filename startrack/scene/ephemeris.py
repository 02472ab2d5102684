"""Scene, Streams -> the observer, and angles from boresights to Sun, Moon and the Earth's limb."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache

import numpy as np

from startrack.core import DAY, YEAR, Floats, Streams, installed_tables
from startrack.scene.parameters import J2000 as J2000_UTC
from startrack.scene.parameters import JULIAN_YEAR, ObserverOrbit, Scene
from startrack.space import EARTH_RADIUS, GM, J2000, Body, barycentric, orbit_direction, seen_from

BODIES = ("sun", "moon", "earth")


@dataclass(frozen=True, eq=False)
class SkyObserver:
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
        return 2000 + (self.day - J2000) / (YEAR / DAY)

    def see(self, name: str) -> Body:
        """A body, or the Sun, by its name; see `startrack.space.seen_from`."""
        return seen_from(self.position, self.day, name)


def observer_of(scene: Scene, streams: Streams | None) -> SkyObserver:
    """The observer of one trial.

    streams  of the trial; needed only if the scene draws a date or a phase of the orbit
    Raises   TypeError if they are needed and missing.
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
    return SkyObserver(day, position, earth - position)


def on_orbit(orbit: ObserverOrbit, phase: float) -> Floats:
    """(3,) metre from the Earth's centre, ICRS axes."""
    radius = EARTH_RADIUS + orbit.altitude
    return radius * orbit_direction(orbit.node, orbit.inclination, phase)


def orbital_velocity(orbit: ObserverOrbit, phase: float) -> Floats:
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
    """UTC of a trial: the date of its scene, or of the Julian year of its sky.

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


def body_angles(scene: Scene, seed: int, trials: Sequence[int], boresight: Floats) -> Floats:
    """Radian from the boresight to the centres of Sun and Moon, and to the Earth's limb.

    The scene need not have the light of these bodies. Negative in front of the Earth.

    seed, trials  (n,) by which date and orbit are drawn, if each trial draws them
    boresight     (n, 3) unit vectors, ICRS axes
    Returns       (n, 3) in the order of BODIES; NaN without a date, or without an orbit
    Accuracy      model: that of `SkyObserver.see`; a spherical Earth.
    """
    angles = np.full((len(trials), len(BODIES)), math.nan)
    if scene.date is None:
        return angles
    each_draws = scene.days > 0 or (scene.orbit is not None and scene.orbit.phase is None)
    groups = [slice(n, n + 1) for n in range(len(trials))] if each_draws else [slice(None)]
    for group in groups if len(trials) else []:
        observer = observer_of(scene, Streams(seed, trials[group.start or 0]))
        for k, name in enumerate(("sun", "moon")):
            angles[group, k] = _angles(boresight[group], observer.see(name).direction)
        if scene.orbit is not None:
            distance = float(np.linalg.norm(observer.earth))
            limb = math.asin(min(EARTH_RADIUS / distance, 1.0))
            angles[group, 2] = _angles(boresight[group], observer.earth / distance) - limb
    return angles


def _angles(lines: Floats, direction: Floats) -> Floats:
    """Radian (n,) between unit vectors (n, 3) and another one."""
    return 2 * np.arcsin(np.minimum(np.linalg.norm(lines - direction, axis=1) / 2, 1.0))
