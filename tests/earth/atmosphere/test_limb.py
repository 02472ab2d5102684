"""The table of the Earth's limb."""

import numpy as np
import pytest
from air_files import save_limb

from startrack.core.units import deg, nm
from startrack.io import shipped
from startrack.scene.limb import load_limb


@pytest.fixture(scope="module")
def limb():
    return load_limb(shipped("atmosphere/limb.fits"))


def at(limb, tangent, sun=30 * deg, azimuth=90 * deg, wavelength=550 * nm):
    place = (np.array([value], float) for value in (wavelength, tangent, sun, azimuth))
    return limb(*place)[0, 0]


def test_magnitudes_of_the_limb(limb):
    """In a pixel of 60 arcsec, as in the test of the solver."""
    pixel = np.radians(1 / 60) ** 2
    seen = [
        -2.5 * np.log10(at(limb, height) * 1.863 * pixel / 3.63e-11)
        for height in (20e3, 40e3, 60e3, 80e3)
    ]
    np.testing.assert_allclose(seen, [-5.5, -2.4, 0.3, 3.4], atol=0.3)


def test_the_limb_fades_with_height_and_evening(limb):
    assert at(limb, 10e3) > at(limb, 50e3) > at(limb, 90e3) > 0
    assert at(limb, 20e3) > at(limb, 20e3, 85 * deg) > 0


def test_the_air_ends_and_the_night_is_dark(limb):
    assert at(limb, 150e3) == 0
    assert at(limb, 20e3, 120 * deg) == 0


def test_a_line_into_the_ground_is_refused(limb):
    for tangent in (-1.0, np.nan):
        with pytest.raises(ValueError, match="tangent must be at least 0 m"):
            at(limb, tangent)


def test_its_file(limb, tmp_path):
    save_limb(tmp_path / "again.fits", limb)
    np.testing.assert_array_equal(load_limb(tmp_path / "again.fits").radiance, limb.radiance)
    with pytest.raises(ValueError, match="table of the limb of format 1"):
        load_limb(shipped("stars/bright.fits"))
