"""Exclusion angles: stray light by hand, and its effect on the tracker."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.budget import exclusions
from startrack.budget.exclusion import Exclusion
from startrack.core.units import deg
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.optics import Baffle

ANGLES = np.array([5.0, 20, 30, 40, 60, 80]) * deg


@pytest.fixture(scope="module")
def found():
    case = load_design(shipped("designs/noise_only.toml")).case
    baffle = Baffle((0.0, 30 * deg, 60 * deg), (1e-2, 1e-6, 1e-9))
    case = replace(case, instrument=replace(case.instrument, baffle=baffle))
    return case, exclusions(case, ANGLES)


def test_the_suns_stray_light_by_hand(found):
    """By hand: G -26.90 times 1e-6 f^2 / A, per square arcsecond of 2.35e-11 sr, at 30 degrees."""
    case, curves = found
    optics = case.instrument.optics
    spread = 1e-6 * optics.focal_length**2 / optics.area * 2.3504e-11
    assert curves["sun"].stray_light_g[2] == pytest.approx(
        -26.90 - 2.5 * np.log10(spread), abs=1e-3
    )


def test_the_sun_is_a_million_times_worse_than_the_moon(found):
    _, curves = found
    gap = curves["moon"].stray_light_g - curves["sun"].stray_light_g
    np.testing.assert_allclose(gap, gap[0])
    assert gap[0] == pytest.approx(14.03, abs=0.01)


def test_what_stands_nearer_costs_more(found):
    _, curves = found
    for one in curves.values():
        known = one.across[np.isfinite(one.across)]
        assert (np.diff(known) <= 1e-12).all()
        assert (np.diff(one.availability) >= -1e-9).all()
    least = {name: one.least() for name, one in curves.items()}
    assert least["moon"] < least["earth"] < least["sun"]
    assert curves["sun"].across[-1] == pytest.approx(curves["moon"].across[-1], rel=0.1)


def test_the_least_angle_is_where_all_beyond_is_well():
    angle = np.arange(1.0, 6.0)
    across = np.array([np.nan, 3.0, 1.05, 1.2, 1.0])
    curve = Exclusion(angle, 0 * angle, across, np.array([0, 0.5, 1.0, 1.0, 1.0]))
    assert curve.least() == 5.0
    assert curve.least(rise=0.3) == 3.0
    assert Exclusion(angle, angle, across, 0 * angle).least() == np.inf


def test_without_a_baffle_there_is_no_angle():
    case = load_design(shipped("designs/noise_only.toml")).case
    with pytest.raises(ValueError, match=r"instrument\.baffle or instrument\.tube must be given"):
        exclusions(case, ANGLES)
