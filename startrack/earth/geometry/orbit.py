"""Position and velocity of a satellite or an aircraft over the rotating Earth."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from startrack import core, space
from startrack.core import (
    DAY,
    FINITE,
    POSITIVE,
    Floats,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    printed,
)
from startrack.earth.terrain import cartesian, up

SPIN_VECTOR: Floats = np.array([0.0, 0.0, space.SPIN])  # rad / s


class Orbit(Parameters):
    """Mean elements of a satellite at an epoch, propagated by SGP4 without drag."""

    epoch: str = parameter("UTC, as ISO 8601")
    altitude: float = parameter(
        "semi-major axis minus the equatorial radius",
        unit=Unit("m", "km"),
        limit=POSITIVE,
        default=600e3,
    )
    inclination: float = parameter(
        "radian", unit=Unit("rad", "deg"), limit=Range(0, math.pi), default=math.radians(97.8)
    )
    node: float = parameter(
        "right ascension of the ascending node", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    anomaly: float = parameter(
        "mean anomaly, from the perigee", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    perigee: float = parameter("its argument", unit=Unit("rad", "deg"), limit=FINITE, default=0.0)
    eccentricity: float = parameter("1", limit=Range(0, 0.9), default=0.0)
    local_time: float | None = parameter(
        'mean solar time at the ascending node, as "22.5 h" or "22:30"; sets `inclination` and '
        "`node` of a Sun-synchronous orbit",
        unit=Unit("s", "h", clock=True),
        limit=Range(0, DAY),
        default=None,
    )
    day: float | None = parameter(
        "day of the year, from 1, in place of the day of `epoch`: the season as a number, which "
        "a campaign may vary",
        limit=Range(1, 367),
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        space.require_perigee(self.altitude, self.eccentricity)
        core.utc(self.epoch)
        if self.local_time is not None:
            space.sun_synchronous(space.EARTH_RADIUS + self.altitude, self.eccentricity)

    def resolved(self) -> "Orbit":
        """The orbit by elements alone, without `local_time` and `day`."""
        if self.local_time is None and self.day is None:
            return self
        return _resolved(self)

    def satellite(self) -> Any:
        """The record that SGP4 propagates."""
        angles = self.inclination, self.node, self.perigee, self.anomaly
        return space.element_record(
            self.epoch, space.EARTH_RADIUS + self.altitude, self.eccentricity, angles
        )


@lru_cache(maxsize=64)
def _resolved(orbit: Orbit) -> Orbit:
    epoch = orbit.epoch
    if orbit.day is not None:
        from astropy.time import TimeDelta

        with core.installed_tables():
            date = core.utc(epoch)
            first = core.utc(f"{date.ymdhms['year']}-01-01T00:00:00")
            clock = (date.jd1 - 0.5 + date.jd2) % 1.0
            moved = first + TimeDelta(math.floor(orbit.day - 1) + clock, format="jd")
            epoch = str(moved.isot)
    changed = replace(orbit, epoch=epoch, local_time=None, day=None)
    if orbit.local_time is None:
        return changed
    axis = space.EARTH_RADIUS + orbit.altitude
    return replace(
        changed,
        inclination=space.sun_synchronous(axis, orbit.eccentricity),
        node=space.node_at(epoch, orbit.local_time),
    )


@dataclass(frozen=True)
class TwoLines:
    """Two-line element set of a satellite, propagated by SGP4."""

    first: str
    second: str

    def __post_init__(self) -> None:
        space.require_two_lines((self.first, self.second))

    @property
    def epoch(self) -> str:
        """UTC, as ISO 8601."""
        from astropy.time import Time

        record = self.satellite()
        parts = record.jdsatepoch, record.jdsatepochF
        with core.installed_tables():
            return str(Time(*parts, format="jd", scale="utc", precision=6).isot)

    def satellite(self) -> Any:
        """The record that SGP4 propagates."""
        return space.two_line_record((self.first, self.second))


class Aircraft(Parameters):
    """A great circle at constant height, flown at constant speed over ground."""

    epoch: str = parameter("UTC, as ISO 8601")
    longitude: float = parameter("position at the epoch", unit=Unit("rad", "deg"), limit=FINITE)
    # Beyond these limits, at the poles, there is no heading.
    latitude: float = parameter(
        "position at the epoch", unit=Unit("rad", "deg"), limit=Range(-1.5, 1.5)
    )
    altitude: float = parameter(
        "above the ellipsoid", unit=Unit("m", "km"), limit=Range(1.0, 100e3), default=3e3
    )
    heading: float = parameter(
        "from north to east", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    speed: float = parameter("over ground", unit=Unit("m / s"), limit=POSITIVE, default=80.0)

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """Positions in metre and velocities over ground in metre / second, (n, 3) each, ITRS.

        Accuracy  model: a circle; its height above the ellipsoid varies by at most 5 m in 100 km.
        """
        here = np.array([self.longitude]), np.array([self.latitude])
        start = cartesian(*here, np.array([self.altitude]))[0]
        vertical = up(*here)[0]
        east = np.array([-math.sin(self.longitude), math.cos(self.longitude), 0.0])
        along = math.sin(self.heading) * east + math.cos(self.heading) * np.cross(vertical, east)
        # The centre of the circle is below the start, so that height and heading are correct there.
        radius = float(start @ vertical)
        axis = np.cross(vertical, along)
        turn = Rotation.from_rotvec(np.outer(second * self.speed / radius, axis))
        centre = start - radius * vertical
        return centre + turn.apply(radius * vertical), turn.apply(self.speed * along)


@printed
@dataclass(frozen=True, eq=False)
class Flight:
    """States of a satellite or an aircraft at given times, in Earth-fixed axes (ITRS)."""

    second: Floats  # (n,) seconds since the epoch of the orbit
    position: Floats  # (n, 3) metre
    velocity: Floats  # (n, 3) metre / second, over the rotating Earth
    inertial: Floats  # (n, 3) metre / second, relative to the stars, in the same axes
    # (n, 3) metre / second, direction of flight of `Pointing`: relative to the stars for a
    # satellite, over ground for an aircraft.
    course: Floats
    icrs_to_itrs: Rotation  # (n,) rotations


Carrier = Orbit | TwoLines | Aircraft  # carriers of a camera


def choose_carrier(orbit: Orbit | None, tle: tuple[str, ...], aircraft: Aircraft | None) -> Carrier:
    """The carrier of a scene: orbit, two-line elements or aircraft.

    Raises  ValueError if the scene gives none or several."""
    if (orbit is not None) + bool(tle) + (aircraft is not None) != 1:
        raise ValueError("exactly one of orbit, tle and aircraft must be given")
    if orbit is not None:
        return orbit.resolved()
    if aircraft is not None:
        return aircraft
    if len(tle) != 2:
        raise ValueError(f"tle must be two lines, got {len(tle)}")
    return TwoLines(*tle)


def fly(orbit: Carrier, second: Floats) -> Flight:
    """States of a satellite or an aircraft at (n,) seconds after the epoch.

    Source: SGP4 (Vallado et al. 2006) by the package sgp4; axes by astropy (ERFA).

    Raises    ValueError if SGP4 fails, with its reason; ImportError without sgp4
    Accuracy  model: SGP4 errs by a kilometre near the epoch. Dates beyond the installed Earth
              orientation add less than 0.84 km on the ground (`startrack.dates`).
    """
    second = np.asarray(second, float)
    if isinstance(orbit, Orbit):
        orbit = orbit.resolved()
    if isinstance(orbit, Aircraft):
        where, velocity = orbit.state(second)
        inertial = velocity + np.cross(SPIN_VECTOR, where)
        (icrs_to_itrs,) = space.to_itrs(("GCRS",), orbit.epoch, second)
        return Flight(second, where, velocity, inertial, velocity, icrs_to_itrs)
    teme_to_itrs, icrs_to_itrs = space.to_itrs(("TEME", "GCRS"), orbit.epoch, second)
    date = core.utc(orbit.epoch)
    dates = np.full(len(second), date.jd1), date.jd2 + second / DAY
    state = space.propagate(orbit.satellite(), dates, "the orbit")
    where, inertial = (teme_to_itrs.apply(values) for values in state)
    return Flight(
        second, where, inertial - np.cross(SPIN_VECTOR, where), inertial, inertial, icrs_to_itrs
    )


@lru_cache(maxsize=64)
def sun_zenith_below(carrier: Carrier, latitude: float, ascending: bool) -> float:
    """Zenith angle of the Sun (radian) at the ground below a satellite as it passes a latitude.

    latitude   radian, geodetic
    ascending  whether it flies north at the latitude
    Raises     ValueError for an aircraft, and where the orbit does not reach the latitude.
    Accuracy   model: node and date of the epoch, ground track on a sphere: 0.3 degree.
    """
    if isinstance(carrier, Aircraft):
        raise Refused("retrieval.latitude must be left out of a scene with an aircraft")
    record = carrier.satellite()
    tilt, node = float(record.inclo), float(record.nodeo)
    ratio = math.sin(latitude) / math.sin(tilt) if math.sin(tilt) else math.inf
    if not abs(ratio) <= 1:
        raise Refused(
            f"retrieval.latitude must be within reach of the orbit, at most "
            f"{min(tilt, math.pi - tilt) / core.deg:.2f} deg, got {latitude / core.deg:g} deg"
        )
    argument = math.asin(ratio) if ascending else math.pi - math.asin(ratio)
    x, y, _ = space.orbit_direction(node, tilt, argument)
    over = math.atan2(y, x)
    flat = math.cos(latitude)
    zenith = np.array([flat * math.cos(over), flat * math.sin(over), math.sin(latitude)])
    (teme_to_itrs,) = space.to_itrs(("TEME",), carrier.epoch, np.zeros(1))
    sun = teme_to_itrs[0].inv().apply(space.sun_direction(carrier.epoch).copy())
    return math.acos(float(np.clip(zenith @ sun, -1, 1)))
