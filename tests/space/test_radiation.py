"""Protons of an orbit behind a shield, beside SPENVIS and closed forms."""

import math
import sys

import numpy as np
import pytest

from startrack.core import Refused
from startrack.detector import Age
from startrack.detector.ageing import INCLINATION, PROTON_RAD, THICKNESS, YEAR, orbit_dose
from startrack.space import proton_map, radiation, trapped_protons
from startrack.space.radiation import (
    SILICON,
    Protons,
    field_lines,
    left_behind,
    solar_protons,
    stopping,
)


@pytest.mark.parametrize("places", [450, pytest.param(radiation.PLACES, marks=pytest.mark.slow)])
def test_spectra_of_other_orbits_are_those_of_spenvis(oracle, places, monkeypatch):
    """AP-8 in a polar orbit at 825 km and an inclined one at 530 km, by another field of the Earth
    of those years: each energy within 15 %.
    """
    pytest.importorskip("radbelt")
    monkeypatch.setattr(radiation, "PLACES", places)
    trapped_protons.cache_clear()
    for orbit in oracle("spenvis_protons.json")["orbits"]:
        tilt = math.radians(orbit["inclination_deg"])
        found = trapped_protons(1e3 * orbit["altitude_km"], tilt)
        energy, above = np.array([pair for pair in orbit["above"] if pair[0] < 390]).T
        own = np.exp(np.interp(np.log(energy), np.log(found.energy), np.log(found.above)))
        np.testing.assert_allclose(own, above, rtol=0.15)
    trapped_protons.cache_clear()


def test_energy_that_is_left_loses_what_the_shield_takes():
    """The loss in a thin sheet is stopping power times thickness; one range stops all."""
    energy = np.array([50.0, 100.0, 200.0])
    thin = 1e-5
    lost = energy - left_behind(energy, thin)
    np.testing.assert_allclose(lost, 100 * thin * 2.70 * stopping(energy), rtol=2e-3)
    assert left_behind(np.array([30.0]), 20e-3)[0] == 0
    twice = left_behind(left_behind(energy, 2e-3), 3e-3)
    np.testing.assert_allclose(twice, left_behind(energy, 5e-3), rtol=1e-4)


def test_a_line_of_energy_has_the_dose_of_its_stopping_power():
    narrow = Protons(np.array([99.9, 100.1]), np.array([1e6, 1e-30]))
    number, rad = narrow.behind(1e-9)
    assert number == pytest.approx(1e6, rel=1e-3)
    assert rad == pytest.approx(
        1e6 * float(stopping(np.array(100.0), SILICON)) * 1.602e-8, rel=0.01
    )


@pytest.mark.slow  # as many places as elsewhere
def test_the_dose_at_550_km_is_that_of_spenvis():
    """Of AP-8 and SHIELDOSE-2, within 1.3: expected before the comparison."""
    pytest.importorskip("radbelt")
    k = 6  # a polar orbit
    found = trapped_protons(550e3, INCLINATION[k])
    rad = np.array([YEAR * found.behind(thick)[1] for thick in THICKNESS])
    assert (np.abs(np.log(rad / PROTON_RAD[k])) < np.log(1.3)).all()


def test_solar_protons_come_where_field_lines_are_open():
    """A geostationary orbit sees all of King's event, a low one near the equator none of it."""
    pytest.importorskip("radbelt")
    far, low = (solar_protons(height, 0.1) for height in (35786e3, 500e3))
    assert np.interp(30.0, far.energy, far.above) == pytest.approx(7.9e9, rel=0.05)
    assert not low.above.any()
    line, _ = field_lines(np.zeros(1), np.zeros(1), 35786e3)
    assert line[0] == pytest.approx(6.6, rel=0.03)


def test_detectors_age_by_their_orbit(monkeypatch):
    pytest.importorskip("radbelt")
    monkeypatch.setattr(radiation, "PLACES", 200)
    trapped_protons.cache_clear()
    year = {"time": YEAR, "inclination": 1.7, "shielding": 5e-3}
    low, high, active = (
        Age(**year, **more)
        for more in ({}, {"altitude": 800e3}, {"altitude": 800e3, "solar_events": 1 / YEAR})
    )
    assert 2 < high.protons / low.protons < 6
    assert active.protons > 1.5 * high.protons
    trapped_protons.cache_clear()
    with pytest.raises(Refused, match="altitude and solar_events must be left out"):
        Age(time=YEAR, altitude=800e3)


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "radbelt", None)
    with pytest.raises(ImportError, match=r"startrack\[radiation\]"):
        orbit_dose(801e3, 1.7, 5e-3, 0.0)


@pytest.mark.slow  # AP-8 at thousands of places
def test_a_map_of_protons_has_the_anomaly_and_the_mean_of_its_orbits():
    """Beside `trapped_protons` of an inclined orbit, whose places are others; AP-8's anomaly lies
    over South America and the Atlantic. Tracks have 1.7 to 20 times the charge of a particle at
    the minimum of ionisation, 80 electrons a micrometre."""
    pytest.importorskip("radbelt")
    height, tilt, shield = 600e3, math.radians(60), 5e-3
    found = proton_map(height, shield)
    row, column = np.unravel_index(found.rate.argmax(), found.rate.shape)
    assert -45 < -90 + 4 * row < -10
    assert 280 < 4 * column < 345
    turn, east = radiation._places()
    mean = found(np.arcsin(np.sin(tilt) * np.sin(turn)), east).mean()
    assert 2 * mean / 1e4 == pytest.approx(trapped_protons(height, tilt).behind(shield)[0], rel=0.1)
    assert 1.7 < found.charge / 80e6 < 20
    # Between nodes along straight lines, all round the Earth.
    at = found(np.radians([-30.0, -30.0]), np.radians([-2.0, 358.0]))
    assert at[0] == pytest.approx(at[1])
    low, high = found.rate[15, 89], found.rate[15, 0]
    assert at[0] == pytest.approx((low + high) / 2)
