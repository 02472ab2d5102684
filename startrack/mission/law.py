"""Attitude -> Law: place of the spacecraft -> its axes x, y, z, at every instant."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from startrack.core import Floats, Refused
from startrack.mission.ccsds import read_aem, seconds_after
from startrack.mission.parameters import Attitude, Scan
from startrack.mission.spice import read_ck
from startrack.space import (
    EARTH_RADIUS,
    SPIN,
    SQUARED_ECCENTRICITY,
    cross,
    dot,
    times,
    unit,
)

BEYOND = 60.0  # second, by which a mission may exceed its file; the attitude stands still there


@dataclass(frozen=True, eq=False)
class Place:
    """Where the spacecraft is at n instants; vectors (3, n) in ICRS axes.

    second       (n,) after the begin of the mission
    place        metre from the Earth's centre
    speed        metre / second
    fixed        metre, `place` in the true equator of date (TEME)
    axes         (3, 3, n) matrix teme_to_icrs
    greenwich    (n,) radian, mean sidereal time
    sun_place, moon_place  metre from the Earth's centre
    earth_speed  metre / second, barycentric
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

    def cut(self, count: int) -> Place:
        """The first of them."""
        return Place(*(getattr(self, one.name)[..., :count] for one in fields(self)))


Law = Callable[[Place], Floats]


def law_of(attitude: Attitude, begin: str) -> Law:
    """A function of Place whose result is (3, 3, n), the matrices icrs_to_body.

    begin   of the mission, UTC
    Raises  ValueError where the file of attitudes cannot be used, or ends before the mission.
    """
    law = {
        "nadir": _nadir,
        "inertial": _inertial,
        "sun": _sun,
        "target": _target,
        "aem": _file,
    }[attitude.law](attitude, begin)
    if attitude.scan is None:
        return law
    scan = attitude.scan
    return lambda place: _scanned(scan, place.second, law(place))


def _nadir(attitude: Attitude, _begin: str) -> Law:
    return lambda place: _downwards(attitude.yaw, place, -unit(place.place))


def _downwards(yaw: str, place: Place, z: Floats) -> Floats:
    """Axes with z as given, and x as near as possible to where the yaw wants it."""
    if yaw == "sun":
        ahead = place.sun_place - place.place
    elif yaw == "ground":
        ahead = place.speed - SPIN * cross(place.axes[:, 2], place.place)
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
    normal = EARTH_RADIUS / math.sqrt(1 - SQUARED_ECCENTRICITY * sine**2)
    out = (normal + attitude.height) * cosine
    up = (normal * (1 - SQUARED_ECCENTRICITY) + attitude.height) * sine

    def law(place: Place) -> Floats:
        east = place.greenwich + attitude.longitude
        ce, se, one = np.cos(east), np.sin(east), np.ones_like(east)
        line = times(place.axes, np.stack([out * ce, out * se, up * one])) - place.place
        vertical = times(place.axes, np.stack([cosine * ce, cosine * se, sine * one]))
        z = unit(np.where(dot(vertical, line) < 0, line, -place.place))
        return _downwards(attitude.yaw, place, z)

    return law


def _file(attitude: Attitude, begin: str) -> Law:
    assert attitude.aem is not None
    path = Path(attitude.aem)
    file = read_ck(path) if path.suffix == ".bc" else read_aem(path)
    second = seconds_after(begin, file)
    if len(second) < 2 or (np.diff(second) <= 0).any():
        raise Refused("attitude.aem must hold two or more attitudes at rising times")
    course = Slerp(second, Rotation.from_quat(file.quaternion))

    def law(place: Place) -> Floats:
        if place.second[0] < second[0] - BEYOND or place.second[-1] > second[-1] + BEYOND:
            raise Refused(
                f"attitude.aem must hold the mission's time, to {place.second[-1]:g} s after its "
                f"begin, got {second[0]:g} to {second[-1]:g} s"
            )
        at = np.clip(place.second, second[0], second[-1])
        return np.ascontiguousarray(course(at).as_matrix().transpose(1, 2, 0))

    return law


def _scanned(scan: Scan, second: Floats, body: Floats) -> Floats:
    """The body turned about its own axis, by Rodrigues' formula on the columns of its matrix."""
    axis = np.array(scan.axis) / np.linalg.norm(scan.axis)
    turn = scan.amplitude * np.sin(math.tau / scan.period * second) + scan.rate * second
    sine, cosine = np.sin(-turn), np.cos(turn)
    along = np.einsum("i,ijn->jn", axis, body)
    across = np.stack([
        axis[1] * body[2] - axis[2] * body[1],
        axis[2] * body[0] - axis[0] * body[2],
        axis[0] * body[1] - axis[1] * body[0],
    ])  # fmt: skip
    return cosine * body + sine * across + (1 - cosine) * axis[:, None, None] * along
