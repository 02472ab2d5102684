"""Detectors at an age, compared with Chandra's aspect camera in flight and laws of other
authors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from startrack.core import YEAR, Streams
from startrack.detector import Detector, Thermal
from startrack.detector.ageing import (
    CHANDRA_ACA,
    Age,
    Flicker,
    Flickering,
    damage,
    mean_damage,
    pixels_above,
    proton_dose,
    trailed,
)
from startrack.detector.exposure import frame_of
from startrack.detector.maps import dark

DOUBLING = 4 * math.log(2) / -math.log(0.70)  # kelvin: 0.70 for 4 K less
CELSIUS = 273.15


def aspect_camera(year, celsius, **changes):
    """A CCD whose dark currents are given at -14 degC, where few pixels have less than 2 e-/s."""
    thermal = Thermal(celsius + CELSIUS, CELSIUS - 14, DOUBLING)
    age = Age(year=year, launch=1999.56, family="chandra-aca", **changes)
    return Detector(1024, 1024, 24e-6, 1.7, dark_current=1.0, thermal=thermal, age=age)


@pytest.mark.parametrize("number", range(6))
def test_the_histogram_is_that_in_flight(oracle, number):
    """Every bin of 2 to 2,000 e-/s within 2 % (the fit has its breaks on the edges of bins)."""
    flown = oracle("chandra_dark.json")["histograms"][number]
    edges, pixels = np.array(flown["edges_e_per_s"]), np.array(flown["pixels"])
    scale = 0.7 ** ((flown["temperature_c"] + 14) / 4)
    above = pixels_above(CHANDRA_ACA, edges * scale, flown["year"] - 1999.56) * 2**20
    inside = edges[1:] < 2010
    np.testing.assert_allclose((above[:-1] - above[1:])[inside], pixels[inside], rtol=0.02)
    warm = edges[:-1] > 99
    assert above[:-1][warm][0] == pytest.approx(pixels[warm].sum(), rel=0.005)


@pytest.mark.parametrize("number", [1, 4])
def test_the_pixels_of_a_device_have_it(oracle, number):
    """Counts of a drawn map: chi-square over bins of 20 to 2,000 e-/s; false alarm 1e-4."""
    flown = oracle("chandra_dark.json")["histograms"][number]
    edges, pixels = np.array(flown["edges_e_per_s"]), np.array(flown["pixels"])
    current = dark(aspect_camera(flown["year"], flown["temperature_c"]))
    counted, _ = np.histogram(current / CHANDRA_ACA.electrons, edges)
    inside = (edges[:-1] > 19.9) & (edges[1:] < 2010)
    # The law errs by up to 0.6 % of a bin, beside which the counts scatter.
    variance = pixels[inside] + (0.006 * pixels[inside]) ** 2
    square = (counted[inside] - pixels[inside]) ** 2 / variance
    assert square.sum() < stats.chi2.isf(1e-4, inside.sum())
    assert current.min() == pytest.approx(0.7 ** (-(flown["temperature_c"] + 14) / 4))


def test_a_pixel_never_cools_with_age():
    young, old = (dark(aspect_camera(year, -14)) for year in (2005.0, 2020.0))
    usual = young < 2000
    assert usual.mean() > 0.999
    assert (old >= young)[usual].all()
    assert np.mean(old > 100) > 3 * np.mean(young > 100)


def chance_below(law, current, step):
    """P(s < step), (currents, steps), by the equation of `Flicker`."""
    scale = law.scale(current)[:, None]
    below = law.down * np.exp(np.minimum(step, 0) / scale)
    chance = np.where(step < 0, below, 1 - (1 - law.down) * np.exp(-np.maximum(step, 0) / scale))
    return np.where(step < -law.largest, 0.0, np.where(step < law.largest, chance, 1.0))


def test_flickering_pixels_follow_the_laws_in_flight(oracle):
    """Nine cumulative laws within 0.03; four of them were not used to fit the law."""
    flown = oracle("chandra_dark.json")["flicker"]
    step, law = np.array(flown["log10_step"]), Flicker()
    rng = np.random.default_rng(0)
    for low, high, laws in zip(
        flown["dark_from_e_per_s"], flown["dark_to_e_per_s"], flown["cumulative"], strict=True
    ):
        current = np.exp(rng.uniform(math.log(low), math.log(min(high, 3000)), 20000))
        current = np.maximum(current, low * (1 + 1e-9))  # above the least that flickers
        state = Flickering(law, current[None], Streams(1, 0))
        state.later(1e9)
        drawn = np.searchsorted(np.sort(state.step), step, side="right") / len(current)
        assert np.abs(drawn - laws).max() < 0.03, low
        assert np.abs(drawn - chance_below(law, current, step).mean(axis=0)).max() < 0.015


def test_flicker_dwells():
    state = Flickering(Flicker(dwell=100.0), np.full((1, 20000), 200.0), Streams(2, 0))
    before = state.step.copy()
    state.later(50.0)
    stayed = np.mean(state.step == before)
    assert stayed == pytest.approx(math.exp(-0.5), abs=4 * 0.0035)


def test_a_frame_has_flicker_but_its_map_does_not():
    still = aspect_camera(2020.0, -5)
    detector = replace(still, age=replace(still.age, flicker=Flicker()))
    mean = dark(detector) * detector.exposure
    assert (dark(detector) == dark(still)).all()
    one, two = (frame_of(mean, detector, Streams(1, n)).image.astype(float) for n in (1, 2))
    hot = mean > 500
    scatter = np.std((one - two)[hot]) * detector.electrons_per_dn
    # Two jumps of some 0.05 decades each, beside the shot noise of two frames.
    assert scatter > 2 * math.sqrt(2 * mean[hot].mean())


def test_interactions_have_the_mean_of_srour_and_the_shape_of_robbins():
    """2e9 protons / cm^2 of 10 MeV through 5 um of silicon, in pixels of 10 um at 300 K."""
    age = Age(time=5 * YEAR, fluence=4e8 * 1e4 / YEAR, depleted=5e-6)
    thermal = Thermal(300.0, 300.0)
    detector = Detector(512, 512, 10e-6, 1.0, dark_current=10.0, thermal=thermal, age=age)
    added = dark(detector) - 10.0
    expected = 1.9e5 * 7.9e-3 * 2e9 * 500e-12
    each = 4000 * math.exp(-0.63 / 8.617333e-5 * (1 / 300 - 1 / 296))
    hit = expected / each
    # Mean and variance of a sum of a Poisson number of exponentials: 4 sigma of their estimates.
    assert added.mean() == pytest.approx(expected, abs=4 * each * math.sqrt(2 * hit) / 512)
    assert np.mean(added > 0) == pytest.approx(-math.expm1(-hit), abs=4 * 0.5 / 512)
    assert added.var() == pytest.approx(2 * hit * each**2, rel=0.06)
    healed = replace(detector, age=replace(age, annealed=0.5))
    assert (dark(healed) - 10).mean() == pytest.approx(expected / 2, rel=0.05)


def test_the_dose_behind_a_shield_is_that_of_spenvis_between_its_nodes(oracle):
    """Inclinations and thicknesses between those of the table."""
    for inclination, millimetre, rad in oracle("dose_depth.json")["proton_rad_per_year"]:
        found = proton_dose(math.radians(inclination), millimetre * 1e-3)
        assert found == pytest.approx(rad, rel=0.08)


def test_a_thicker_shield_lets_a_detector_age_less():
    """The shielded dose ages a detector as a fluence does; 139 rad a year are 4.3e8 protons /
    cm^2 of 10 MeV."""
    polar = math.radians(100)
    thin, thick = (Age(time=YEAR, inclination=polar, shielding=mm * 1e-3) for mm in (2, 10))
    ratio = thin.protons / thick.protons
    assert ratio == pytest.approx(proton_dose(polar, 2e-3) / proton_dose(polar, 10e-3))
    dose = 0.01 * proton_dose(polar, 2e-3) / YEAR  # gray / s
    assert Age(time=YEAR, dose=dose).protons == pytest.approx(thin.protons)
    middle = Age(time=YEAR, inclination=polar, shielding=5e-3).protons * 1e-4 * YEAR
    assert middle == pytest.approx(4.3e8, rel=0.05)
    detector = Detector(64, 64, 10e-6, 1.0, dark_current=10.0, thermal=Thermal(300.0, 300.0))
    same = Age(time=YEAR, fluence=thin.protons)
    one, other = (dark(replace(detector, age=age)) for age in (thin, same))
    assert (one == other).all()
    assert one.mean() > dark(replace(detector, age=thick)).mean()


def test_charge_that_is_left_behind_arrives_a_row_later():
    electrons = np.zeros((100, 3))
    electrons[79, 1] = 1e4
    moved = trailed(electrons, 1e-4)
    assert moved.sum() == pytest.approx(1e4)
    assert moved[80, 1] == pytest.approx(1e4 * (1 - (1 - 1e-4) ** 80))


@pytest.mark.parametrize(
    ("values", "rule"),
    [
        ({}, "^time must be given, or year and launch"),
        ({"time": 1.0, "year": 2000.0, "launch": 1999.0}, "not both"),
        ({"year": 1990.0, "launch": 1999.0}, "before launch"),
        ({"time": 1.0, "family": "unknown"}, "family"),
        ({"time": 1.0, "family": "chandra-aca", "fluence": 1.0}, "left out"),
        ({"time": 1.0, "inclination": 1.7}, "^inclination and shielding must be given"),
        ({"time": 1.0, "inclination": 1.7, "shielding": 5e-3, "fluence": 1.0}, "left out"),
        ({"time": 1.0, "inclination": 1.7, "shielding": 1e-4}, "shielding"),
        ({"time": 1.0, "dose": 1e-8, "fluence": 1.0}, "left out"),
    ],
)
def test_ages_that_make_no_sense_are_refused(values, rule):
    with pytest.raises(ValueError, match=rule):
        Age(**values)


def test_damage_that_no_float_can_hold_is_the_mean():
    """Near 1 K the growth of an interaction underflows."""
    found = damage((2, 3), Age(time=1e8, fluence=10.0), 1e-10, 1.0, Streams(0, 0))
    np.testing.assert_array_equal(found, mean_damage(Age(time=1e8, fluence=10.0), 1e-10, 1.0))
