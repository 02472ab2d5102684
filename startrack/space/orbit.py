"""Elements, TLE or a table of states -> position and velocity of a spacecraft over time."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from startrack import core
from startrack.core import DAY, TROPICAL_YEAR, Floats, Refused, Samples, shown, utc
from startrack.space.earth import EARTH_RADIUS, GM, J2

LOWEST = 80e3  # metre, of a perigee: below it no orbit lasts

BEYOND = 20.0  # second, by which the instant after the last may exceed a file, for the rate there
ROUNDING = 1e-6  # second, of dates as differences
KEPLER_STEPS = 12  # of Newton's method; 1e-15 for eccentricities up to 0.9
GM_WGS72 = 398600.8e9  # m^3 / s^2, as SGP4 wants it (Vallado et al. 2006, AIAA 2006-6753)
EPOCH_1949 = 2433281.5  # Julian date from which SGP4 counts its days


class Carrier(Protocol):
    """Something that moves: position and velocity at SI seconds after the begin of the mission."""

    inertial: bool  # whether its axes are ICRS; else true equator and mean equinox of date (TEME)

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """(3, n) metre and (3, n) metre / second at (n,) seconds."""


def require_perigee(altitude: float, eccentricity: float) -> None:
    """Raise ValueError where an orbit, `altitude` above the equator's radius, would not last."""
    if (EARTH_RADIUS + altitude) * (1 - eccentricity) < EARTH_RADIUS + LOWEST:
        raise Refused(
            "altitude and eccentricity must keep the perigee above 80 km, got "
            f"{altitude / 1e3:g} km and {eccentricity:g}"
        )


def require_two_lines(lines: tuple[str, ...]) -> None:
    """Raise Refused if lines are not a two-line element set that SGP4 is for.

    By length, number and checksum of both, the satellite they are of, and their ephemeris type:
    0 and 2 are SGP4's, where 4 is of SGP4-XP, whose elements SGP4 would fly wrongly.
    """
    if len(lines) != 2:
        raise Refused(f"tle must be two lines, got {len(lines)}")
    for number, line in enumerate(lines, 1):
        if len(line) != 69 or not line.startswith(f"{number} "):
            raise Refused(
                f"line {number} of tle must have 69 characters and begin with {number}, got "
                f"{shown(line)}"
            )
        total = sum(int(c) if c in "0123456789" else c == "-" for c in line[:68]) % 10
        if line[68] != str(total):
            raise Refused(f"line {number} of tle must end in its checksum {total}, got {line!r}")
    if lines[0][2:7] != lines[1][2:7]:
        raise Refused(
            "both lines of tle must be of one satellite, got the numbers "
            f"{lines[0][2:7]} and {lines[1][2:7]}"
        )
    if lines[0][62] not in " 02":
        raise Refused(
            "the ephemeris type of tle (column 63 of line 1) must be 0, elements for SGP4, got "
            f"{lines[0][62]}"
        )


def orbit_direction(node: float, inclination: float, argument: float) -> Floats:
    """(3,) unit vector from the Earth's centre, at an angle (radian) from the ascending node."""
    along, across = math.cos(argument), math.sin(argument)
    return np.array(
        [
            along * math.cos(node) - across * math.cos(inclination) * math.sin(node),
            along * math.sin(node) + across * math.cos(inclination) * math.cos(node),
            across * math.sin(inclination),
        ]
    )


@dataclass(frozen=True)
class Kepler:
    """Mean elements that J2 moves: node, perigee and mean anomaly at steady rates.

        node'    = -3/2 J2 (R / p)^2 n cos i
        perigee' =  3/4 J2 (R / p)^2 n (5 cos^2 i - 1)
        anomaly' =  n (1 + 3/4 J2 (R / p)^2 sqrt(1 - e^2) (3 cos^2 i - 1)),   n = sqrt(GM / a^3)

    Source: Vallado (2013), Fundamentals of Astrodynamics, 4th ed., section 9.6.

    axis, eccentricity, inclination, node, perigee, anomaly   metre, 1, radian; mean, at `start`
    start     second after the begin of the mission
    Accuracy  model: secular terms of J2 alone; the periodic ones that are left out move a
              satellite in a low orbit by some 10 km; no drag, no Sun, no Moon.
    """

    axis: float
    eccentricity: float
    inclination: float
    node: float
    perigee: float
    anomaly: float
    start: float = 0.0
    inertial = False

    @cached_property
    def rates(self) -> tuple[float, float, float]:
        """Radian / second of node, perigee and mean anomaly."""
        motion = math.sqrt(GM / self.axis**3)
        round_ = 1 - self.eccentricity**2
        pull = 0.75 * J2 * (EARTH_RADIUS / (self.axis * round_)) ** 2 * motion
        cosine = math.cos(self.inclination)
        return (
            -2 * pull * cosine,
            pull * (5 * cosine**2 - 1),
            motion + pull * math.sqrt(round_) * (3 * cosine**2 - 1),
        )

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """See `Carrier`."""
        since = second - self.start
        starts = self.node, self.perigee, self.anomaly
        node, perigee, mean = (
            first + rate * since for first, rate in zip(starts, self.rates, strict=True)
        )
        e, anomaly = self.eccentricity, mean
        if e:
            anomaly = mean + e * np.sin(mean)
            for _ in range(KEPLER_STEPS):
                anomaly -= (anomaly - e * np.sin(anomaly) - mean) / (1 - e * np.cos(anomaly))
        sine, cosine = np.sin(anomaly), np.cos(anomaly)
        flat = math.sqrt(1 - e * e)
        speed = math.sqrt(GM / self.axis) / (1 - e * cosine)
        in_plane = (self.axis * (cosine - e), self.axis * flat * sine)
        moving = (-speed * sine, speed * flat * cosine)
        to_p, to_q = _plane(node, perigee, self.inclination)
        return (in_plane[0] * to_p + in_plane[1] * to_q, moving[0] * to_p + moving[1] * to_q)


def _plane(node: Floats, perigee: Floats, tilt: float) -> tuple[Floats, Floats]:
    """(3, n) unit vectors to the perigee, and 90 degrees further in the orbit."""
    cn, sn, cp, sp = np.cos(node), np.sin(node), np.cos(perigee), np.sin(perigee)
    ci, si = math.cos(tilt), math.sin(tilt)
    to_p = np.stack([cp * cn - sp * ci * sn, cp * sn + sp * ci * cn, sp * si])
    to_q = np.stack([-sp * cn - cp * ci * sn, -sp * sn + cp * ci * cn, cp * si])
    return to_p, to_q


def two_line_record(lines: tuple[str, ...]) -> Any:
    """Record of a two-line element set for SGP4; raises ImportError without sgp4."""
    sgp4 = _sgp4()
    return sgp4.Satrec.twoline2rv(*lines, sgp4.WGS72)


def element_record(
    epoch: str, axis: float, eccentricity: float, angles: tuple[float, float, float, float]
) -> Any:
    """Record of mean elements at an epoch for SGP4, without drag.

    epoch   UTC;  axis  metre
    angles  radian: inclination, node, perigee, mean anomaly
    Raises  ImportError without sgp4
    """
    sgp4, date = _sgp4(), utc(epoch)
    inclination, node, perigee, anomaly = angles
    record = sgp4.Satrec()
    record.sgp4init(
        sgp4.WGS72,
        "i",
        1,
        (date.jd1 - EPOCH_1949) + date.jd2,
        0.0,
        0.0,
        0.0,
        eccentricity,
        perigee % math.tau,
        inclination,
        anomaly % math.tau,
        60 * math.sqrt(GM_WGS72 / axis**3),
        node % math.tau,
    )
    return record


def propagate(record: Any, jd: tuple[Floats, Floats], name: str) -> tuple[Floats, Floats]:
    """Positions (metre) and velocities (metre / second) in TEME, (n, 3) each, by SGP4.

    jd      (n,) two parts of the Julian dates, UTC
    name    of the orbit, for the message
    Source: the package sgp4 (Vallado et al. 2006, AIAA 2006-6753).

    Raises  ValueError if SGP4 fails, with its reason
    """
    code, place, speed = record.sgp4_array(*jd)
    if code.any():
        raise Refused(f"{name} must last, got {_sgp4().SGP4_ERRORS[int(code[code > 0][0])]}")
    return 1e3 * place, 1e3 * speed


def _sgp4() -> Any:
    needed = "sgp4 must be installed to fly an orbit: pip install 'startrack[earth]'"
    return core.optional_package("sgp4.api", needed)


@dataclass(frozen=True)
class Sgp4:
    """A two-line element set, moved by SGP4.

    record    of `two_line_record`
    jd        two parts of the Julian date, UTC, of the begin of the mission
    Accuracy  model: a kilometre near the epoch, some kilometres more each day. UTC counts as
              uniform within a mission: a leap second in it shifts the satellite by 7.5 km.
    """

    record: Any
    jd: tuple[float, float]
    inertial = False

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """See `Carrier`; raises ValueError with the package's reason where it fails."""
        days = np.floor(second / DAY)
        dates = self.jd[0] + days, self.jd[1] + (second - days * DAY) / DAY
        place, speed = propagate(self.record, dates, "orbit.tle")
        return place.T, speed.T


def sun_synchronous(axis: float, eccentricity: float = 0.0) -> float:
    """Inclination (radian) at which J2 turns the node by 360 degrees in a tropical year.

    axis    metre
    Raises  ValueError if no inclination does.
    """
    rate = Kepler(axis, eccentricity, 0.0, 0.0, 0.0, 0.0).rates[0]
    cosine = 2 * math.pi / TROPICAL_YEAR / rate
    if cosine < -1:
        raise Refused(
            "local_time must be left out above 5972 km, where no orbit is Sun-synchronous, got "
            f"an altitude of {(axis - EARTH_RADIUS) / 1e3:g} km"
        )
    return math.acos(cosine)


def node_at(epoch: str, local_time: float) -> float:
    """Right ascension of the node at a mean local solar time (second): from Greenwich's."""
    with core.installed_tables():
        date = utc(epoch)
        greenwich = date.sidereal_time("mean", "greenwich", model="IAU1982").rad
        second = float(date.ut1.jd1 - 0.5 + date.ut1.jd2) % 1.0 * DAY
    return float((greenwich + (local_time - second) / DAY * math.tau) % math.tau)


def segment_of(
    spans: Floats, second: Floats, beyond: float, what: str, date: str
) -> NDArray[np.intp]:
    """Index (m,) of the segment of a file that covers (m,) seconds; the later where two meet.

    spans   (n, 2) second, first and last of each, in their order
    beyond  second, by which an instant may be outside its segment
    what    kind of file, for the message;  date  from which seconds count
    Raises  Refused for seconds without a segment, with the limits of the gap.
    """
    after = np.searchsorted(spans[:, 0] - ROUNDING, second, side="right") - 1
    number = np.clip(after, 0, len(spans) - 1)
    outside = np.maximum(spans[number, 0] - second, second - spans[number, 1])
    beside = outside > beyond + ROUNDING
    if not beside.any():
        return number
    missed = int(beside.argmax())  # the first
    here = int(number[missed])
    first, last, at = (
        core.utc_text(date, float(time), whole=False)
        for time in (spans[0, 0], spans[-1, 1], second[missed])
    )
    if second[missed] < spans[0, 0] or here == len(spans) - 1:
        raise Refused(
            f"{what} must hold the mission's time: it is given from {first} to {last} UTC, and "
            f"asked for at {at}"
        )
    begin, end = (
        core.utc_text(date, float(time), whole=False)
        for time in (spans[here, 1], spans[here + 1, 0])
    )
    raise Refused(
        f"{what} must hold the mission's time: it has a gap from {begin} to {end} UTC, "
        f"and is asked for at {at}; nothing is interpolated over a gap"
    )


@dataclass(frozen=True, eq=False)
class Tabulated:
    """States of the segments of a file, interpolated within each.

    spans  (n, 2) second, first and last at which each may be used
    place  of each, metre, ICRS axes, with the speeds as slopes where it is interpolated so
    speed  of each, metre / second
    begin  of the mission, UTC
    """

    spans: Floats
    place: tuple[Samples, ...]
    speed: tuple[Samples, ...]
    begin: str
    inertial = True

    def require(self, second: Floats) -> None:
        """Raise Refused where the file has no state at one of these instants."""
        segment_of(self.spans, second, 0.0, "orbit.oem", self.begin)

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """See `Carrier`; raises Refused more than 20 s outside the file's segments."""
        number = segment_of(self.spans, second, BEYOND, "orbit.oem", self.begin)
        place, speed = np.empty((2, 3, len(second)))
        for n in np.unique(number):
            here = number == n
            place[:, here], derivative = self.place[n].at(second[here])
            speed[:, here] = self.speed[n].at(second[here])[0] if derivative is None else derivative
        return place, speed
