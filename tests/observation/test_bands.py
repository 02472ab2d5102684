"""Light through filters, the narrowest of which lie between two bins of wavelength."""

import dataclasses

import numpy as np
import pytest

from startrack.core import BOLTZMANN, LIGHT_SPEED, PLANCK, Curve, Refused, nm
from startrack.detector import electron_rate
from startrack.observation import images
from startrack.observation.stars import light_by_colour, throughput
from tests.trial.designs import CASE, changed

BANDS = (655.5, 657.1), (654, 666), (656, 664), (645, 675), (640, 690), (402, 403), (885, 999)


def behind(low, high):
    """The instrument behind a filter that is 0.8 between two wavelengths (nm)."""
    curve = Curve((low * nm, high * nm), (0.8, 0.8))
    return changed(optics=dataclasses.replace(CASE.instrument.optics, transmission=curve))


def rate(low, high):
    case = behind(low, high)
    light = light_by_colour(case, np.full(1, np.nan))
    return electron_rate(light, case.instrument.detector, throughput(case.instrument))[0][0]


def integral(low, high):
    """Photons of a blackbody of 5772 K times the quantum efficiency, by Planck's law."""
    place = np.linspace(low, high, 100_001) * nm
    curve = CASE.instrument.detector.quantum_efficiency
    efficiency = np.interp(place, curve.wavelength, curve.value, 0.0, 0.0)
    exponent = PLANCK * LIGHT_SPEED / (BOLTZMANN * 5772.0 * place)
    return np.trapezoid(efficiency * place**-4 / np.expm1(exponent), place)


@pytest.mark.parametrize("band", BANDS)
def test_a_filter_passes_the_integral_of_its_band(band):
    right = integral(*band) / integral(400, 900)
    assert rate(*band) / rate(400, 900) == pytest.approx(right, rel=2e-3)


def test_the_image_behind_a_narrow_filter_has_its_wavelength():
    wave = images.sunlike_colour(behind(656, 657).instrument)
    assert wave == pytest.approx(656.5 * nm, abs=0.1 * nm)


def test_light_beyond_the_modelled_spectra_is_refused():
    optics = dataclasses.replace(CASE.instrument.optics, transmission=Curve())
    swir = Curve((800 * nm, 1000 * nm, 1600 * nm, 1700 * nm), (0.5, 0.9, 0.9, 0.0))
    detector = dataclasses.replace(CASE.instrument.detector, quantum_efficiency=swir)
    # By Planck's law, 0.56 of the electrons are beyond 1100 nm.
    with pytest.raises(Refused, match=r"between 320 and 1100 nm, where .* got 56 % of a sunlike"):
        throughput(changed(optics=optics, detector=detector).instrument)
