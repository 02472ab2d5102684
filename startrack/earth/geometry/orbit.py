"""Position and velocity of a satellite or an aircraft over the Earth; direction of the Sun."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core import FINITE, POSITIVE, Floats, Parameters, Range, Unit, installed_tables, utc
from startrack.earth.terrain import EQUATORIAL, cartesian, up

GRAVITY = 398600.8e9  # m^3 / s^2, WGS72, as SGP4 wants it (Vallado et al. 2006, AIAA 2006-6753)
DAY = 86400.0
SPIN: Floats = np.array([0.0, 0.0, 7.292115146706979e-5])  # rad / s, IERS conventions 2010
EPOCH_1949 = 2433281.5  # Julian date from which SGP4 counts its days


@dataclass(frozen=True)
class Orbit(Parameters):
    """A satellite by its mean elements at an epoch, moved by SGP4 without drag."""

    epoch: Annotated[str, "UTC, as ISO 8601"]
    altitude: Annotated[float, Unit("m", "km"), POSITIVE,
        "semi-major axis minus the equatorial radius"] = 600e3  # fmt: skip
    inclination: Annotated[float, Unit("rad", "deg"), Range(0, math.pi),
        "radian"] = math.radians(97.8)  # fmt: skip
    node: Annotated[float, Unit("rad", "deg"), FINITE,
        "right ascension of the ascending node"] = 0.0  # fmt: skip
    anomaly: Annotated[float, Unit("rad", "deg"), FINITE, "mean, from the perigee"] = 0.0
    perigee: Annotated[float, Unit("rad", "deg"), FINITE, "its argument"] = 0.0
    eccentricity: Annotated[float, Range(0, 0.9), "1"] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (EQUATORIAL + self.altitude) * (1 - self.eccentricity) < EQUATORIAL + 80e3:
            raise ValueError(
                "altitude and eccentricity must keep the perigee above 80 km, got "
                f"{self.altitude / 1e3:g} km and {self.eccentricity:g}"
            )
        utc(self.epoch)

    def satellite(self) -> Any:
        """The record that SGP4 moves."""
        from sgp4.api import WGS72, Satrec

        axis = EQUATORIAL + self.altitude
        record, date = Satrec(), utc(self.epoch)
        record.sgp4init(
            WGS72, "i", 1, (date.jd1 - EPOCH_1949) + date.jd2, 0.0, 0.0, 0.0, self.eccentricity,
            self.perigee % math.tau, self.inclination, self.anomaly % math.tau,
            60 * math.sqrt(GRAVITY / axis**3), self.node % math.tau,
        )  # fmt: skip
        return record


@dataclass(frozen=True)
class TwoLines:
    """A satellite by its two-line element set, moved by SGP4."""

    first: str
    second: str

    def __post_init__(self) -> None:
        for number, line in ((1, self.first), (2, self.second)):
            if len(line) != 69 or not line.startswith(f"{number} "):
                raise ValueError(f"line {number} must be 69 characters long, got {line!r}")
            if _checksum(line) != line[-1]:
                raise ValueError(
                    f"line {number} must end in its checksum {_checksum(line)}, got {line!r}"
                )

    @property
    def epoch(self) -> str:
        """UTC, as ISO 8601."""
        from astropy.time import Time

        record = self.satellite()
        with installed_tables():
            date = Time(
                record.jdsatepoch, record.jdsatepochF, format="jd", scale="utc", precision=6
            )
            return str(date.isot)

    def satellite(self) -> Any:
        """The record that SGP4 moves."""
        from sgp4.api import WGS72, Satrec

        return Satrec.twoline2rv(self.first, self.second, WGS72)


@dataclass(frozen=True)
class Aircraft(Parameters):
    """A great circle at one height, flown at one speed over ground."""

    epoch: Annotated[str, "UTC, as ISO 8601"]
    longitude: Annotated[float, Unit("rad", "deg"), FINITE, "position at the epoch"]
    # Beyond these limits, at the poles, there is no heading.
    latitude: Annotated[float, Unit("rad", "deg"), Range(-1.5, 1.5), "position at the epoch"]
    altitude: Annotated[float, Unit("m", "km"), Range(1.0, 100e3), "above the ellipsoid"] = 3e3
    heading: Annotated[float, Unit("rad", "deg"), FINITE, "from north to east"] = 0.0
    speed: Annotated[float, Unit("m / s"), POSITIVE, "over ground"] = 80.0

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """Positions in metre and velocities over ground in metre / second, (n, 3) each, ITRS.

        Accuracy  model: a circle; its height above the ellipsoid varies by 5 m at most in 100 km.
        """
        here = np.array([self.longitude]), np.array([self.latitude])
        start = cartesian(*here, np.array([self.altitude]))[0]
        vertical = up(*here)[0]
        east = np.array([-math.sin(self.longitude), math.cos(self.longitude), 0.0])
        along = math.sin(self.heading) * east + math.cos(self.heading) * np.cross(vertical, east)
        # The centre of the circle is below the start, so that height and heading are kept.
        radius = float(start @ vertical)
        axis = np.cross(vertical, along)
        turn = Rotation.from_rotvec(np.outer(second * self.speed / radius, axis))
        centre = start - radius * vertical
        return centre + turn.apply(radius * vertical), turn.apply(self.speed * along)


@dataclass(frozen=True, eq=False)
class Flight:
    """A satellite or an aircraft at some times, in the Earth's fixed axes (ITRS)."""

    second: Annotated[Floats, "(n,) since the epoch of its orbit"]
    position: Annotated[Floats, "(n, 3) metre"]
    velocity: Annotated[Floats, "(n, 3) metre / second, over the rotating Earth"]
    inertial: Annotated[Floats, "(n, 3) metre / second, against the stars, in the same axes"]
    course: Annotated[Floats,
        "(n, 3) metre / second, direction of flight of `Pointing`: against the stars for a "
        "satellite, over ground for an aircraft"]  # fmt: skip
    icrs_to_itrs: Annotated[Rotation, "(n,) rotations"]


Carrier = Orbit | TwoLines | Aircraft  # what a camera flies on


def choose_carrier(orbit: Orbit | None, tle: tuple[str, ...], aircraft: Aircraft | None) -> Carrier:
    """The one of the three that a scene gives.

    Raises  ValueError where it gives none or several."""
    if (orbit is not None) + bool(tle) + (aircraft is not None) != 1:
        raise ValueError("exactly one of orbit, tle and aircraft must be given")
    carrier = orbit or aircraft
    if carrier is not None:
        return carrier
    if len(tle) != 2:
        raise ValueError(f"tle must be two lines, got {len(tle)}")
    return TwoLines(*tle)


def fly(orbit: Carrier, second: Floats) -> Flight:
    """Where a satellite or an aircraft is at (n,) seconds after its epoch.

    Source: SGP4 (Vallado et al. 2006) by the package sgp4; axes by astropy (ERFA).

    Raises    ValueError where SGP4 fails, with its reason; ImportError without sgp4
    Accuracy  model: SGP4 is good to a kilometre near the epoch. Beyond the installed Earth
              orientation less than 0.84 km of ground more (`startrack.dates`).
    """
    second = np.asarray(second, float)
    if isinstance(orbit, Aircraft):
        where, velocity = orbit.state(second)
        inertial = velocity + np.cross(SPIN, where)
        (icrs_to_itrs,) = _to_itrs(("GCRS",), orbit.epoch, second)
        return Flight(second, where, velocity, inertial, velocity, icrs_to_itrs)
    _need_sgp4()
    from sgp4.api import SGP4_ERRORS

    teme_to_itrs, icrs_to_itrs = _to_itrs(("TEME", "GCRS"), orbit.epoch, second)
    date = utc(orbit.epoch)
    code, position, velocity = orbit.satellite().sgp4_array(
        np.full(len(second), date.jd1), date.jd2 + second / DAY
    )
    if code.any():
        raise ValueError(f"the orbit must last, got {SGP4_ERRORS[int(code[code > 0][0])]}")
    where, inertial = (teme_to_itrs.apply(1e3 * one) for one in (position, velocity))
    return Flight(second, where, inertial - np.cross(SPIN, where), inertial, inertial, icrs_to_itrs)


def sun_direction(epoch: str, second: float = 0.0) -> Floats:
    """Unit vector (3,) towards the Sun in ITRS, seen from the Earth's centre.

    Accuracy  model: astropy's built-in ephemeris, 3 arcsec; 9 arcsec of parallax are neglected.
    """
    return np.array(_sun(epoch, second))


@lru_cache(maxsize=64)  # all channels of a scene ask for the same
def _sun(epoch: str, second: float) -> tuple[float, ...]:
    from astropy import units
    from astropy.coordinates import ITRS, get_body

    with installed_tables():
        date = utc(epoch) + second * units.s
        there = get_body("sun", date).transform_to(ITRS(obstime=date)).cartesian.xyz.value
    return tuple((there / np.linalg.norm(there)).tolist())


def _to_itrs(frames: tuple[str, ...], epoch: str, second: Floats) -> list[Rotation]:
    """Rotations of astropy's frames to ITRS, each at (n,) seconds after an epoch."""
    from astropy import coordinates, units

    with installed_tables():
        date = utc(epoch) + np.repeat(second, 3) * units.s
        axes = np.tile(np.eye(3), len(second)) * units.m
        unit, itrs = coordinates.CartesianRepresentation(axes), coordinates.ITRS(obstime=date)
        turned = [
            getattr(coordinates, frame)(unit, obstime=date).transform_to(itrs).cartesian.xyz.value
            for frame in frames
        ]
    # The columns of each matrix are the images of the three axes.
    return [Rotation.from_matrix(one.reshape(3, -1, 3).transpose(1, 0, 2)) for one in turned]


def _checksum(line: str) -> str:
    return str(sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10)


def _need_sgp4() -> None:
    try:
        import sgp4.api  # noqa: F401
    except ImportError:
        raise ImportError(
            "sgp4 must be installed to fly an orbit: pip install 'startrack[earth]'"
        ) from None
