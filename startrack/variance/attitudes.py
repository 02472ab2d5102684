"""Where trials look: at random, by Sobol's points, or in turn in each region of the sky."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.streams import Streams
from startrack.variance.regions import Regions
from startrack.view import random_attitudes, rotations

Floats = NDArray[np.float64]

REPLICATES = 16  # independent scrambles, whose scatter gives the error


def at_random(seed: int, numbers: Sequence[int]) -> Rotation:
    """Attitudes icrs_to_camera, independent and uniform over all rotations: those of `trial`."""
    return random_attitudes(seed, numbers)


def by_sobol(seed: int, numbers: Sequence[int]) -> Rotation:
    """Attitudes of scrambled Sobol points, each uniform over all rotations.

    Trial n takes point n // 16 of scramble n % 16, so that each of the 16 is a sample of its own.

    Source: Owen (1998), J. Complexity 14, 466.
    """
    number = np.asarray(numbers, np.int64)
    share = np.empty((len(number), 3))
    for replicate in np.unique(number % REPLICATES):
        mine = number % REPLICATES == replicate
        share[mine] = _points(seed, int(replicate), number[mine] // REPLICATES)
    return rotations(share)


def by_regions(seed: int, numbers: Sequence[int], regions: Regions) -> Rotation:
    """Attitudes whose boresights lie in each region in turn, uniform within it.

    Trial n looks into region n % len(regions).
    """
    share = np.array([Streams(seed, number)("region").random(3) for number in numbers])
    cell = np.asarray(numbers, np.int64) % len(regions)
    return towards(regions.place(cell, share[:, :2]), 2 * np.pi * share[:, 2])


def towards(boresight: Floats, roll: Floats) -> Rotation:
    """Attitudes icrs_to_camera with these boresights (n, 3), turned about them by (n,) radian."""
    x, y, z = boresight.T
    # Right ascension and declination take the camera's +z there; the roll is taken first.
    turn = np.column_stack([np.arctan2(y, x), np.arccos(np.clip(z, -1, 1)), roll])
    return Rotation.from_euler("ZYZ", turn).inv()


def _points(seed: int, replicate: int, index: NDArray[np.int64]) -> Floats:
    """Some points (n, 3) of one scramble."""
    engine = scipy.stats.qmc.Sobol(3, rng=Streams(seed, replicate)("sobol"))
    first = int(index.min())
    if first:
        engine.fast_forward(first)
    # A power of two, or scipy would warn of a balance that lies with the caller.
    count = 1 << (int(index.max()) - first).bit_length()
    return np.asarray(engine.random(count)[index - first])
