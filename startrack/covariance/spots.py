"""Case and attitude -> the spots of a trial, drawn from the bias and covariance of centroids."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.spatial.transform import Rotation

from startrack.case import Case
from startrack.covariance.plan import plan_of, refuse
from startrack.covariance.star import FALSE, false_spots, sights, trial_keys
from startrack.detector.counter import bits, uniform
from startrack.streams import Streams
from startrack.values import Spots

ROW = 7  # x, y, flux, its sigma, xx, xy, yy


def spots_of(case: Case, icrs_to_camera: Rotation, streams: Streams) -> Spots:
    """What the tracker finds, for its identification to name: stars, and false spots among them.

        s = 1 + blur N(0, 1),   flux = s expected flux
        place = projection + (bias + root N(0, 1)) / s,   covariance = root root^T / s^2

    Stars are those of `outcomes`, those among them that the tracker does not know. What lets a star
    pass the threshold makes it brighter, and what is divided by the brighter flux smaller. False
    spots lie anywhere and look like stars at the threshold, which they pass as seldom as the tail
    of a normal law has it.

    icrs_to_camera  true attitude at the middle of the exposure
    Returns         Spots, brightest first; their areas are not known, 0
    Errors          as `outcomes`
    """
    refuse(case)
    plan = plan_of(case)
    key = trial_keys(streams.seed, np.array([streams.trial], np.uint64))[0]
    table = _draw(icrs_to_camera.as_matrix(), key, *plan)
    table = table[np.argsort(-table[:, 2], kind="stable")][: case.tracker.detection.max_spots]
    x, y, flux, sigma, xx, xy, yy = table.T.copy()
    covariance = np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2)
    return Spots(x, y, flux, covariance, flux / sigma, np.zeros(len(x), np.int64))


@njit(cache=True, error_model="numpy")
def _draw(a, key, response, pull, field, companions, view, gate, false):  # type: ignore[no-untyped-def]
    """The table of all that is found, stars first; the gate is the tracker's matter."""
    stars = sights(a, key, response, pull, field, companions, view)
    noise = false_spots(key, false)
    table = np.empty((len(stars) + noise, ROW))
    for n in range(len(stars)):
        _write(table[n], stars[n])
    for n in range(noise):
        _strew(table[len(stars) + n], bits(key, FALSE + np.uint64(1 + n)), response.least, view)
    return table


@njit(cache=True, error_model="numpy")
def _write(row, seen):  # type: ignore[no-untyped-def]
    """A star, whose noise moves it the less, the brighter noise makes it."""
    share = max(1 + seen.blur * seen.surplus, seen.blur)
    row[0], row[1] = seen.x + seen.dx / share, seen.y + seen.dy / share
    row[2], row[3] = seen.flux * share, seen.flux * seen.blur
    row[4] = seen.xx * seen.xx / share**2
    row[5] = seen.xx * seen.yx / share**2
    row[6] = (seen.yx * seen.yx + seen.yy * seen.yy) / share**2


@njit(cache=True, error_model="numpy")
def _strew(row, start, least, view):  # type: ignore[no-untyped-def]
    """Write a false spot: anywhere, and as bright as the tail of a normal law has it."""
    across, down = view.columns - 2 * view.border, view.rows - 2 * view.border
    row[0] = view.border - 0.5 + across * uniform(bits(start, np.uint64(0)))
    row[1] = view.border - 0.5 + down * uniform(bits(start, np.uint64(1)))
    row[2:] = least
    row[2] -= math.log(uniform(bits(start, np.uint64(2)))) * least[1] ** 2 / least[0]
