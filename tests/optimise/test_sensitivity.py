import dataclasses
import math

import numpy as np
import pytest
import scipy

from startrack.core import arcsec
from startrack.design.variables import DesignSpace, Variable
from startrack.optimise import sensitivity as module
from startrack.optimise.sensitivity import sensitivities


def test_a_power_law_has_known_slopes_and_indices(small, monkeypatch):
    """ln error = 2 ln focal length - 1/2 ln exposure on log scales: a sum, so that first and
    total indices are alike, in proportion to (power times range)^2."""
    focal, exposure = small.campaign.variables[0], small.campaign.variables[3]
    space = DesignSpace(small.case, (focal, exposure))

    def law(case, _, seed):
        return case.instrument.optics.focal_length**2 / math.sqrt(case.instrument.detector.exposure)

    monkeypatch.setattr(module, "expected_objective", law)
    one, other = sensitivities(space, small.campaign, seed=1, designs=512)
    assert one.slope == pytest.approx(2, rel=1e-3)
    assert other.slope == pytest.approx(-0.5, rel=1e-3)
    fractions = np.array([2 * math.log(70 / 15), 0.5 * math.log(400 / 10)]) ** 2
    fractions /= fractions.sum()
    for index, fraction in zip((one, other), fractions, strict=True):
        assert index.first.value == pytest.approx(fraction, abs=0.05)
        assert index.total.value == pytest.approx(fraction, abs=0.05)
        assert index.first.low < fraction < index.first.high
    assert one.high / one.low == pytest.approx((70 / 15) ** 2)
    assert one.low < one.error < one.high


def test_a_design_without_an_attitude_is_refused(small, blind):
    space = DesignSpace(blind, small.campaign.variables[:1])
    with pytest.raises(ValueError, match="must be expected to find"):
        sensitivities(space, dataclasses.replace(small.campaign), seed=1, designs=2)


def test_a_variable_alone_has_all_of_the_variance_and_zero_no_slope(small):
    """One variable, which starts at zero."""
    detector = dataclasses.replace(small.case.instrument.detector, read_noise=0.0)
    quiet = dataclasses.replace(
        small.case, instrument=dataclasses.replace(small.case.instrument, detector=detector)
    )
    name = "instrument.detector.read_noise"
    space = DesignSpace(quiet, (Variable(name, "0 electron", "20 electron"),))
    (one,) = sensitivities(space, small.campaign, seed=1, designs=2)
    assert one.first.value == one.total.value == 1
    assert one.slope == 0
    assert one.low == one.error


def test_base_designs_that_are_no_power_of_two_are_refused(small):
    with pytest.raises(ValueError, match="designs must be a power of two, got 65"):
        sensitivities(DesignSpace(small.case, small.campaign.variables[:2]), small.campaign, 1, 65)


def test_the_same_seed_has_the_same_intervals_and_another_one_others(small, monkeypatch):
    """The points are of the seed, and so are the resamples; the indices are those of scipy."""
    space = DesignSpace(small.case, small.campaign.variables[:2])

    def law(case, _=None, seed=1):
        return case.instrument.optics.focal_length * math.sqrt(case.instrument.optics.f_number)

    monkeypatch.setattr(module, "expected_objective", law)
    first, again, other = (sensitivities(space, small.campaign, s, designs=16) for s in (1, 1, 2))
    assert first == again
    assert first != other

    def log_error(coordinates):
        return math.log(law(space.design(coordinates)) / arcsec)

    indices = scipy.stats.sobol_indices(
        func=lambda points: np.array([log_error(coordinates) for coordinates in points.T])[None],
        n=16,
        dists=[scipy.stats.uniform()] * 2,
        rng=np.random.default_rng(1),
    )
    np.testing.assert_array_equal([one.first.value for one in first], indices.first_order.ravel())
    np.testing.assert_array_equal([one.total.value for one in first], indices.total_order.ravel())
    spread = indices.bootstrap(confidence_level=0.95).first_order.confidence_interval
    assert first[0].first.high == pytest.approx(np.ravel(spread.high)[0], rel=0.2)
