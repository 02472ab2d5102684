import dataclasses
import math

import numpy as np
import pytest
from intervals_oracles import sobol_error

from startrack.core import arcsec
from startrack.design.variables import DesignSpace, Variable
from startrack.optimise import TrackerSource, TrialRunner
from startrack.optimise import source as module
from startrack.optimise.evaluate import Foresight
from startrack.optimise.sensitivity import sensitivities


def by_law(monkeypatch, law):
    """Designs that are forecast by a law of their case, radian."""

    def forecast(space, _, points, *__, **___):
        return [Foresight(math.log(law(space.design(one)) / arcsec), {}) for one in points]

    monkeypatch.setattr(module, "foresee_all", forecast)


def test_a_power_law_has_known_slopes_and_indices(small, monkeypatch):
    """ln error = 2 ln focal length - 1/2 ln exposure on log scales: a sum, so that first and
    total indices are equal, proportional to (power times range)^2."""
    focal, exposure = small.campaign.variables[0], small.campaign.variables[3]
    space = DesignSpace(small.case, (focal, exposure))

    def law(case):
        return case.instrument.optics.focal_length**2 / math.sqrt(case.instrument.detector.exposure)

    by_law(monkeypatch, law)
    one, other = sensitivities(TrackerSource(space, small.campaign, TrialRunner(1)), designs=32)
    assert one.slope == pytest.approx(2, rel=1e-3)
    assert other.slope == pytest.approx(-0.5, rel=1e-3)
    fractions = np.array([2 * math.log(70 / 15), 0.5 * math.log(400 / 10)]) ** 2
    fractions /= fractions.sum()
    for index, fraction in zip((one, other), fractions, strict=True):
        assert index.first.value == pytest.approx(fraction, abs=0.02)
        assert index.total.value == pytest.approx(fraction, abs=0.02)
        assert index.first.low < fraction < index.first.high
    assert one.high / one.low == pytest.approx((70 / 15) ** 2)
    assert one.low < one.error < one.high


def test_a_design_without_an_attitude_is_refused(small, blind):
    space = DesignSpace(blind, small.campaign.variables[:1])
    with pytest.raises(ValueError, match="must have a forecast"):
        sensitivities(
            TrackerSource(space, dataclasses.replace(small.campaign), TrialRunner(1)), designs=2
        )


def test_a_variable_alone_has_all_of_the_variance_and_zero_no_slope(small):
    """One variable, which starts at zero."""
    detector = dataclasses.replace(small.case.instrument.detector, read_noise=0.0)
    quiet = dataclasses.replace(
        small.case, instrument=dataclasses.replace(small.case.instrument, detector=detector)
    )
    name = "instrument.detector.read_noise"
    space = DesignSpace(quiet, (Variable(name, "0 electron", "20 electron"),))
    (one,) = sensitivities(TrackerSource(space, small.campaign, TrialRunner(1)), designs=2)
    assert one.first.value == one.total.value == 1
    assert math.isnan(one.slope)
    assert one.low == one.error


def test_whole_numbers_have_a_slope_between_two_of_them(small, monkeypatch):
    """A hundredth of the range changes a number of stars by less than one."""
    name = "tracker.detection.max_spots"
    space = DesignSpace(small.case, (Variable(name, 95, 105),))
    by_law(monkeypatch, lambda case: 1 / case.tracker.detection.max_spots)
    (one,) = sensitivities(TrackerSource(space, small.campaign, TrialRunner(1)), designs=2)
    assert one.slope == pytest.approx(-1, abs=0.05)


@pytest.mark.slow
def test_each_design_is_reported(small):
    space, done = DesignSpace(small.case, small.campaign.variables[:2]), []
    sensitivities(TrackerSource(space, small.campaign, TrialRunner(1)), 4, done.append)
    assert sum(done) == 4 * 2 + 4


def test_base_designs_that_are_no_power_of_two_are_refused(small):
    space = DesignSpace(small.case, small.campaign.variables[:2])
    source = TrackerSource(space, small.campaign, TrialRunner(1))
    with pytest.raises(ValueError, match="designs must be a power of two, got 65"):
        sensitivities(source, 65)


def test_of_a_product_the_total_indices_are_larger(small, monkeypatch):
    """For u v over the unit square: 3/7 each alone, 4/7 in all; and the same for the same seed."""
    space = DesignSpace(small.case, small.campaign.variables[:2])
    names = [variable.name for variable in space.variables]

    def law(case):
        u, v = space.coordinates(case)
        return math.exp(u * v)

    by_law(monkeypatch, law)
    sources = [TrackerSource(space, small.campaign, TrialRunner(seed)) for seed in (1, 1, 2)]
    runs = [sensitivities(source, 32) for source in sources]
    assert runs[0] == runs[1] != runs[2]
    assert [one.name for one in runs[0]] == names
    for one in runs[0]:
        assert one.first.value == pytest.approx(3 / 7, abs=0.02)
        assert one.total.value == pytest.approx(4 / 7, abs=0.02)
        assert one.first.low < one.first.value < one.first.high


def test_indices_are_those_of_salib():
    """The least error of a centroid over flux, width and noise, with 128 designs, against 320.

    For 64 to 1,024 base designs of SALib the largest difference was 0.002 to 0.012; SALib's own
    error is 0.01 for 256; allowed: 0.03.
    """
    pytest.importorskip("SALib", reason="SALib is not installed: indices stand beside no other")
    assert sobol_error(64) < 0.03
