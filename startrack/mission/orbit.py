"""Orbit -> position and velocity of the spacecraft in the Earth's true equator of date (TEME)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from startrack.core import Floats, Refused, installed_tables, utc
from startrack.mission.ccsds import Ephemeris, read_oem
from startrack.mission.parameters import Orbit
from startrack.mission.spice import read_spk
from startrack.scene import EARTH_RADIUS

GM = 3.986004418e14  # m^3 / s^2, WGS 84
J2 = 1.08262668e-3  # 1, WGS 84, EGM96
YEAR = 365.2422 * 86400.0  # second, tropical
DAY = 86400.0
BEYOND = 60.0  # second, by which a mission may exceed its file, for the rate at its last step
KEPLER_STEPS = 12  # of Newton's method; 1e-15 for eccentricities up to 0.9


class Path6(Protocol):
    """Something that moves: position and velocity at SI seconds after the begin of the mission."""

    inertial: bool  # whether its axes are ICRS; else true equator and mean equinox of date (TEME)

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """(3, n) metre and (3, n) metre / second at (n,) seconds."""


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
        """See `Path6`."""
        since = second - self.start
        node, perigee, mean = (
            first + rate * since
            for first, rate in zip((self.node, self.perigee, self.anomaly), self.rates, strict=True)
        )
        e = self.eccentricity
        if not e:
            anomaly = mean
        else:
            anomaly = mean + e * np.sin(mean)
            for _ in range(KEPLER_STEPS):
                anomaly -= (anomaly - e * np.sin(anomaly) - mean) / (1 - e * np.cos(anomaly))
        sine, cosine = np.sin(anomaly), np.cos(anomaly)
        flat = math.sqrt(1 - e * e)
        speed = math.sqrt(GM / self.axis) / (1 - e * cosine)
        in_plane = (self.axis * (cosine - e), self.axis * flat * sine)
        moving = (-speed * sine, speed * flat * cosine)
        to_p, to_q = _plane(node, perigee, self.inclination)
        return (
            in_plane[0] * to_p + in_plane[1] * to_q,
            moving[0] * to_p + moving[1] * to_q,
        )


def _plane(node: Floats, perigee: Floats, tilt: float) -> tuple[Floats, Floats]:
    """(3, n) unit vectors to the perigee, and 90 degrees further in the orbit."""
    cn, sn, cp, sp = np.cos(node), np.sin(node), np.cos(perigee), np.sin(perigee)
    ci, si = math.cos(tilt), math.sin(tilt)
    to_p = np.stack([cp * cn - sp * ci * sn, cp * sn + sp * ci * cn, sp * si])
    to_q = np.stack([-sp * cn - cp * ci * sn, -sp * sn + cp * ci * cn, cp * si])
    return to_p, to_q


@dataclass(frozen=True)
class Sgp4:
    """A two-line element set, moved by the package sgp4 (Vallado et al. 2006, AIAA 2006-6753).

    record    of the package
    jd        two parts of the Julian date, UTC, of the begin of the mission
    Accuracy  model: a kilometre near the epoch, some kilometres more each day. UTC counts as
              uniform within a mission: a leap second in it shifts the satellite by 7.5 km.
    """

    record: Any
    jd: tuple[float, float]
    inertial = False

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """See `Path6`; raises ValueError with the package's reason where it fails."""
        from sgp4.api import SGP4_ERRORS

        days = np.floor(second / DAY)
        code, place, speed = self.record.sgp4_array(
            self.jd[0] + days, self.jd[1] + (second - days * DAY) / DAY
        )
        if code.any():
            raise Refused(f"orbit.tle must last, got {SGP4_ERRORS[int(code[code > 0][0])]}")
        return 1e3 * place.T, 1e3 * speed.T


def path_of(orbit: Orbit, begin: str) -> Path6:
    """What moves along an orbit.

    begin   of the mission, UTC
    Raises  ValueError where the elements contradict each other or a file cannot be used;
            ImportError without sgp4.
    """
    date = utc(begin)
    if orbit.tle:
        try:
            from sgp4.api import WGS72, Satrec
        except ImportError:
            raise ImportError(
                "sgp4 must be installed for orbit.tle: pip install 'startrack[earth]'"
            ) from None
        return Sgp4(Satrec.twoline2rv(*orbit.tle, WGS72), (float(date.jd1), float(date.jd2)))
    if orbit.oem:
        file = Path(orbit.oem)
        return _along(read_spk(file) if file.suffix == ".bsp" else read_oem(file), begin)
    assert orbit.altitude is not None
    axis = EARTH_RADIUS + orbit.altitude
    start = 0.0
    if orbit.epoch is not None:
        with installed_tables():
            start = float((utc(orbit.epoch) - date).sec)
    tilt, node = orbit.inclination, orbit.node
    if orbit.local_time is not None:
        tilt = sun_synchronous(axis, orbit.eccentricity)
        node = _node(orbit.epoch or begin, orbit.local_time)
    assert tilt is not None
    return Kepler(axis, orbit.eccentricity, tilt, node, orbit.perigee, orbit.anomaly, start)


def sun_synchronous(axis: float, eccentricity: float = 0.0) -> float:
    """Inclination (radian) at which J2 turns the node by 360 degrees in a tropical year.

    axis    metre
    Raises  ValueError where no inclination does.
    """
    rate = Kepler(axis, eccentricity, 0.0, 0.0, 0.0, 0.0).rates[0]
    cosine = 2 * math.pi / YEAR / rate
    if cosine < -1:
        raise Refused(
            "local_time must be left out above 5972 km, where no orbit is Sun-synchronous, got "
            f"an altitude of {(axis - EARTH_RADIUS) / 1e3:g} km"
        )
    return math.acos(cosine)


def _node(epoch: str, local_time: float) -> float:
    """Right ascension of the node at a mean local solar time (second): from Greenwich's."""
    with installed_tables():
        date = utc(epoch)
        greenwich = date.sidereal_time("mean", "greenwich", model="IAU1982").rad
        second = float(date.ut1.jd1 - 0.5 + date.ut1.jd2) % 1.0 * DAY
    return float((greenwich + (local_time - second) / DAY * math.tau) % math.tau)


@dataclass(frozen=True, eq=False)
class Along:
    """States of a file, interpolated by Lagrange's polynomials of its degree.

    second, place, speed   (n,), (3, n) metre, (3, n) metre / second, ICRS axes
    """

    second: Floats
    place: Floats
    speed: Floats
    points: int
    inertial = True

    def state(self, second: Floats) -> tuple[Floats, Floats]:
        """See `Path6`; raises ValueError outside the file's times."""
        first, last = self.second[0], self.second[-1]
        if second[0] < first - BEYOND or second[-1] > last + BEYOND:
            raise Refused(
                f"orbit.oem must hold the mission's time, from {second[0]:g} to {second[-1]:g} s "
                f"after its begin, got {first:g} to {last:g} s"
            )
        near = np.searchsorted(self.second, second) - self.points // 2
        near = np.clip(near, 0, len(self.second) - self.points)
        at = near[:, None] + np.arange(self.points)
        knot = self.second[at] - second[:, None]
        weight = np.ones_like(knot)
        for i in range(self.points):
            for j in range(self.points):
                if j != i:
                    weight[:, i] *= knot[:, j] / (knot[:, j] - knot[:, i])
        place, speed = (
            np.einsum("nk,ank->an", weight, one[:, at]) for one in (self.place, self.speed)
        )
        return place, speed


def _along(file: Ephemeris, begin: str) -> Along:
    from astropy.time import Time

    with installed_tables():
        dates = Time(list(file.epoch), scale=file.scale)
        second = np.asarray((dates - utc(begin)).sec)
    if len(second) < 2 or (np.diff(second) <= 0).any():
        raise Refused("orbit.oem must hold two or more states at rising times")
    points = min(file.degree + 1, len(second))
    return Along(second, file.place.T, file.speed.T, points)
