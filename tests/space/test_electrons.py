"""Electrons and their photons in aluminium, against SHIELDOSE-2, published values and closed
forms."""

import hashlib

import build_electrons as electrons
import numpy as np
import pytest
from build_electrons import displacing, follow, path_length, photon_spectrum, radiated, stopping

from startrack.core import YEAR
from startrack.io import shipped
from startrack.space.electrons import ARRAYS, Electrons, electron_table
from startrack.space.radiation import MEV_RAD, Protons


def test_paths_and_yields_are_those_of_icru_37():
    """g / cm2 in aluminium, and MeV cm2 / g: ICRU report 37 (1984); atoms of silicon as Summers et
    al. (1993) have them."""
    energy = np.array([0.1, 1.0, 5.0])
    np.testing.assert_allclose(path_length(energy), [0.01872, 0.5546, 3.093], rtol=0.01)
    slow = np.linspace(1e-3, 1.0, 2000)
    part = radiated(slow) / (radiated(slow) + stopping(slow))
    assert np.trapezoid(part, slow) == pytest.approx(0.0076, rel=0.1)
    assert displacing(np.array(1.0)) == pytest.approx(3.1e-5, rel=0.1)
    assert displacing(np.array(0.2)) == 0  # 36 eV twice over are needed: not enough to move one


@pytest.mark.parametrize("energy", [0.3, 1.0, 5.0])
def test_photons_have_the_energy_that_electrons_radiate(energy, monkeypatch):
    """Two formulas of the same cross-section, one of which is the integral of the other."""
    fine = np.geomspace(1e-4 * energy, 0.99999 * energy, 3000)
    monkeypatch.setattr(electrons, "PHOTON", fine)
    total = np.trapezoid(photon_spectrum(energy), fine)
    assert total == pytest.approx(float(radiated(np.array(energy))), rel=2e-3)


def test_without_scattering_a_sphere_has_the_flux_outside(monkeypatch):
    """The flux at the centre equals the flux outside, up to the range.

    On average over depths, because beams of single directions do not merge without scattering.
    """
    monkeypatch.setattr(electrons, "_turning", lambda energy, most: np.zeros(most + 1))
    left = follow.__wrapped__(2.0).left[0]
    for inner in (slice(3, 30), slice(30, 57)):
        assert left[inner].mean() == pytest.approx(1.0, rel=0.1)


def test_electrons_of_one_energy_have_the_dose_of_shieldose(oracle):
    """If they penetrate: within 1.3, a limit that was set before SHIELDOSE-2 was run."""
    found = oracle("shieldose.json")
    compared = 0
    for line in found["rad_cm2_per_electron_of_one_energy"]:
        some = np.linspace(0.97, 1.03, 21) * line["mev"]
        beam = Electrons(some, np.linspace(1, 0, 21) + 1e-12)
        for thick, rad in zip(found["aluminium_mm"], line["electrons"], strict=True):
            if rad > 1e-8:
                own = MEV_RAD * beam.behind(1e-3 * thick).loss
                assert abs(np.log(own / rad)) < np.log(1.3)
                compared += 1
    assert compared > 15


def test_bremsstrahlung_lies_between_those_of_two_kinds_of_source(oracle):
    """SHIELDOSE-2 has the dose D at a plane and takes 2 (D - z dD / dz) for the centre of a sphere:
    right where photons enter at the surface as a flux from all sides does. Where they are made at
    the surface in all directions alike it is -2 z dD / dz. Electrons that turn are in between."""
    found = oracle("shieldose.json")
    lines = found["rad_cm2_per_electron_of_one_energy"]
    for line in (line for line in lines if line["mev"] <= 2):
        some = np.linspace(0.97, 1.03, 21) * line["mev"]
        beam = Electrons(some, np.linspace(1, 0, 21) + 1e-12)
        own = MEV_RAD * beam.behind(10e-3).photons
        most, plane = line["bremsstrahlung"][-1], line["bremsstrahlung_plane"][-1]
        assert most - 2 * plane < own < most


def test_spectra_of_the_belts_have_the_dose_of_shieldose(oracle):
    """Of electrons and protons within 1.3, behind 1 to 5 mm of electrons within 10 %, which their
    straggling decides; with bremsstrahlung, too, except behind 10 mm in the two
    high orbits, where SHIELDOSE-2 has 1.6 times as much of it."""
    found = oracle("shieldose.json")
    ratios = {}
    for orbit in found["orbits"]:
        rad = orbit["rad_per_year"]
        beam = Electrons(*np.array(orbit["electrons_above"]).T)
        energy, above = np.array([pair for pair in orbit["protons_above"] if pair[0] >= 4]).T
        for k, thick in enumerate(found["aluminium_mm"]):
            behind = beam.behind(1e-3 * thick)
            if thick < 10:
                loss = YEAR * MEV_RAD * behind.loss
                assert loss == pytest.approx(rad["electrons"][k], rel=0.1)
            protons = YEAR * Protons(energy, above).behind(1e-3 * thick)[1]
            own = YEAR * MEV_RAD * behind.loss + protons
            assert own == pytest.approx(rad["electrons"][k] + rad["protons"][k], rel=0.3) or (
                thick == 10 and orbit["altitude_km"] > 20000
            )
            total = own + YEAR * MEV_RAD * behind.photons
            ratios[orbit["altitude_km"], thick] = total / sum(row[k] for row in rad.values())
    missed = {key for key, ratio in ratios.items() if abs(np.log(ratio)) > np.log(1.3)}
    assert missed == {(20200, 10), (35786, 10)}
    assert all(0.55 < ratios[key] < 0.75 for key in missed)


def test_the_shipped_table_is_the_one_that_was_built():
    folder = shipped("radiation")
    digest, name = (folder / "SHA256SUMS").read_text().split()
    assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_the_script_builds_the_shipped_table():
    shown = electron_table()
    for name, values in electrons.table().items():
        np.testing.assert_allclose(getattr(shown, name), values, rtol=1e-9, atol=1e-300)
    assert set(electrons.table()) == set(ARRAYS)


def test_nothing_comes_of_nothing():
    energy = np.array([0.1, 1.0, 7.0])
    assert Electrons(energy, np.zeros(3)).behind(1e-3) == (0, 0, 0, 0)
    stopped = Electrons(energy, np.array([1e6, 1e4, 0.0])).behind(0.1)
    assert stopped[:3] == (0, 0, 0)
    assert stopped.photons > 0
