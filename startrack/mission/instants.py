"""Mission and instants -> where the spacecraft is, how it points, and where Sun and Moon are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from startrack.core import LIGHT_SPEED, Floats, Refused, installed_tables, utc
from startrack.mission.ccsds import Ephemeris, read_oem, seconds_after
from startrack.mission.law import Law, Place, law_of
from startrack.mission.parameters import Mission, Orbit
from startrack.mission.spice import read_spk
from startrack.space import (
    AXES_COLUMNS,
    EARTH_RADIUS,
    FLATTENING,
    GREENWICH_COLUMN,
    MOON_COLUMNS,
    SIDEREAL,
    SPEED_COLUMNS,
    SUN_COLUMNS,
    Bodies,
    Carrier,
    Kepler,
    Sgp4,
    Tabulated,
    bodies_of,
    dot,
    lagrange_weights,
    node_at,
    sun_synchronous,
    times,
    two_line_record,
    unit,
)

# Between these times, positions follow from polynomials.
ORBIT_KNOT = 60.0  # second; six points: 3 mm in a low orbit
BODY_KNOT = 600.0  # second; straight lines: 0.1 arcsec for the Moon
LONGEST_RATE_STEP = 20.0  # second between two attitudes from which a rate follows


@dataclass(frozen=True, eq=False)
class Instants:
    """n instants at equal steps.

    second     (n,) after the begin of the mission
    place      (3, n) metre from the Earth's centre, ICRS axes, as are all vectors here
    speed      (3, n) metre / second
    pole       (3, n) unit vector, the Earth's axis
    sun, moon  (3, n) apparent unit vectors from the spacecraft: light-time, parallax, aberration
    body       (3, 3, n) rows are the body's axes: the matrix icrs_to_body
    rate       (3, n) radian / second in body axes
    latitude, longitude  (n,) radian; geodetic within 0.1 degrees; east
    phase      (n,) radian, along the orbit from the ascending node
    aberration (3, n) 1, velocity over the speed of light
    """

    second: Floats
    place: Floats
    speed: Floats
    pole: Floats
    sun: Floats
    moon: Floats
    body: Floats
    rate: Floats
    latitude: Floats
    longitude: Floats
    phase: Floats
    aberration: Floats


@dataclass(frozen=True, eq=False)
class Course:
    """What is computed once for a mission: ephemerides, orbit and attitude law."""

    mission: Mission
    bodies: Bodies
    path: Carrier
    law: Law

    def at(self, first: float, step: float, count: int) -> Instants:
        """The instants first, first + step ...

        Accuracy  numerical: 3 mm of the orbit's own propagation for steps below 60 s, rounding
                  above; Sun and Moon 0.1 arcsec; the rate is that between two instants, or over
                  a second where the step is longer than 20 s.
        """
        close = step <= LONGEST_RATE_STEP
        place = self._place(first, step, count + close)
        body = self.law(place)
        if close:
            later, now = body[..., 1:], body[..., :-1]
            rate = _rate(now, later, step)
            place, body = place.cut(count), now
        else:
            rate = _rate(body, self.law(self._place(first + 1.0, step, count)), 1.0)
        parallax = [place.sun_place - place.place, place.moon_place - place.place]
        aberration = (place.earth_speed + place.speed) / LIGHT_SPEED
        sun, moon = (unit(unit(line) + aberration) for line in parallax)
        pole = place.axes[:, 2]
        z = place.fixed[2] / np.sqrt(dot(place.fixed, place.fixed))
        flat = 1 - FLATTENING
        return Instants(
            place.second,
            place.place,
            place.speed,
            pole,
            sun,
            moon,
            body,
            rate,
            np.arctan2(z, flat**2 * np.sqrt(np.maximum(1 - z * z, 0))),
            _turn(np.arctan2(place.fixed[1], place.fixed[0]) - place.greenwich),
            _phase(place),
            aberration,
        )

    def _place(self, first: float, step: float, count: int) -> Place:
        second = first + step * np.arange(count, dtype=float)
        slow = spread(self.bodies.at, first, step, count, BODY_KNOT, 2)
        axes = slow[AXES_COLUMNS].reshape(3, 3, -1)

        def states(second: Floats) -> Floats:
            return np.concatenate(self.path.state(second))

        if self.path.inertial:
            state = states(second)  # interpolated itself, and without values beyond its file
            place, speed = state[:3], state[3:]
            fixed = times(axes.transpose(1, 0, 2), place)
        else:
            state = spread(states, first, step, count, ORBIT_KNOT, 6)
            fixed = state[:3]
            place, speed = times(axes, fixed), times(axes, state[3:])
        return Place(
            second,
            place,
            speed,
            fixed,
            axes,
            slow[GREENWICH_COLUMN] + SIDEREAL * second,
            slow[SUN_COLUMNS],
            slow[MOON_COLUMNS],
            slow[SPEED_COLUMNS],
        )


def course_of(mission: Mission) -> Course:
    """The plan of a mission: ephemerides as tables, orbit and law.

    Raises  ValueError where a file or the elements cannot be used; ImportError without sgp4.
    """
    begin = mission.time.begin
    # What may be refused comes first: the tables of a long mission take seconds.
    path, law = path_of(mission.orbit, begin), law_of(mission.attitude, begin)
    bodies = bodies_of(begin, mission.time.duration + mission.time.step)
    return Course(mission, bodies, path, law)


def path_of(orbit: Orbit, begin: str) -> Carrier:
    """What moves along an orbit.

    begin   of the mission, UTC
    Raises  ValueError where the elements contradict each other or a file cannot be used;
            ImportError without sgp4.
    """
    date = utc(begin)
    if orbit.tle:
        return Sgp4(two_line_record(orbit.tle), (float(date.jd1), float(date.jd2)))
    if orbit.oem:
        file = Path(orbit.oem)
        return _tabulated(read_spk(file) if file.suffix == ".bsp" else read_oem(file), begin)
    assert orbit.altitude is not None
    axis = EARTH_RADIUS + orbit.altitude
    start = 0.0
    if orbit.epoch is not None:
        with installed_tables():
            start = float((utc(orbit.epoch) - date).sec)
    tilt, node = orbit.inclination, orbit.node
    if orbit.local_time is not None:
        tilt = sun_synchronous(axis, orbit.eccentricity)
        node = node_at(orbit.epoch or begin, orbit.local_time)
    assert tilt is not None
    return Kepler(axis, orbit.eccentricity, tilt, node, orbit.perigee, orbit.anomaly, start)


def _tabulated(file: Ephemeris, begin: str) -> Tabulated:
    second = seconds_after(begin, file)
    if len(second) < 2 or (np.diff(second) <= 0).any():
        raise Refused("orbit.oem must hold two or more states at rising times")
    points = min(file.degree + 1, len(second))
    return Tabulated(second, file.place.T, file.speed.T, points)


def spread(
    exact: Callable[[Floats], Floats],
    first: float,
    step: float,
    count: int,
    knot: float,
    points: int,
) -> Floats:
    """A function at equal steps, from its values at wider ones, by Lagrange's polynomials.

    exact    (n,) second -> (k, n)
    knot     second, the widest distance of the values that it is computed at
    points   even number of values around each step that the polynomial goes through
    Returns  (k, count); `exact` itself where the steps are no closer than the knots
    """
    block = int(knot / step)
    if block < 2:
        return exact(first + step * np.arange(count, dtype=float))
    blocks = -(-count // block)
    behind = points // 2 - 1
    wide = block * step
    values = exact(first + wide * (np.arange(blocks + points - 1, dtype=float) - behind))
    knots = np.arange(points, dtype=float)[:, None] - behind
    weight = lagrange_weights(knots, np.arange(block) / block)
    between = sliding_window_view(values, points, axis=1) @ weight
    return between.reshape(len(values), -1)[:, :count]


def _rate(now: Floats, later: Floats, step: float) -> Floats:
    """(3, n) radian / second in body axes, from two attitudes less than 90 degrees apart.

    later = exp(-[rate step]x) now, whose skew part is sin(angle) times the axis.
    """
    skew = np.stack([
        dot(later[1], now[2]) - dot(later[2], now[1]),
        dot(later[2], now[0]) - dot(later[0], now[2]),
        dot(later[0], now[1]) - dot(later[1], now[0]),
    ]) / 2  # fmt: skip
    sine = np.sqrt(dot(skew, skew))
    angle = np.arcsin(np.minimum(sine, 1.0))
    return skew * (np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0) / step)


def _phase(place: Place) -> Floats:
    """(n,) radian in [0, 2 pi) from the ascending node, in the equator of date."""
    x, y, z = times(place.axes.transpose(1, 0, 2), place.speed)
    fx, fy, fz = place.fixed
    hx, hy, hz = fy * z - fz * y, fz * x - fx * z, fx * y - fy * x
    size = np.sqrt(hx * hx + hy * hy + hz * hz)
    # The node is at pole x h = (-hy, hx, 0).
    along = fy * hx - fx * hy
    return np.arctan2(fz * size, along) % math.tau


def _turn(angle: Floats) -> Floats:
    """The angle in [-pi, pi)."""
    return (angle + math.pi) % math.tau - math.pi
