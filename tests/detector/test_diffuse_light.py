"""Light that varies over the frame, and EMVA 1288's measurements in such light."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.values import DiffuseLight, Light, LineOfSight, Psf
from startrack.detector import Detector, Exposure, expected, frame_of
from startrack.detector.collect import diffuse_electrons
from startrack.detector.maps import response

WAVELENGTH = np.array([500e-9, 700e-9])
THROUGHPUT = np.array([0.5, 1.0])
REST = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
POINT = Psf(np.ones((1, 1)), 1, 1.0)


def light_of(*diffuse: DiffuseLight) -> Light:
    return Light(np.zeros((0, 3)), WAVELENGTH, np.zeros((0, 2)), np.zeros(2), diffuse=diffuse)


def image_of(light: Light, one: Detector):
    camera = Camera(one.columns, one.rows, 1000.0)
    exposure = Exposure(light, POINT, REST, Rotation.identity(), camera, one, THROUGHPUT)
    return expected(exposure)


def test_a_slope_is_a_slope():
    """Four corners define a plane: radiance times solid angle times time, at every pixel."""
    one = Detector(31, 21, 5e-6, 0.5)
    corners = np.array([[1.0, 3.0], [2.0, 4.0]])
    image = image_of(light_of(DiffuseLight(np.array([2e6, 3e6]), corners)), one)
    row, column = np.mgrid[0:21, 0:31]
    wanted = (2e6 * 0.5 + 3e6) * 1e-6 * 0.5 * (1 + 2 * column / 30 + row / 20)
    np.testing.assert_allclose(image, wanted, rtol=1e-12)


def test_diffuse_lights_of_any_maps_add_up():
    one = Detector(40, 30, 5e-6, 0.1)
    fine = DiffuseLight(np.array([1e6, 0.0]), np.random.default_rng(1).random((9, 13)))
    coarse = DiffuseLight(np.array([0.0, 1e6]), np.ones((2, 2)))
    camera = Camera(40, 30, 1000.0)
    both = diffuse_electrons(light_of(fine, coarse), camera, one, THROUGHPUT)
    each = [
        diffuse_electrons(light_of(diffuse), camera, one, THROUGHPUT) for diffuse in (fine, coarse)
    ]
    np.testing.assert_allclose(both, each[0] + each[1])
    # A place of the map that falls on a pixel has its own value there.
    np.testing.assert_allclose(each[0][0, 0], 1e6 * 0.5 * 1e-6 * 0.1 * fine.fraction[0, 0])
    np.testing.assert_allclose(each[0][-1, -1], 1e6 * 0.5 * 1e-6 * 0.1 * fine.fraction[-1, -1])


def test_a_map_of_many_places_is_scipys_interpolation():
    """Along one side there are more places than pixels, along the other fewer."""
    fraction = np.random.default_rng(2).random((11, 4))
    one = Detector(23, 7, 5e-6, 0.2, fill_factor=0.5)
    got = diffuse_electrons(
        light_of(DiffuseLight(np.array([3e6, 1e6]), fraction)),
        Camera(23, 7, 500.0),
        one,
        0.6 * THROUGHPUT,
    )
    read = RegularGridInterpolator((np.linspace(0, 6, 11), np.linspace(0, 22, 4)), fraction)
    row, column = np.mgrid[0:7, 0:23]
    # 1.5e6 + 1e6 photons through the aperture, in 4e-6 sr and 0.2 s: two, of which 0.3 are seen.
    np.testing.assert_allclose(got, 2 * 0.3 * read((row, column)), rtol=1e-12)


def test_no_diffuse_light_is_none():
    assert (
        diffuse_electrons(light_of(), Camera(3, 3, 10.0), Detector(3, 3, 5e-6, 1.0), THROUGHPUT)
        is None
    )


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (1, 7), (2000, 1)])
def test_detectors_of_one_line_or_pixel(columns, rows):
    diffuse = DiffuseLight(np.array([0.0, 1e6]), np.ones((17, 17)))
    image = image_of(light_of(diffuse), Detector(columns, rows, 5e-6, 1.0))
    np.testing.assert_allclose(image, 1.0, rtol=1e-12)


def test_pixels_respond_to_it_and_leak_it():
    one = Detector(60, 50, 5e-6, 1.0, prnu=0.05, crosstalk=0.02)
    image = image_of(light_of(DiffuseLight(np.array([0.0, 1e9]), np.ones((2, 2)))), one)
    gain = response(one)
    inner = np.s_[1:-1, 1:-1]
    sides = gain[:-2, 1:-1] + gain[2:, 1:-1] + gain[1:-1, :-2] + gain[1:-1, 2:]
    np.testing.assert_allclose(image[inner], 1000 * (0.92 * gain[inner] + 0.02 * sides))


@pytest.mark.slow
@pytest.mark.parametrize(("bits", "full_well"), [(12, 20_000.0), (16, 131_070.0)])
def test_one_pair_of_frames_with_a_slope_is_a_photon_transfer_curve(bits, full_well):
    """EMVA 1288's line from one pair: each column has its own level, from 50 to 9000 electrons.

    Half of the variance of the difference over the mean gives gain and read noise within 2 %; the
    standard errors are 0.2 % and 0.7 %. Uniform light would need a pair for each level.
    """
    one = Detector(
        900, 1200, 5e-6, 0.1, full_well=full_well, bits=bits, offset=100, read_noise=12.0, prnu=0.02
    )
    slope = np.linspace(50, 9000, 2)[None, :].repeat(2, axis=0)
    electrons = image_of(light_of(DiffuseLight(np.array([0.0, 1e7]), slope)), one)
    assert electrons.max() == pytest.approx(9000, rel=0.15)
    frames = [
        frame_of(electrons, one, Streams(1, n)).image.astype(float) - one.offset for n in (0, 1)
    ]
    mean = (frames[0] + frames[1]).mean(axis=0) / 2
    variance = (frames[0] - frames[1]).var(axis=0) / 2
    gain, intercept = np.polyfit(mean, variance, 1, w=1 / variance)
    assert 1 / gain == pytest.approx(one.electrons_per_dn, rel=0.02)
    read = np.sqrt(intercept - 1 / 12) / gain
    assert read == pytest.approx(one.read_noise, rel=0.05)
    # The slope itself: what is expected, within the noise of 1200 rows.
    level = electrons.mean(axis=0) * gain
    assert np.abs(mean / level - 1)[50:].max() < 0.01
    # Fixed pattern, from the product of the frames, without the slope.
    rest = [frame / mean - 1 for frame in frames]
    assert np.sqrt((rest[0] * rest[1])[:, 300:].mean()) == pytest.approx(0.02, rel=0.02)
