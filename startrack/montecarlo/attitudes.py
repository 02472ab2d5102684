"""Attitudes of trials: random, at Sobol points, or where an event is likely."""

import math
from collections.abc import Sequence

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from startrack.core import Floats, Ints, Parameters, Range, Refused, Streams, parameter
from startrack.observation import random_attitudes, rotations_from_cube


class Regions(Parameters):
    """Bands of equal height in the sine of the declination, cut by hours of right ascension.

    Archimedes: the area of a band of a sphere is proportional to its height, so all cells are
    equal.
    """

    bands: int = parameter(limit=Range(1, 1000), default=6)
    sectors: int = parameter(limit=Range(1, 1000), default=12)

    def __len__(self) -> int:
        return self.bands * self.sectors

    def of(self, direction: Floats) -> Ints:
        """The cell (n,) of each direction (n, 3), ICRS axes."""
        x, y, z = direction.T
        band = np.floor((z + 1) / 2 * self.bands)
        sector = np.floor((np.arctan2(y, x) / (2 * math.pi) % 1.0) * self.sectors)
        return np.asarray(
            np.clip(band, 0, self.bands - 1) * self.sectors + np.clip(sector, 0, self.sectors - 1),
            np.int64,
        )

    def place(self, cell: Ints, fraction: Floats) -> Floats:
        """Directions (n, 3) from fractions (n, 2) in [0, 1); uniform fractions are uniform in the
        cells."""
        band, sector = np.divmod(cell, self.sectors)
        z = 2 * (band + fraction[:, 0]) / self.bands - 1
        angle = 2 * math.pi * (sector + fraction[:, 1]) / self.sectors
        radius = np.sqrt(1 - z * z)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])

    def corners(self) -> tuple[Floats, Floats]:
        """Right ascensions (sectors + 1,) and declinations (bands + 1,) of the borders, radian."""
        return (
            np.linspace(0, 2 * math.pi, self.sectors + 1),
            np.arcsin(np.linspace(-1, 1, self.bands + 1)),
        )


REPLICATES = 16  # independent scrambles; their scatter gives the error; by hand


def at_random(seed: int, numbers: Sequence[int]) -> Rotation:
    """Attitudes icrs_to_camera of `run_random_trial`: independent, uniform over all rotations."""
    return random_attitudes(seed, numbers)


def by_sobol(seed: int, numbers: Sequence[int]) -> Rotation:
    """Attitudes of scrambled Sobol points, each uniform over all rotations.

    Trial n is at point n // 16 of scramble n % 16, so that each scramble is a separate sample.

    Source: Owen (1998), J. Complexity 14, 466.
    """
    number = np.asarray(numbers, np.int64)
    fraction = np.empty((len(number), 3))
    for replicate in np.unique(number % REPLICATES):
        mine = number % REPLICATES == replicate
        fraction[mine] = _points(seed, int(replicate), number[mine] // REPLICATES)
    return rotations_from_cube(fraction)


def towards(boresight: Floats, roll: Floats) -> Rotation:
    """Attitudes icrs_to_camera with these boresights (n, 3), rotated about them by (n,) radian."""
    x, y, z = boresight.T
    # Right ascension and declination turn the camera's +z there, after the roll.
    turn = np.column_stack([np.arctan2(y, x), np.arccos(np.clip(z, -1, 1)), roll])
    return Rotation.from_euler("ZYZ", turn).inv()


def _points(seed: int, replicate: int, index: Ints) -> Floats:
    """Some points (n, 3) of one scramble."""
    engine = scipy.stats.qmc.Sobol(3, rng=Streams(seed, replicate)("sobol"))
    first = int(index.min())
    if first:
        engine.fast_forward(first)
    # A power of two, because scipy would warn otherwise; the balance is up to the caller.
    count = 1 << (int(index.max()) - first).bit_length()
    return np.asarray(engine.random(count)[index - first])


DEFENCE = 0.2  # fraction of uniformly distributed trials, so that no weight exceeds 5


def chances(score: Floats) -> Floats:
    """Probability of trials in each region.

    A defensive mixture: a part is uniform, the rest is proportional to the scores.

        q_k = d / K + (1 - d) s_k / sum s

    Source: Hesterberg (1995), Technometrics 37(2), 185.

    score    (K,) not negative, rough likelihood of the event in each region; any score is valid, a
             good one reduces the variance
    Returns  (K,) 1, sums to 1
    """
    total = float(score.sum())
    if not (np.isfinite(score).all() and (score >= 0).all() and total > 0):
        raise Refused("score must be finite, not negative, and somewhere positive")
    return np.asarray(DEFENCE / len(score) + (1 - DEFENCE) * score / total)


def where_likely(
    seed: int, numbers: Sequence[int], regions: Regions, chance: Floats
) -> tuple[Rotation, Floats]:
    """Attitudes icrs_to_camera, more of them where `chance` is larger, and their weights.

    Returns  attitudes; weights (n,) 1, the uniform density over the sampled density. The mean of
             weight times indicator is the probability of the event, for any chances.
    """
    fraction = np.array([Streams(seed, number)("rare").random(4) for number in numbers])
    cell = np.searchsorted(np.cumsum(chance)[:-1], fraction[:, 0], side="right")
    boresight = regions.place(cell, fraction[:, 1:3])
    return towards(boresight, 2 * math.pi * fraction[:, 3]), 1 / (len(regions) * chance[cell])
