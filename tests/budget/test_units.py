"""Budgets of units: classes, levels by interpretation, and the interval of a yield."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from startrack.attitude import Mounting
from startrack.budget import Term, UnitBudgets, analytic, unit_budgets
from startrack.core import YEAR, arcsec
from startrack.design import CameraCalibration, Moment, Variation, load_design
from startrack.detection import DarkMap
from startrack.detector import Age
from startrack.io import shipped
from startrack.metrics import Interpretation, fraction_interval, level
from startrack.population import unit_of

CASE = load_design(shipped("designs/noise_only.toml")).case
ONE = np.ones


def of(mean, sigma):
    """Budgets of units (n, m) with the same error about all axes."""
    shape = (*np.broadcast_shapes(np.shape(mean), np.shape(sigma)), 3)
    weight = np.full(shape[:2], 1 / shape[1])
    wide = [np.broadcast_to(np.asarray(each)[..., None], shape) for each in (mean, sigma)]
    return UnitBudgets(0.0, *wide, weight, np.zeros((shape[0], 3)), {}, ONE(shape[0]))


@pytest.mark.parametrize("fraction", [0.683, 0.954, 0.997])
def test_levels_of_normal_errors_are_their_quantiles(fraction):
    """Units of sigma 1 and 2: temporal gives the worse unit, mixed the quantile of the mixture."""
    found = of(np.zeros((2, 4)), np.array([[1.0] * 4, [2.0] * 4]))
    quantile = stats.norm.ppf((1 + fraction) / 2)
    assert found.level([2], fraction, Interpretation.TEMPORAL) == pytest.approx(2 * quantile)
    mixed = found.level([2], fraction, Interpretation.MIXED)
    inside = np.mean([2 * stats.norm.cdf(mixed / size) - 1 for size in (1, 2)])
    assert inside == pytest.approx(fraction)
    ensemble = found.level([2], fraction, Interpretation.ENSEMBLE)
    assert ensemble == pytest.approx(mixed)


@pytest.mark.parametrize("fraction", [0.683, 0.954, 0.997])
def test_levels_of_a_swing_are_those_of_the_arcsine_law(fraction):
    """|A sin| is below A sin(pi fraction / 2) for a fraction of the time; here at 2000 times."""
    phase = (np.arange(2000) + 0.5) / 2000 * 2 * np.pi
    swing = np.sin(phase)[None]
    asked = np.sin(np.pi * fraction / 2)
    found = of(swing, np.full(swing.shape, 1e-4))
    assert found.level([2], fraction, Interpretation.MIXED) == pytest.approx(asked, rel=2e-3)
    assert level(swing, fraction, Interpretation.TEMPORAL) == pytest.approx(asked, rel=2e-3)


def test_the_interval_of_a_yield_holds_it_as_often_as_it_says():
    """200 samples of 30 units with a yield of 0.8: exact intervals contain it in at least 95 %.

    184 of 200 or fewer have a probability of 4 %, with a fixed seed.
    """
    random = np.random.default_rng(5)
    held = [
        one.low <= 0.8 <= one.high
        for one in (fraction_interval(int(random.binomial(30, 0.8)), 30) for _ in range(200))
    ]
    assert sum(held) > 184


def test_units_without_variation_have_the_budget_of_the_design():
    found = unit_budgets(CASE, 1, 2, environments=2, count_fields=64)
    budget = analytic(CASE, 64)
    assert found.across() == pytest.approx(budget.across)
    assert found.about() == pytest.approx(budget.about)
    assert np.abs(found.bias).max() == 0


def test_a_detector_is_as_old_as_its_unit():
    """At the begin the budget equals one without ageing, at the end one of a detector of that
    age."""
    age = Age(time=2 * YEAR, fluence=3e4, sensitivity_loss=0.1 / YEAR)

    def aged(age):
        detector = replace(CASE.instrument.detector, age=age)
        return replace(CASE, instrument=replace(CASE.instrument, detector=detector))

    begin, end = (unit_budgets(aged(age), 1, 1, at, 1, 64) for at in (0.0, 5 * YEAR))
    old = replace(age, time=5 * YEAR)
    for found, same in ((begin, None), (end, old)):
        # The tracker of a unit does not know of the spread of dark signals that age makes, and
        # leaves out other stars near hot pixels.
        assert found.across() == pytest.approx(analytic(aged(same), 64).across, rel=0.05)
    assert end.across()[0] > 1.2 * begin.across()[0]


def test_the_dark_map_of_a_unit_is_of_its_own_pixels():
    """The map of a unit knows its hot pixels, so that its budget is that of the unit alone."""
    instrument, detection = CASE.instrument, DarkMap(frames=8, hot=200)
    detector = replace(instrument.detector, age=Age(time=5 * YEAR, fluence=3e4))
    case = replace(
        CASE,
        instrument=replace(instrument, detector=detector),
        tracker=replace(
            CASE.tracker, detection=replace(CASE.tracker.detection, dark_map=detection)
        ),
    )
    found = unit_budgets(case, 1, 1, 5 * YEAR, 1, 64)
    alone = analytic(unit_of(case, 1, Moment(0, age=5 * YEAR)), 64)
    assert found.across() == pytest.approx(alone.across, rel=0.02)


@pytest.mark.slow
def test_what_turns_the_camera_is_bias_or_thermo_elastic():
    """A fixed misalignment is bias; one that varies over orbits is thermo-elastic, with the rms
    A / sqrt(2) of A sin."""
    name = "instrument.mounting.x"
    case = replace(
        CASE,
        variation=(
            Variation(name, sigma="30 arcsec"),
            Variation(name, "sinusoid", amplitude="10 arcsec", per="environment"),
        ),
    )
    found = unit_budgets(case, 1, 30, environments=4, count_fields=64)
    bias, thermal = found.bias[:, 0], found.terms[Term.THERMO_ELASTIC][:, 0]
    assert np.sqrt(np.mean(bias**2)) / arcsec == pytest.approx(30, rel=0.3)
    assert np.sqrt(np.mean(thermal**2)) / arcsec == pytest.approx(10 / np.sqrt(2), rel=0.1)


def test_calibration_and_alignment_are_one_cause():
    """Parts of calibration and alignment that cancel are in no class."""
    case = replace(
        CASE,
        variation=(Variation("instrument.optics.principal_x", sigma=10.0),),
        instrument=replace(CASE.instrument, mounting=Mounting(1e-3, 2e-3, 0.0)),
        tracker=replace(CASE.tracker, calibration=CameraCalibration(noise=1e-3)),
    )
    found = unit_budgets(case, 1, 3, environments=1, count_fields=64)
    assert np.abs(found.bias[:, :2]).max() / arcsec < 0.5
    assert found.terms[Term.FIELD][:, :2].max() / arcsec < 0.2


def test_the_budget_of_the_unit_as_designed_says_what_it_leaves_out():
    case = replace(CASE, variation=(Variation("instrument.optics.k1", sigma=0.1),))
    assert any("between units: 1 number" in one for one in analytic(case, 64).left_out)
