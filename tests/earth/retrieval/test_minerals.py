"""Minerals: temperature, emissivity, Christiansen feature and class, by formula and by trials."""

from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.modeling.models import BlackBody

from startrack.core import Refused, um
from startrack.earth.atmosphere import Air
from startrack.earth.imager import band_of
from startrack.earth.retrieval import (
    EarthProblem,
    forecast_minerals,
    identify_minerals,
    library,
    load_earth_design,
    observe_minerals,
    spectrometer_of,
)
from startrack.earth.retrieval.minerals import christiansen_of_library

PROBLEM = EarthProblem(load_earth_design("mertis"))
DESIGN = PROBLEM.design
assert DESIGN.retrieval
assert DESIGN.retrieval.minerals
OWN = DESIGN.retrieval.minerals


def blackbody(wavelength: np.ndarray, kelvin: float) -> np.ndarray:
    """Watt / m^2 / sr / m, by astropy."""
    law = BlackBody(kelvin * units.K, scale=1 * units.W / (units.m**2 * units.um * units.sr))
    return law(wavelength / um * units.um).value / um


def test_blackbodies_are_those_of_astropy():
    """At the middle of channels of 90 nm, whose mean differs from it by 1e-4."""
    device = spectrometer_of(DESIGN, OWN)
    for kelvin in (300.0, 450.0, 680.0):
        expected = blackbody(device.wavelength, kelvin)
        assert device.radiance(np.array([kelvin]))[0] == pytest.approx(expected, rel=1e-3)
        assert device.brightness(expected[None])[0] == pytest.approx(kelvin, rel=2e-4)


def test_features_lie_where_published_spectra_have_them():
    """Christiansen features in um, to 0.15: Salisbury et al. (1991), Cooper et al. (2002)."""
    published = {"quartz": 7.4, "albite": 7.7, "anorthite": 8.1, "enstatite": 8.3, "diopside": 8.5}
    published["forsterite"] = 8.8
    names = (mineral.name for mineral in library())
    places = dict(zip(names, christiansen_of_library(OWN), strict=True))
    for name, place in published.items():
        assert places[name] / um == pytest.approx(place, abs=0.15)


def test_spectra_without_noise_give_temperature_and_emissivity_back():
    """Light computed by astropy, with the emissivity that the retrieval assumes."""
    exact = replace(OWN, assumed=OWN.peak)
    device = spectrometer_of(DESIGN, exact)
    for number, emissivity in enumerate(device.emissivity):
        light = emissivity * blackbody(device.wavelength, 520.0)
        found = identify_minerals(DESIGN, exact, light[None])
        # The mean of 5 channels around the feature lies a little below its top.
        assert found.temperature[0] == pytest.approx(520.0, abs=1.0)
        assert found.emissivity[0] == pytest.approx(emissivity, abs=5e-3)
        assert found.mineral[0] == number
        # A parabola through channels of 90 nm, of a feature that is not symmetric.
        place = christiansen_of_library(exact)[number]
        assert found.christiansen[0] / um == pytest.approx(place / um, abs=0.1)


def test_energies_are_those_of_equation_4():
    """Electrons of a channel, compared with those of the same lens and detector with a filter."""
    device = spectrometer_of(DESIGN, OWN)
    channel = DESIGN.camera.channels[0]
    band = band_of(channel, None, 4e5, 1.0)
    near = int(abs(device.wavelength - 8.0 * um).argmin())
    expected = channel.etendue() * device.exposure * band.electrons
    # Its filter passes as much as one of 95 nm.
    assert device.electrons[near] == pytest.approx(expected * 90 / 95, rel=0.01)


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"channels.*.detector.exposure": 2e-3},
        {"channels.*.detector.read_noise": 2e6},
        {"retrieval.minerals.assumed": 0.95},
    ],
)
def test_formulas_beside_trials(values: dict[str, float]):
    """384 spectra: their rms scatters by 3 %; 15 % is exceeded in less than 1e-5 of all seeds."""
    problem = PROBLEM.replaced(values)
    expected, judged = problem.expect(), problem.judge(problem.trials(1, range(384)))
    for name in ("nominal: emissivity", "evening: emissivity"):
        assert judged.parts[name].value == pytest.approx(expected.parts[name], rel=0.15)
    wrong = judged.parts["evening: wrong"]
    assert wrong.low - 0.02 <= expected.parts["evening: wrong"] <= wrong.high + 0.02


def test_the_published_spectrometer_has_its_snr():
    """At least 100 at 90 nm: Saeuberlich et al., for the breadboard."""
    assert forecast_minerals(DESIGN, OWN).snr > 100


def test_the_place_of_the_feature_is_found():
    spectra = observe_minerals(DESIGN, OWN, 1, 0)
    found = identify_minerals(DESIGN, OWN, spectra.radiance)
    assert np.median(abs(found.christiansen - spectra.christiansen)) < 0.06 * um
    assert (found.mineral == spectra.mineral).mean() > 0.95


def test_what_cannot_be_is_refused():
    with pytest.raises(Refused, match="air must be left out"):
        spectrometer_of(replace(DESIGN, air=Air()), OWN)
    with pytest.raises(Refused, match="must be a channel of the camera"):
        spectrometer_of(DESIGN, replace(OWN, channel="9um"))
    with pytest.raises(Refused, match="steps or more"):
        replace(OWN, last=7.5 * um)
    campaign = replace(PROBLEM.campaign, objective="area")
    with pytest.raises(Refused, match="must be an objective of this retrieval, emissivity, wrong"):
        EarthProblem(replace(DESIGN, campaign=campaign))
