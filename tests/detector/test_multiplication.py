"""The register of an EMCCD against one that is simulated stage by stage."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import special

from startrack.core import Streams
from startrack.detector import Detector, frame_of
from startrack.detector.effects import _gamma_quantile, multiplied
from startrack.response import star_response
from tests.trial.designs import with_detector

# Robbins and Hadwen (2003), IEEE Trans. Electron Devices 50, 1227, eq. (9), for 536 stages.
PUBLISHED = {1.01: 1.01, 1.5: 1.33, 2: 1.50, 3: 1.66, 10: 1.89, 300: 1.98}
EMCCD = Detector(
    columns=400, rows=400, pixel_pitch=13e-6, exposure=1.0, full_well=5e6, bits=24, offset=1000
)


def by_stages(electrons, gain, stages, rng):
    """Each stage doubles an electron with the probability that gives the gain."""
    chance = gain ** (1 / stages) - 1
    for _ in range(stages):
        electrons = electrons + rng.binomial(electrons, chance)
    return electrons


@pytest.mark.parametrize("gain", PUBLISHED)
def test_variance_over_mean_is_the_published_one(gain):
    detector = dataclasses.replace(EMCCD, em_gain=gain)
    assert detector.excess_noise == pytest.approx(PUBLISHED[gain], abs=0.005)
    frame = frame_of(np.full((400, 400), 50.0), detector, Streams(1, 0))
    seen = (frame.image.astype(float) - 1000) * frame.electrons_per_dn
    # 160,000 pixels: 0.35 % of sigma at a kurtosis of 0.1; 1.5 % are exceeded once in 20,000.
    assert seen.var() / seen.mean() == pytest.approx(PUBLISHED[gain], rel=0.015, abs=0.005)
    assert frame.excess_noise == detector.excess_noise


@pytest.mark.parametrize(
    ("gain", "stages"),
    [(1.5, 536), pytest.param(10.0, 536, marks=pytest.mark.slow), (300.0, 604), (40.0, 100)],
)
def test_the_law_is_that_of_a_register_of_stages(gain, stages):
    charge = np.full((200, 200), 3.0)
    detector = dataclasses.replace(EMCCD, em_gain=gain, em_stages=stages)
    mine = multiplied(charge, detector, Streams(2, 0)).ravel()
    register = by_stages(np.full(40_000, 3), gain, stages, np.random.default_rng(3))
    assert mine.min() >= 3
    assert (mine == np.rint(mine)).all()
    # Kolmogorov and Smirnov of two samples of 40,000: 0.0147 is exceeded once in 3,000.
    values = np.unique(np.concatenate([mine, register]))
    law = [np.searchsorted(np.sort(of), values, side="right") / of.size for of in (mine, register)]
    assert np.abs(law[0] - law[1]).max() < 0.0147


def test_stated_noise_of_stars_follows_the_register():
    plain, multiplying = (
        star_response.chart(unsaturated(with_detector(**changes)), np.array([3.0])).covariance[0]
        for changes in (
            {"read_noise": 0.0, "bits": 24, "full_well": 5e7},
            {"read_noise": 0.0, "bits": 24, "full_well": 5e7, "em_gain": 300.0},
        )
    )
    ratio = (
        np.trace(multiplying, axis1=1, axis2=2).mean() / np.trace(plain, axis1=1, axis2=2).mean()
    )
    assert ratio == pytest.approx(PUBLISHED[300], rel=0.01)


def unsaturated(case):
    detection = dataclasses.replace(case.tracker.detection, saturation=None)
    return dataclasses.replace(case, tracker=dataclasses.replace(case.tracker, detection=detection))


def test_quantiles_of_few_electrons_are_those_of_the_gamma_law():
    """The interpolated quantiles, against scipy's inverse of the incomplete gamma function."""
    fraction = np.random.default_rng(1).random(20_000)
    for shape, count in (0.5, 1), (1.2, 1), (1.2, 17), (3.0, 255):
        found = _gamma_quantile(shape, np.full(len(fraction), count), special.ndtri(fraction))
        expected = special.gammaincinv(shape * count, fraction)
        assert found == pytest.approx(expected, abs=1e-9 * math.sqrt(shape * count))
    assert (_gamma_quantile(1.2, np.zeros(2, int), np.array([-9.0, 9.0])) == 0).all()
