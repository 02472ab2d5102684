"""Dates -> Sun, Moon, planets and axes of the Earth: one at a time, and as tables over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import DAY, LIGHT_SPEED, Floats, installed_tables, read_only, utc

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

AU = 149_597_870_700.0  # metre, IAU 2012

J2000 = 2451545.0  # Julian day
FIRST_YEAR, LAST_YEAR = 1900, 2100  # of the ephemeris
PLANETS = ("mercury", "venus", "mars", "jupiter", "saturn")  # in the tables of a mission
KNOT = 0.125 * DAY  # second between two entries of the tables
SIDEREAL = math.tau * 1.00273790935 / DAY  # radian / second
PAD = 4  # entries beyond both ends, where a cubic spline is worse


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


def seen_from(position: Floats, day: float, name: str) -> Body:
    """A body, or the Sun, at the time when its light was emitted.

    position  (3,) metre, of the observer from the solar system's barycentre, ICRS axes
    day       Julian day, TDB
    name      "sun", "moon", or a planet
    Accuracy  model: no aberration (21 arcsec), no light deflection. numerical: astropy's
              built-in ephemeris: Sun 1 arcsec, Moon 10 arcsec, planets 40 arcsec between 1900
              and 2100.
    """
    late = 0.0
    for _ in range(2):
        there = barycentric(name, day - late / DAY)
        line = there - position
        late = float(np.linalg.norm(line)) / LIGHT_SPEED
    distance = float(np.linalg.norm(line))
    sun = barycentric("sun", day - late / DAY) - there
    return Body(line / distance, distance, sun)


@lru_cache(maxsize=256)
def barycentric(name: str, day: float) -> Floats:
    """(3,) metre from the solar system's barycentre, ICRS axes, read-only; at a Julian day, TDB."""
    from astropy.time import Time

    with installed_tables():
        return read_only(_barycentric(name, Time(day, format="jd", scale="tdb")))


def _barycentric(name: str, date: Any) -> Floats:
    """(3,) or (n, 3) metre, by astropy's built-in ephemeris."""
    from astropy import units
    from astropy.coordinates import get_body_barycentric

    position = get_body_barycentric(name, date, ephemeris="builtin")
    return np.array(position.xyz.to_value(units.m)).T


@dataclass(frozen=True, eq=False)
class Bodies:
    """Sun, Moon, planets, velocity and axes of the Earth at SI seconds after a mission's begin.

    `table` has 19 columns: Sun and Moon (metre from the Earth's centre at the time when their
    light was emitted, ICRS axes), the Earth's velocity (m / s, barycentric), the rows of the matrix
    teme_to_icrs, and the part of Greenwich's mean sidereal time (radian, IAU 1982) that is not
    steady. `planets` has unit vectors.

    Accuracy  model: astropy's built-in ephemeris: Sun 1 arcsec, Moon 10 arcsec, planets 40 arcsec
              between 1900 and 2100. numerical: 0.02 arcsec between the entries of the tables.
    """

    table: CubicSpline
    planets: CubicSpline

    def at(self, second: Floats) -> Floats:
        """(19, n) columns of the table."""
        return np.ascontiguousarray(self.table(second).T)

    def planets_at(self, second: Floats) -> Floats:
        """(5, 3, n) unit vectors in the order of PLANETS, from the Earth's centre."""
        return np.ascontiguousarray(self.planets(second).T).reshape(len(PLANETS), 3, -1)


class BodyStates(NamedTuple):
    """Sun, Moon and the Earth's axes at n instants.

    sun, moon       (3, n) metre from the Earth's centre, ICRS axes
    earth_velocity  (3, n) metre / second, barycentric
    teme_to_icrs    (3, 3, n) matrices
    greenwich       (n,) radian, mean sidereal time
    """

    sun: Floats
    moon: Floats
    earth_velocity: Floats
    teme_to_icrs: Floats
    greenwich: Floats


def body_states(columns: Floats, second: Floats) -> BodyStates:
    """The states of (19, n) columns of a table of `Bodies` at (n,) seconds."""
    axes = columns[9:18].reshape(3, 3, -1)
    greenwich = columns[18] + SIDEREAL * second
    return BodyStates(columns[0:3], columns[3:6], columns[6:9], axes, greenwich)


def bodies_of(begin: str, duration: float) -> Bodies:
    """The tables for a mission, with eight entries a day; each takes up to a millisecond."""
    from scipy.interpolate import CubicSpline  # 0.1 s; only missions need it

    count = math.ceil(duration / KNOT) + 1 + 2 * PAD
    second = KNOT * (np.arange(count) - PAD)
    with installed_tables():
        from astropy import units

        date = utc(begin) + second * units.s
        day = date.tdb
        earth = _barycentric("earth", day)
        seen = [_seen_from_earth(name, day, earth) for name in ("sun", "moon", *PLANETS)]
        axes = rotation_matrices("TEME", "GCRS", date)
        greenwich = date.sidereal_time("mean", "greenwich", model="IAU1982").rad
    path = CubicSpline(second, earth)
    steady = np.unwrap(greenwich - SIDEREAL * second)
    table = [*seen[:2], path(second, 1), axes.reshape(-1, 9), steady[:, None]]
    planets = [line / np.linalg.norm(line, axis=1, keepdims=True) for line in seen[2:]]
    return Bodies(*(CubicSpline(second, np.concatenate(part, 1)) for part in (table, planets)))


def _seen_from_earth(name: str, day: Any, earth: Floats) -> Floats:
    """(n, 3) metre from the Earth's centre to a body when its light was emitted."""
    from astropy import units

    late = np.zeros(len(earth))
    for _ in range(2):  # the second is (v / c)^2 off, 0.002 arcsec
        emitted = day - late * units.s
        line = _barycentric(name, emitted) - earth
        late = np.linalg.norm(line, axis=1) / LIGHT_SPEED
    return line


def rotation_matrices(source: str, target: str, date: Any) -> Floats:
    """(n, 3, 3) matrices source_to_target at n dates, between two of astropy's frames (ERFA)."""
    from astropy import coordinates, units

    dates = np.repeat(date, 3)
    count = len(dates) // 3
    unit = coordinates.CartesianRepresentation(np.tile(np.eye(3), count) * units.m)
    first, second = (getattr(coordinates, name) for name in (source, target))
    with installed_tables():
        turned = first(unit, obstime=dates).transform_to(second(obstime=dates)).cartesian.xyz.value
    # The columns of each matrix are the images of the three axes.
    return np.asarray(turned.reshape(3, count, 3).transpose(1, 0, 2))


def to_itrs(frames: tuple[str, ...], epoch: str, second: Floats) -> list[Rotation]:
    """Rotations of astropy's frames to ITRS, each at (n,) seconds after an epoch, UTC."""
    from astropy import units

    with installed_tables():
        date = utc(epoch) + second * units.s
        return [Rotation.from_matrix(rotation_matrices(name, "ITRS", date)) for name in frames]


@lru_cache(maxsize=64)
def distance_to_sun(epoch: str) -> float:
    """Astronomical unit between the centres of the Earth and the Sun.

    Accuracy  model: astropy's built-in ephemeris, 1e-6.
    """
    from astropy.coordinates import get_body

    with installed_tables():
        return float(get_body("sun", utc(epoch)).distance.au)


@lru_cache(maxsize=64)  # all channels of a scene ask for the same
def sun_direction(epoch: str, second: float = 0.0) -> Floats:
    """Unit vector (3,) towards the Sun in ITRS, seen from the Earth's centre; read-only.

    Accuracy  model: astropy's built-in ephemeris, 3 arcsec; 9 arcsec of parallax are neglected.
    """
    there = _in_earth_axes("sun", epoch, second).value
    return read_only(there / np.linalg.norm(there))


@lru_cache(maxsize=64)
def moon_position(epoch: str) -> Floats:
    """Metre (3,) from the Earth's centre to the Moon in ITRS; read-only.

    Accuracy  model: astropy's built-in ephemeris, 20 arcsec.
    """
    return read_only(_in_earth_axes("moon", epoch).to_value("m"))


def _in_earth_axes(name: str, epoch: str, second: float = 0.0) -> Any:
    """Place (3,) of a body in ITRS from the Earth's centre, a length of astropy."""
    from astropy import units
    from astropy.coordinates import ITRS, get_body

    with installed_tables():
        date = utc(epoch) + second * units.s
        return get_body(name, date).transform_to(ITRS(obstime=date)).cartesian.xyz
