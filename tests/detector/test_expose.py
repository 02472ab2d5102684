import math

import numpy as np
import pytest
from scipy import special
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.values import Light, LineOfSight, Psf
from startrack.detector import Detector, Exposure, electron_rate, expected, expose

WAVELENGTH = np.array([500e-9, 700e-9])
THROUGHPUT = np.array([2e-4, 1e-4])
REST = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
LEVEL = Rotation.identity()


def gaussian(sigma: float) -> Psf:
    oversampling = max(16, math.ceil(6 / sigma))
    half = int(6 * sigma + 2) * oversampling + 3
    x = np.arange(-half, half + 1) / oversampling
    line = special.ndtr((x + 0.5) / sigma) - special.ndtr((x - 0.5) / sigma)
    return Psf(np.outer(line, line), oversampling, 1.0)


def detector(**changes) -> Detector:
    return Detector(**{"columns": 64, "rows": 48, "pixel_pitch": 5e-6, "exposure": 0.1, **changes})


def light(pixels, electrons, camera: Camera, sky: float = 0.0) -> Light:
    """Stars at pixels with given electrons in 0.1 s, and a sky with given electrons per pixel."""
    direction = camera.unproject(np.atleast_2d(pixels))
    rate = np.atleast_1d(electrons)[:, None] / 0.1 / THROUGHPUT.sum() * np.ones(2)
    background = sky / 0.1 / THROUGHPUT.sum() * camera.focal_length_px**2 * np.ones(2)
    return Light(direction, WAVELENGTH, rate, background)


CAMERA = Camera(64, 48, 1000.0)


def render(pixels, electrons, sigma=0.7, path=REST, sky=0.0, **changes):
    source = light(pixels, electrons, CAMERA, sky)
    return expected(
        Exposure(source, gaussian(sigma), path, LEVEL, CAMERA, detector(**changes), THROUGHPUT)
    )


def test_electrons_are_the_integral_over_the_band():
    source = Light(np.zeros((1, 3)), WAVELENGTH, np.array([[3.0, 5.0]]), np.array([7.0, 11.0]))
    star, sky = electron_rate(
        source, detector(fill_factor=0.5), np.array([10.0 * 0.4, 100.0 * 0.5])
    )
    assert star[0] == pytest.approx(0.5 * (3 * 10 * 0.4 + 5 * 100 * 0.5))
    assert sky == pytest.approx(0.5 * (7 * 10 * 0.4 + 11 * 100 * 0.5))


@pytest.mark.parametrize("sigma", [0.3, 0.5, 0.7, 1.2, 2.5])
def test_a_star_is_the_integral_of_its_psf_over_pixels(sigma):
    """Against differences of error functions at random sub-pixel places."""
    x = np.arange(64)
    for a, b in np.random.default_rng(0).uniform([29.5, 19.5], [30.5, 20.5], (20, 2)):
        image = render([a, b], 1e4, sigma)
        across = special.ndtr((x + 0.5 - a) / sigma) - special.ndtr((x - 0.5 - a) / sigma)
        down = special.ndtr((x[:48] + 0.5 - b) / sigma) - special.ndtr((x[:48] - 0.5 - b) / sigma)
        peak = across.max() * down.max()
        np.testing.assert_allclose(image / 1e4, np.outer(down, across), atol=2e-6 * peak)


@pytest.mark.parametrize("length", [0.5, 4.0, 20.0])
def test_smear_is_the_mean_over_the_path(length):
    """Along the smear the image is a Gaussian convolved with a box: second integral of the
    Gaussian."""
    from startrack.motion import Motion, slew

    angle = length / 1000 / 0.1
    path = slew(Motion(rate_y=angle), 0.1, 1e-3)
    image = render([31.3, 23.8], 1e4, 0.6, path) / 1e4

    def ramp(u):  # integral of the normal distribution function
        return u * special.ndtr(u / 0.6) + 0.36 * np.exp(-((u / 0.6) ** 2) / 2) / np.sqrt(
            2 * np.pi * 0.36
        )

    u = np.arange(64) - 31.3
    h, p = length / 2, 0.5
    along = (ramp(u + p + h) - ramp(u + p - h) - ramp(u - p + h) + ramp(u - p - h)) / length
    np.testing.assert_allclose(image.sum(axis=0), along, atol=1e-5)


def test_a_path_turns_the_sky():
    """A direction that turns about +y by five pixels' worth moves to larger columns."""
    turn = LineOfSight(np.zeros(1), np.ones(1), np.array([[0.0, 0.005, 0.0]]))
    image = render([32.0, 24.0], 1e4, path=turn)
    assert np.argmax(image.sum(axis=0)) == 37


@pytest.mark.parametrize("place", [(-0.4, -0.4), (63.4, 47.4), (0, 20), (-3, 10), (-100, -100)])
def test_flux_is_kept_but_for_what_falls_outside(place):
    a, b = place
    inside = np.prod(
        [
            special.ndtr((n - 0.5 - c) / 0.7) - special.ndtr((-0.5 - c) / 0.7)
            for n, c in ((64, a), (48, b))
        ]
    )
    assert render(place, 1e5).sum() == pytest.approx(1e5 * inside, abs=0.2)


def test_sky_and_dark_current_fill_every_pixel():
    image = render([-100, -100], 0.0, sky=12.0, dark_current=30.0)
    np.testing.assert_allclose(image, 12 + 3, rtol=1e-12)


def test_full_well_clips_and_the_converter_saturates():
    one = detector(full_well=1000.0, bits=10)
    bright = light([32, 24], 1e9, CAMERA)
    exposure = Exposure(bright, gaussian(0.7), REST, LEVEL, CAMERA, one, THROUGHPUT)
    frame = expose(exposure, Streams(1, 1))
    assert frame.image.max() == 1023
    assert frame.image[24, 32] == 1023


def test_what_a_design_has_not_draws_nothing():
    """The shot noise of a trial stays the same when read noise is switched on."""
    source = light([32, 24], 1e5, CAMERA, sky=400.0)
    args = (source, gaussian(0.7), REST, LEVEL, CAMERA)
    kind = {"full_well": 65535.0, "bits": 16}
    without, with_ = (
        expose(Exposure(*args, detector(read_noise=noise, **kind), THROUGHPUT), Streams(1, 1)).image
        for noise in (0.0, 1e-6)
    )
    np.testing.assert_array_equal(without, with_)


def test_the_map_belongs_to_the_device():
    dark = {"prnu": 0.05, "full_well": 65535.0, "bits": 16}
    one, other = (
        render([-100, -100], 0.0, sky=1000.0, device_seed=seed, **dark) for seed in (1, 2)
    )
    assert np.corrcoef(one.ravel(), other.ravel())[0, 1] < 0.1
    np.testing.assert_array_equal(one, render([-100, -100], 0.0, sky=1000.0, device_seed=1, **dark))


def test_camera_and_detector_of_different_size_are_refused():
    wider, dark = detector(columns=65), light([0, 0], 1.0, CAMERA)
    with pytest.raises(ValueError, match="64 x 48 and 65 x 48"):
        expected(Exposure(dark, gaussian(0.7), REST, LEVEL, CAMERA, wider, THROUGHPUT))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("exposure", 0.0),
        ("fill_factor", 1.2),
        ("bits", 25),
        ("offset", 4096),
        ("read_noise", -1.0),
        ("columns", 0),
        ("prnu", float("nan")),
    ],
)
def test_impossible_detectors_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        detector(**{name: value})
