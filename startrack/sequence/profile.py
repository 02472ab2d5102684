"""Legs of constant rates -> attitudes and rates at any time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.sequence.parameters import Leg

Floats = NDArray[np.float64]


def attitudes(legs: tuple[Leg, ...], start: Rotation, time: Floats) -> Rotation:
    """The attitude icrs_to_camera of the profile, without jitter.

    A camera that turns at the rate w sees the sky turn back: A(t + s) = exp(-[w]x s) A(t).

    start  attitude at time 0
    time   (m,) second, from 0 on; after the last leg its rate goes on
    Errors numerical: rounding alone, as each leg's turn is a closed form.
    """
    begin, rate = _begins(legs), _rates(legs)
    corner = [start]
    for leg, turn in zip(legs, rate, strict=True):
        corner.append(Rotation.from_rotvec(-turn * leg.duration) * corner[-1])
    leg_of = _leg_of(begin, time)
    since = (time - begin[leg_of])[:, None]
    return Rotation.from_rotvec(-rate[leg_of] * since) * Rotation.concatenate(corner)[leg_of]


def rates(legs: tuple[Leg, ...], time: Floats) -> Floats:
    """The rate (m, 3) of the camera about its own axes, radian / second."""
    return _rates(legs)[_leg_of(_begins(legs), time)]


def _begins(legs: tuple[Leg, ...]) -> Floats:
    return np.concatenate([[0.0], np.cumsum([leg.duration for leg in legs])[:-1]])


def _rates(legs: tuple[Leg, ...]) -> Floats:
    return np.array([[leg.rate_x, leg.rate_y, leg.rate_z] for leg in legs])


def _leg_of(begin: Floats, time: Floats) -> NDArray[np.int64]:
    return np.maximum(np.searchsorted(begin, time, side="right") - 1, 0)
