"""The search: its filter, its components, its false alarms and misses, and its windows."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.core.values import Frame
from startrack.detection import Detection, detect, divide_flat, gaussian_psf
from startrack.detection.connect import lit, peaks
from startrack.detection.detect import detect_near
from startrack.detection.matched import filtered, gaussian_kernel, psf_kernel
from startrack.detection.star_model import smeared

SIDE = 1024
LIMITS = json.loads((Path(__file__).parents[1] / "oracle" / "detection_limits.json").read_text())[
    "limits"
]


def noise(seed, trial, background=50.0, read_noise=5.0, stars=0.0):
    streams = Streams(seed, trial)
    image = streams("shot noise").poisson(background + stars, (SIDE, SIDE))
    image = image + read_noise * streams("read noise").standard_normal((SIDE, SIDE))
    return np.round(image + 100).astype(np.uint16)


def test_components_are_those_of_opencv():
    image = cv2.GaussianBlur(Streams(1, 0)("field").standard_normal((150, 200)), (7, 7), 1.5)
    image = image.astype(np.float32)
    level = np.full((7, 9), 0.15, np.float32)
    bright = lit(image, level, 32)
    mask = image > np.float32(0.15)
    np.testing.assert_array_equal(np.sort(bright), np.flatnonzero(mask))
    x, y, area = peaks(image, bright, np.zeros(image.shape, np.uint8), 1, 10**6, 2, 0)
    _, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    np.testing.assert_array_equal(area, stats[label[y, x], cv2.CC_STAT_AREA])
    assert len(x) > 100
    best = cv2.dilate(image, np.ones((5, 5)))
    np.testing.assert_array_equal(np.sort(y * 200 + x), np.flatnonzero(mask & (image == best)))


def test_a_level_that_slopes_is_interpolated_as_opencv_does():
    image = Streams(2, 0)("field").standard_normal((96, 160)).astype(np.float32)
    level = Streams(2, 0)("level").uniform(-1, 1, (5, 7)).astype(np.float32)
    whole = cv2.resize(level, (7 * 32, 5 * 32), interpolation=cv2.INTER_LINEAR)[32:-32, 32:-32]
    near = np.abs(image - whole) < 1e-5
    mask = np.zeros(image.size, bool)
    mask[lit(image, level, 32)] = True
    assert (mask.reshape(image.shape) == (image > whole))[~near].all()


@pytest.mark.parametrize(
    "kernel", [gaussian_kernel(0.8), psf_kernel(smeared(gaussian_psf(0.8), 4.0, 3.0))]
)
def test_kernels_keep_a_constant_and_the_noise_they_tell(kernel):
    image = Streams(3, 0)("field").standard_normal((512, 512)).astype(np.float32)
    result = filtered(image + 7, kernel)
    assert result.mean() == pytest.approx(7, abs=0.02)
    assert result[8:-8, 8:-8].std() == pytest.approx(kernel.noise, rel=0.03)


def test_a_kernel_is_not_mirrored(sky):
    streak = sum(
        sky((41, 41), 20 + 6 * a, 20 + 3 * a, 1 / 50, 0.8) for a in np.linspace(-0.5, 0.5, 50)
    )
    along = psf_kernel(smeared(gaussian_psf(0.8), 6.0, 3.0))
    across = psf_kernel(smeared(gaussian_psf(0.8), 6.0, -3.0))
    high, low = (filtered(streak.astype(np.float32), k)[20, 20] for k in (along, across))
    assert high == pytest.approx(along.light, rel=0.02)
    assert low < 0.8 * high


def test_a_faint_streak_needs_its_own_kernel(sky):
    grid = np.arange(60.0, SIDE - 50, 100)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    stars = sum(sky((SIDE, SIDE), x + 10 * a, y, 520 / 40, 0.8) for a in np.linspace(-0.5, 0.5, 40))
    frame = Frame(noise(4, 0, stars=stars), np.nan, 1.0, 100.0, 5.0)
    right = []
    for smear in (0.0, 10.0):
        settings = Detection(kernel_sigma=0.8, smear_x=smear, centroid="likelihood")
        spots = detect(frame, settings)
        distance = np.hypot(spots.x - x[:, None], spots.y - y[:, None]).min(axis=1)
        right.append((distance < 1.5).mean())
    assert right[1] > 0.9
    assert right[0] < 0.5


@pytest.mark.parametrize("known", LIMITS)
def test_faint_stars_are_found_as_often_as_can_be(sky, known):
    # Within 5 points of the limit; 600 stars know a fraction to 2 points.
    found = total = 0
    sigma = known["sigma_px"]
    settings = Detection(kernel_sigma=sigma, false_per_frame=0.05, max_spots=999)
    for trial in range(2):
        grid = np.arange(40.0, SIDE - 20, 57)
        x, y = (a.ravel() for a in np.meshgrid(grid, grid))
        x = x + Streams(6, trial)("x").uniform(-0.5, 0.5, x.size)
        y = y + Streams(6, trial)("y").uniform(-0.5, 0.5, y.size)
        stars = sky((SIDE, SIDE), x, y, known["flux_e"], sigma)
        spots = detect(Frame(noise(6, trial, stars=stars), np.nan, 1.0, 100.0, 5.0), settings)
        distance = np.hypot(spots.x - x[:, None], spots.y - y[:, None]).min(axis=1)
        found += (distance < 1.5).sum()
        total += len(x)
    assert found / total > known["found"] - (0.09 if known["found"] < 0.95 else 0.02)


def test_windows_find_what_the_frame_shows(sky):
    place = Streams(7, 0)("place")
    x, y = place.uniform(4, SIDE - 5, (2, 40))
    stars = sky((SIDE, SIDE), x, y, 3000.0, 0.8)
    stars += np.linspace(0, 2000, SIDE)  # each window with a background of its own
    frame = Frame(noise(7, 0, stars=stars), np.nan, 1.0, 100.0, 5.0)
    expected = np.column_stack([x, y]) + place.uniform(-3, 3, (40, 2))
    settings = Detection(kernel_sigma=0.8, centroid="likelihood")
    whole, near = detect(frame, settings), detect_near(frame, expected, 3.0, settings)
    assert len(near) >= 0.95 * len(whole)
    for i in range(len(near)):
        k = np.hypot(whole.x - near.x[i], whole.y - near.y[i]).argmin()
        assert (whole.x[k], whole.y[k], whole.flux[k]) == pytest.approx(
            (near.x[i], near.y[i], near.flux[i]), rel=1e-9
        )


def test_windows_look_nowhere_else(sky):
    x, y = np.array([100.0, 120.0, 300.0]), np.array([100.0, 100.0, 300.0])
    image = sky((400, 400), x, y, 5000.0, 0.8) + 50
    image = Streams(8, 0)("shot noise").poisson(image)
    settings = Detection(kernel_sigma=0.8)
    spots = detect_near(Frame(image), np.array([[101.0, 99.0], [200.0, 200.0]]), 3.0, settings)
    assert spots.x == pytest.approx([100], abs=0.1)
    twice = detect_near(Frame(image), np.array([[101.0, 99.0], [99.5, 100.0]]), 3.0, settings)
    assert len(twice) == 1
    for none in (np.empty((0, 2)), np.array([[-9.0, 5.0]]), np.array([[np.nan, 5.0]])):
        assert len(detect_near(Frame(image), none, 3.0, settings)) == 0


def test_windows_refuse():
    frame, settings = Frame(np.zeros((32, 32))), Detection()
    with pytest.raises(ValueError, match=r"place must have the shape \(m, 2\)"):
        detect_near(frame, np.zeros(2), 3.0, settings)
    with pytest.raises(ValueError, match="reach must be positive"):
        detect_near(frame, np.zeros((1, 2)), 0.0, settings)


def test_a_flat_field_evens_the_response(sky):
    response = 1 + 0.3 * np.sin(np.arange(256) / 20) * np.ones((256, 1))
    response[100, 100] = 0.01
    image = sky((256, 256), 60.2, 70.4, 20000.0, 0.9) + 500
    frame = Frame(image * response + 64, offset=64.0)
    even = divide_flat(frame, Frame(7000 * response + 64, offset=64.0))
    assert np.isnan(even.image[100, 100])
    right = np.delete((image * response.mean() + 64).ravel(), 100 * 256 + 100)
    np.testing.assert_allclose(np.delete(even.image.ravel(), 100 * 256 + 100), right, rtol=1e-3)


def test_a_flat_field_is_refused():
    frame = Frame(np.zeros((4, 5)))
    with pytest.raises(ValueError, match="flat must have the frame's shape"):
        divide_flat(frame, Frame(np.zeros((5, 4))))
    with pytest.raises(ValueError, match="flat must hold light"):
        divide_flat(frame, Frame(np.zeros((4, 5))))


def test_known_hot_pixels_are_no_stars(sky):
    image = Streams(9, 0)("shot noise").poisson(sky((128, 128), 60.2, 70.4, 20000.0, 0.9) + 50)
    image[20:22, 30:32] += 5000  # a cluster, which alone would pass for a star
    frame = Frame(image.astype(np.uint16))
    assert len(detect(frame, Detection())) == 2
    marked = image.astype(float)
    marked[20:22, 30:32] = np.nan
    assert len(detect(Frame(marked), Detection())) == 1


def test_a_cosmic_ray_through_a_star_spoils_no_other(sky):
    x, y = np.array([60.2, 90.0]), np.array([70.4, 30.3])
    image = Streams(10, 0)("shot noise").poisson(sky((128, 128), x, y, 20000.0, 0.9) + 50)
    for step in range(30):
        image[60 + step // 2, 45 + step] += 4000
    for centroid in ("gravity", "weighted", "gaussian", "likelihood"):
        spots = detect(Frame(image.astype(np.uint16)), Detection(centroid=centroid))
        assert np.hypot(spots.x - 90.0, spots.y - 30.3).min() < 0.1
        assert np.isfinite(spots.covariance).all()


@pytest.mark.parametrize("centroid", ["weighted", "gaussian", "likelihood"])
@pytest.mark.parametrize("value", [0, 200, 65535])
def test_even_frames_hold_nothing(centroid, value):
    frame = Frame(np.full((64, 64), value, np.uint16))
    assert len(detect(frame, Detection(centroid=centroid))) == 0


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"centroid": "best"}, "centroid must be one of gravity, weighted, gaussian, likelihood"),
        ({"compensation": "some"}, "compensation must be one of none, gaussian, psf, got 'some'"),
        ({"kernel": "box"}, "kernel must be one of gaussian, psf, got 'box'"),
        ({"smear_x": 1e3}, r"smear_x must lie in \[-100, 100\]"),
    ],
)
def test_refused_settings(setting, message):
    with pytest.raises(ValueError, match=message):
        Detection(**setting)
