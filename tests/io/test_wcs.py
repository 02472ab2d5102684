import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.io import fits
from astropy.wcs import WCS
from scipy.spatial.transform import Rotation

from startrack.core import Refused
from startrack.core.camera import Camera
from startrack.io.wcs import camera_to_wcs, celestial, pointing, wcs_header

ATTITUDES = {
    "ordinary": pointing(123.4, 45.6, 78.9),
    "near the north pole": pointing(10.0, 89.999, 200.0),
    "north pole": pointing(10.0, 90.0, 33.0),
    "south pole": pointing(300.0, -90.0, 0.0),
    "wrap": pointing(0.001, -5.0, 359.9),
}
LENSES = {
    "pinhole": {},
    "barrel": {"k1": -0.2, "k2": 0.05},
    "all": {"k1": 0.1, "k2": -0.02, "p1": 1e-3, "p2": -2e-3, "principal_x": 7.7, "principal_y": -3},
}


@pytest.mark.parametrize("angles", [(83.0, -95.0, 0.0), (float("nan"), 0.0, 0.0)])
def test_angles_that_are_no_direction_are_refused(angles):
    with pytest.raises(Refused, match=r"dec must lie in \[-90, 90\]|ra must be finite"):
        pointing(*angles)


@pytest.mark.parametrize("attitude", ATTITUDES.values(), ids=ATTITUDES)
@pytest.mark.parametrize("lens", LENSES.values(), ids=LENSES)
def test_astropy_reads_back_the_same_pixels(attitude, lens):
    """Through the text of the header in both directions: a pinhole exactly, polynomials to 1e-3
    pixel."""
    camera = Camera(1024, 768, 1100.0, **lens)
    header = fits.Header.fromstring(wcs_header(camera, attitude).tostring())
    wcs = WCS(header)
    pixel = np.random.default_rng(1).uniform([-0.5, -0.5], [1023.5, 767.5], (300, 2))
    direction = attitude.inv().apply(camera.unproject(pixel))
    sky = SkyCoord(*direction.T, representation_type="cartesian", frame="icrs").spherical
    back = np.column_stack(wcs.all_world2pix(sky.lon.deg, sky.lat.deg, 0))
    close = 1e-3 if lens else 1e-8
    np.testing.assert_allclose(back, pixel, atol=close)
    lon, lat = wcs.all_pix2world(*pixel.T, 0)
    seen = SkyCoord(lon, lat, unit="deg", frame="icrs")
    plain = SkyCoord(sky.lon, sky.lat, frame="icrs")
    pixel_arcsec = 206265 / 1100
    assert (seen.separation(plain).arcsec / pixel_arcsec).max() < close


@pytest.mark.parametrize("attitude", ATTITUDES.values(), ids=ATTITUDES)
def test_pointing_undoes_celestial(attitude):
    assert (pointing(*celestial(attitude)) * attitude.inv()).magnitude() < 1e-9


def test_roll_turns_north_counter_clockwise():
    """At roll 0 north is up (smaller rows) and east left; at roll 90 north is left."""
    north = Rotation.from_matrix(pointing(0, 0, 0).as_matrix()).apply([0, 0, 1])
    east = pointing(0, 0, 0).apply([0, 1, 0])
    np.testing.assert_allclose(north, [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(east, [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(pointing(0, 0, 90).apply([0, 0, 1]), [-1, 0, 0], atol=1e-15)


def test_published_attitudes_have_their_angles(outside):
    import json

    truth = json.loads((outside / "images" / "truth.json").read_text())["images"]
    for one in truth.values():
        ra, dec, roll = celestial(Rotation.from_matrix(one["R_icrs_to_cam"]))
        assert ra == pytest.approx(one["ra_deg"], abs=1e-4)
        assert dec == pytest.approx(one["dec_deg"], abs=1e-4)
        assert roll == pytest.approx(one["roll_north_ccw_deg"], abs=1e-4)


def test_a_distortion_beyond_polynomials_is_refused():
    with pytest.raises(ValueError, match="polynomial"):
        camera_to_wcs(Camera(2000, 2000, 500.0, k1=-0.13, k2=0.01), ATTITUDES["wrap"])
