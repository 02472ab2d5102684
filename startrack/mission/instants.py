"""Mission and instants -> place and attitude of the spacecraft, directions of Sun and Moon."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from startrack import space
from startrack.core import (
    LIGHT_SPEED,
    Floats,
    Samples,
    installed_tables,
    lagrange_weights,
    printed,
    utc,
)
from startrack.mission.files import OrbitSegment, read_ck, read_spk, seconds_after
from startrack.mission.messages import read_aem, read_oem
from startrack.mission.parameters import Attitude, Mission, MissionOrbit, ScanLaw
from startrack.space import cross, dot, times, unit

# Positions are interpolated between these times.
ORBIT_KNOT = 60.0  # second; six points: 3 mm in a low orbit
BODY_KNOT = 600.0  # second; straight lines: 0.1 arcsec for the Moon
LONGEST_RATE_STEP = 20.0  # second between two attitudes that give a rate


@printed
@dataclass(frozen=True, eq=False)
class Place:
    """Place of the spacecraft at n instants; vectors (3, n) in ICRS axes.

    second       (n,) after the begin of the mission
    place        metre from the Earth's centre
    speed        metre / second
    fixed        metre, `place` in the true equator of date (TEME)
    axes         (3, 3, n) matrix teme_to_icrs
    greenwich    (n,) radian, mean sidereal time
    sun_place, moon_place  metre from the Earth's centre
    earth_speed  metre / second, barycentric
    after        second by which these instants lie after the instants of a requested rate
    """

    second: Floats
    place: Floats
    speed: Floats
    fixed: Floats
    axes: Floats
    greenwich: Floats
    sun_place: Floats
    moon_place: Floats
    earth_speed: Floats
    after: float = 0.0

    def cut(self, count: int) -> Place:
        """The first `count` instants."""
        names = (field.name for field in fields(self) if field.name != "after")
        return replace(self, **{name: getattr(self, name)[..., :count] for name in names})


Law = Callable[[Place], Floats]


def law_of(attitude: Attitude, begin: str) -> Law:
    """A function of Place whose result is (3, 3, n), the matrices icrs_to_body.

    begin   of the mission, UTC
    Raises  ValueError if the file of attitudes cannot be used, or ends before the mission.
    """
    law = {"nadir": _nadir, "inertial": _inertial, "sun": _sun, "target": _target, "aem": _file}[
        attitude.law
    ](attitude, begin)
    if attitude.scan is None:
        return law
    scan = attitude.scan
    return lambda place: _scanned(scan, place.second, law(place))


def _nadir(attitude: Attitude, _begin: str) -> Law:
    return lambda place: _downwards(attitude.yaw, place, -unit(place.place))


def _downwards(yaw: str, place: Place, z: Floats) -> Floats:
    """Axes with a given z, and x as near as possible to its direction by the yaw law."""
    if yaw == "sun":
        ahead = place.sun_place - place.place
    elif yaw == "ground":
        ahead = place.speed - space.SPIN * cross(place.axes[:, 2], place.place)
    else:
        ahead = place.speed
    y = unit(cross(z, ahead))
    return np.stack([cross(y, z), y, z])


def _inertial(attitude: Attitude, _begin: str) -> Law:
    fixed = Rotation.from_quat(attitude.quaternion).as_matrix()[..., None]
    return lambda place: np.repeat(fixed, len(place.second), axis=2)


def _sun(attitude: Attitude, _begin: str) -> Law:
    first = np.array(attitude.axis) / np.linalg.norm(attitude.axis)
    second = np.array([1.0, 0, 0]) if abs(first[0]) < 0.999 else np.array([0, 0, 1.0])
    in_body = _triad(first[:, None], second[:, None])[..., 0]

    def law(place: Place) -> Floats:
        sun = unit(place.sun_place - place.place)
        north = np.zeros_like(sun)
        north[2] = 1.0
        return np.einsum("ki,kjn->ijn", in_body, _triad(sun, north))

    return law


def _triad(first: Floats, second: Floats) -> Floats:
    """(3, 3, n) orthonormal rows, the first of which is given."""
    third = unit(cross(first, second))
    return np.stack([first, cross(third, first), third])


def _target(attitude: Attitude, _begin: str) -> Law:
    sine, cosine = math.sin(attitude.latitude), math.cos(attitude.latitude)
    normal = space.EARTH_RADIUS / math.sqrt(1 - space.SQUARED_ECCENTRICITY * sine**2)
    out = (normal + attitude.height) * cosine
    up = (normal * (1 - space.SQUARED_ECCENTRICITY) + attitude.height) * sine

    def law(place: Place) -> Floats:
        east = place.greenwich + attitude.longitude
        ce, se, ones = np.cos(east), np.sin(east), np.ones_like(east)
        line = times(place.axes, np.stack([out * ce, out * se, up * ones])) - place.place
        vertical = times(place.axes, np.stack([cosine * ce, cosine * se, sine * ones]))
        z = unit(np.where(dot(vertical, line) < 0, line, -place.place))
        return _downwards(attitude.yaw, place, z)

    return law


@dataclass(frozen=True, eq=False)
class _Filed:
    """An attitude law by the segments of a file, each interpolated by itself.

    spans    (n, 2) second, first and last at which each may be used
    samples  of each, quaternions of one sign
    begin    of the mission, UTC
    """

    spans: Floats
    samples: tuple[Samples, ...]
    begin: str

    def __call__(self, place: Place) -> Floats:
        asked = place.second - place.after  # its segment is used, and may be extended by this time
        number = space.segment_of(self.spans, asked, 0.0, "attitude.aem", self.begin)
        quaternion = np.empty((4, len(asked)))
        for n in np.unique(number):
            here = number == n
            quaternion[:, here] = _attitude_at(self.samples[n], place.second[here])
        return np.ascontiguousarray(Rotation.from_quat(quaternion.T).as_matrix().transpose(1, 2, 0))


def _attitude_at(samples: Samples, second: Floats) -> Floats:
    """Quaternions (4, m): at constant rates between two, or by polynomials of their numbers."""
    if samples.degree > 1:
        return samples.at(second)[0]
    low = np.clip(np.searchsorted(samples.second, second) - 1, 0, len(samples.second) - 2)
    first, last = (Rotation.from_quat(samples.values[:, low + k].T) for k in (0, 1))
    part = (second - samples.second[low]) / (samples.second[low + 1] - samples.second[low])
    turn = Rotation.from_rotvec(part[:, None] * (last * first.inv()).as_rotvec())
    return (turn * first).as_quat().T


def _file(attitude: Attitude, begin: str) -> Law:
    assert attitude.aem is not None
    path = Path(attitude.aem)
    spans, samples = [], []
    for segment in read_ck(path) if path.suffix == ".bc" else read_aem(path):
        spans.append([float(seconds_after(begin, time)) for time in segment.usable])
        # q and -q are one attitude; neighbours get the same sign.
        sign = np.sign(np.sum(segment.quaternion[1:] * segment.quaternion[:-1], axis=1))
        signs = np.cumprod(np.append(1.0, np.where(sign == 0, 1.0, sign)))
        slopes = None if segment.slope is None else (signs[:, None] * segment.slope).T
        values = (signs[:, None] * segment.quaternion).T
        second = seconds_after(begin, segment.date)
        samples.append(Samples(second, values, segment.degree, slopes))
    return _Filed(np.array(spans), tuple(samples), begin)


def _scanned(scan: ScanLaw, second: Floats, body: Floats) -> Floats:
    """The body turned about its own axis, by Rodrigues' formula on the columns of its matrix."""
    axis = np.array(scan.axis) / np.linalg.norm(scan.axis)
    turn = scan.amplitude * np.sin(math.tau / scan.period * second) + scan.rate * second
    sine, cosine = np.sin(-turn), np.cos(turn)
    along = np.einsum("i,ijn->jn", axis, body)
    return cosine * body + sine * cross(axis, body) + (1 - cosine) * axis[:, None, None] * along


@printed
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
    latitude, longitude  (n,) radian; geodetic, and east
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


@printed
@dataclass(frozen=True, eq=False)
class SpacecraftMotion:
    """Ephemerides, orbit and attitude law, which are computed once for a mission."""

    mission: Mission
    bodies: space.Bodies
    path: space.Carrier
    law: Law

    def at(self, first: float, step: float, count: int) -> Instants:
        """The instants first, first + step ...

        Raises    Refused if a file has no state or attitude at one of them.
        Accuracy  numerical: 3 mm of the orbit's own propagation for steps below 60 s, rounding
                  above; Sun and Moon 0.1 arcsec; the rate is that between two instants, or over
                  a second where the step is longer than 20 s or a file has the attitudes.
        """
        if isinstance(self.path, space.Tabulated):
            self.path.require(first + step * np.arange(count, dtype=float))
        # The segments of a file may differ in attitude where they meet.
        close = step <= LONGEST_RATE_STEP and self.mission.attitude.law != "aem"
        place = self._place(first, step, count + close)
        body = self.law(place)
        if close:
            later, now = body[..., 1:], body[..., :-1]
            rate = _rate(now, later, step)
            place, body = place.cut(count), now
        else:
            afterwards = replace(self._place(first + 1.0, step, count), after=1.0)
            rate = _rate(body, self.law(afterwards), 1.0)
        parallax = [place.sun_place - place.place, place.moon_place - place.place]
        aberration = (place.earth_speed + place.speed) / LIGHT_SPEED
        sun, moon = (unit(unit(line) + aberration) for line in parallax)
        latitude = space.geodetic_latitude(place.fixed)
        east = np.arctan2(place.fixed[1], place.fixed[0]) - place.greenwich
        return Instants(
            second=place.second,
            place=place.place,
            speed=place.speed,
            pole=place.axes[:, 2],
            sun=sun,
            moon=moon,
            body=body,
            rate=rate,
            latitude=latitude,
            longitude=(east + math.pi) % math.tau - math.pi,
            phase=_phase(place),
            aberration=aberration,
        )

    def _place(self, first: float, step: float, count: int) -> Place:
        second = first + step * np.arange(count, dtype=float)
        columns = spread(self.bodies.at, first, step, count, BODY_KNOT, 2)
        bodies = space.body_states(columns, second)
        axes = bodies.teme_to_icrs

        def states(second: Floats) -> Floats:
            return np.concatenate(self.path.state(second))

        if self.path.inertial:
            state = states(second)  # interpolated itself
            place, speed = state[:3], state[3:]
            fixed = times(axes.transpose(1, 0, 2), place)
        else:
            state = spread(states, first, step, count, ORBIT_KNOT, 6)
            fixed = state[:3]
            place, speed = times(axes, fixed), times(axes, state[3:])
        return Place(
            second=second,
            place=place,
            speed=speed,
            fixed=fixed,
            axes=axes,
            greenwich=bodies.greenwich,
            sun_place=bodies.sun,
            moon_place=bodies.moon,
            earth_speed=bodies.earth_velocity,
        )


def motion_of(mission: Mission) -> SpacecraftMotion:
    """The plan of a mission: ephemerides as tables, orbit and law.

    Raises  ValueError if a file or the elements cannot be used; ImportError without sgp4.
    """
    begin = mission.time.begin
    # What may be refused comes first: the tables of a long mission take seconds.
    path, law = path_of(mission.orbit, begin), law_of(mission.attitude, begin)
    bodies = space.bodies_of(begin, mission.time.duration + mission.time.step)
    return SpacecraftMotion(mission, bodies, path, law)


def path_of(orbit: MissionOrbit, begin: str) -> space.Carrier:
    """The carrier that moves along an orbit.

    begin   begin of the mission, UTC
    Raises  ValueError if the elements contradict each other or a file cannot be used;
            ImportError without sgp4.
    """
    date = utc(begin)
    if orbit.tle:
        return space.Sgp4(space.two_line_record(orbit.tle), (float(date.jd1), float(date.jd2)))
    if orbit.oem:
        file = Path(orbit.oem)
        return _tabulated(read_spk(file) if file.suffix == ".bsp" else read_oem(file), begin)
    assert orbit.altitude is not None
    axis = space.EARTH_RADIUS + orbit.altitude
    start = 0.0
    if orbit.epoch is not None:
        with installed_tables():
            start = float((utc(orbit.epoch) - date).sec)
    tilt, node = orbit.inclination, orbit.node
    if orbit.local_time is not None:
        tilt = space.sun_synchronous(axis, orbit.eccentricity)
        node = space.node_at(orbit.epoch or begin, orbit.local_time)
    assert tilt is not None
    return space.Kepler(
        axis=axis,
        eccentricity=orbit.eccentricity,
        inclination=tilt,
        node=node,
        perigee=orbit.perigee,
        anomaly=orbit.anomaly,
        start=start,
    )


def _tabulated(segments: Sequence[OrbitSegment], begin: str) -> space.Tabulated:
    spans, places, speeds = [], [], []
    for segment in segments:
        spans.append([float(seconds_after(begin, time)) for time in segment.usable])
        second, speed = seconds_after(begin, segment.date), segment.speed.T
        slopes = speed if segment.hermite else None
        places.append(Samples(second, segment.place.T, segment.degree, slopes))
        speeds.append(Samples(second, speed, segment.degree))
    return space.Tabulated(np.array(spans), tuple(places), tuple(speeds), begin)


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
    knots = np.arange(points, dtype=float) - behind
    weight = lagrange_weights(knots, np.arange(block) / block)
    between = sliding_window_view(values, points, axis=1) @ weight.T
    return between.reshape(len(values), -1)[:, :count]


def _rate(now: Floats, later: Floats, step: float) -> Floats:
    """(3, n) radian / second in body axes, from two attitudes less than 90 degrees apart.

    later = exp(-[rate step]x) now, whose skew part is sin(angle) times the axis.
    """
    skew = (
        np.stack(
            [
                dot(later[1], now[2]) - dot(later[2], now[1]),
                dot(later[2], now[0]) - dot(later[0], now[2]),
                dot(later[0], now[1]) - dot(later[1], now[0]),
            ]
        )
        / 2
    )
    sine = np.sqrt(dot(skew, skew))
    angle = np.arcsin(np.minimum(sine, 1.0))
    return skew * (np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0) / step)


def _phase(place: Place) -> Floats:
    """(n,) radian in [0, 2 pi) from the ascending node, in the equator of date."""
    speed = times(place.axes.transpose(1, 0, 2), place.speed)
    hx, hy, hz = cross(place.fixed, speed)
    size = np.sqrt(hx * hx + hy * hy + hz * hz)
    # The node is at pole x h = (-hy, hx, 0).
    along = place.fixed[1] * hx - place.fixed[0] * hy
    return np.arctan2(place.fixed[2] * size, along) % math.tau
