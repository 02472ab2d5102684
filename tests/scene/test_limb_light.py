"""The bright limb for a tracker in orbit."""

import numpy as np
import pytest

from startrack.core.units import deg, nm
from startrack.io import shipped
from startrack.scene.bodies import Disc, Earth, sunlight
from startrack.scene.limb import limb_light, load_limb
from startrack.scene.photometry import WAVELENGTH
from startrack.space import AU, EARTH_RADIUS

FAR = 2800e3  # metre from the observer to the limb


def earth(sun_zenith: float, azimuth: float, height: float) -> Earth:
    """An Earth with the tangent point of a height along +y and the nadir towards +x."""
    sun = np.array(
        [
            np.cos(sun_zenith),
            np.sin(sun_zenith) * np.cos(azimuth),
            np.sin(sun_zenith) * np.sin(azimuth),
        ]
    )
    centre = np.array([-(EARTH_RADIUS + height), FAR, 0.0])
    light = 0.3 / np.pi * sunlight(AU)
    radius = np.arcsin(EARTH_RADIUS / np.linalg.norm(centre))
    return Earth(Disc(centre / np.linalg.norm(centre), radius, light), light, centre, sun)


def brightness(earth: Earth, wavelength: float, air: str = "molecules") -> float:
    """Radiance along +y over the Sun's irradiance in the bin nearest to a wavelength."""
    bin_ = int(np.argmin(np.abs(WAVELENGTH - wavelength)))
    seen = sum(
        spectrum[bin_] * fraction[0]
        for spectrum, fraction in limb_light(earth, np.array([[0.0, 1, 0]]), air)
    )
    return float(seen / sunlight(AU)[bin_])


@pytest.mark.parametrize("azimuth", [0.0, 90 * deg, 180 * deg])
@pytest.mark.parametrize("height", [4e3, 20e3, 60e3])
def test_it_is_that_of_the_table(height, azimuth):
    table = load_limb(shipped("atmosphere/limb.fits"))
    place = (np.array([value]) for value in (550 * nm, height, 40 * deg, azimuth))
    assert brightness(earth(40 * deg, azimuth, height), 550 * nm) == pytest.approx(
        table(*place)[0, 0], rel=1e-6
    )


def test_aerosol_brightens_red_light_of_the_stratosphere():
    """Background aerosol nearly doubles the light near 20 km, and adds little blue light."""

    def gain(height, wavelength):
        above = earth(60 * deg, 90 * deg, height)
        return brightness(above, wavelength, "rural") / brightness(above, wavelength)

    assert 1.5 < gain(20e3, 800 * nm) < 2.5
    assert 1.0 < gain(20e3, 450 * nm) < 1.2
    assert gain(80e3, 800 * nm) < gain(20e3, 800 * nm) / 1.3


def test_every_bin_is_lit_once():
    parts = list(limb_light(earth(30 * deg, 1.0, 20e3), np.array([[0.0, 1, 0]])))
    assert (sum((spectrum > 0).astype(int) for spectrum, _ in parts) == 1).all()


def test_blue_outshines_red_high_up():
    above = earth(30 * deg, 1.0, 50e3)
    assert brightness(above, 450 * nm) > 3 * brightness(above, 800 * nm)


@pytest.mark.parametrize("height", [-5e3, 150e3])
def test_nothing_shines_under_the_horizon_or_above_the_air(height):
    assert list(limb_light(earth(30 * deg, 1.0, height), np.array([[0.0, 1, 0]]))) == []


def test_nothing_shines_behind_the_observer():
    assert list(limb_light(earth(30 * deg, 1.0, 20e3), np.array([[0.0, -1, 0]]))) == []
