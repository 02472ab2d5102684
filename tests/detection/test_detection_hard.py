"""Frames that a careless detection fails on."""

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.core.values import Frame
from startrack.detection import Detection, detect, subtract_dark

SIDE = 256


def noisy(image, seed=1, read_noise=5.0):
    streams = Streams(seed, 0)
    image = streams("shot noise").poisson(image)
    return image + 100 + read_noise * streams("read noise").standard_normal(image.shape)


def near(spots, x, y, reach=1.0):
    return bool((np.hypot(spots.x - x, spots.y - y) < reach).any())


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((64, 64), np.uint8),
        np.full((64, 64), 7, np.uint16),
        np.full((64, 64), 65535, np.uint16),
        np.full((64, 64), -3.7),
        np.full((64, 64), 1e9 + 0.1),
        np.full((1, 1), 5.0),
        np.full((1, 300), 5.0),
        np.full((4, 4), 200, np.uint8),
    ],
)
def test_nothing_on_an_even_frame(image):
    spots = detect(Frame(image), Detection())
    assert len(spots) == 0
    assert spots.covariance.shape == (0, 2, 2)
    assert spots.area.dtype == np.int64


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.full((8, 8), np.nan), ValueError, "image must hold finite values"),
        (np.full((8, 8), np.inf), ValueError, "image must hold finite values"),
        (np.empty((0, 8)), ValueError, "image must not be empty"),
        (np.zeros((8, 8, 3), np.uint8), ValueError, "image must have two dimensions"),
        (np.zeros((8, 8), bool), TypeError, "image must hold real numbers"),
        (np.zeros((8, 8), complex), TypeError, "image must hold real numbers"),
    ],
)
def test_refused(image, error, message):
    with pytest.raises(error, match=message):
        detect(Frame(image), Detection())


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"threshold": 0.0}, "threshold must be positive"),
        ({"window": 4}, "window must be odd, got 4"),
        ({"window": 1}, "window must be a whole number in"),
        ({"kernel_sigma": 0.1}, "kernel_sigma must lie in"),
        ({"min_area": 10, "max_area": 9}, "max_area must be at least min_area = 10, got 9"),
        ({"max_spots": 0}, "max_spots must be"),
        ({"sharpest_sigma": -1.0}, "sharpest_sigma must not be negative"),
        ({"saturation": 0.0}, "saturation must be positive"),
        ({"edge": -1}, "edge must be"),
    ],
)
def test_refused_settings(setting, message):
    with pytest.raises(ValueError, match=message):
        Detection(**setting)


@pytest.mark.parametrize(
    "kind", ["u1", "i1", "<u2", ">u2", "<i2", "<u4", ">i8", "<f2", "<f4", ">f4", "<f8", ">f8"]
)
def test_every_type_of_number_gives_the_same_spot(sky, kind):
    image = np.round(noisy(sky((64, 64), 30.3, 20.8, 300.0, 0.9) + 4, read_noise=1.5) - 90)
    spots = detect(Frame(image.astype(kind)), Detection())
    assert spots.x == pytest.approx([30.3], abs=0.1)
    assert spots.y == pytest.approx([20.8], abs=0.1)
    assert spots.x == pytest.approx(detect(Frame(image), Detection()).x, abs=1e-4)


def test_a_huge_pedestal_costs_no_digits(sky):
    image = noisy(sky((64, 64), 30.3, 20.8, 3000.0, 0.9) + 10)
    plain, lifted = (detect(Frame(image + pedestal), Detection()) for pedestal in (0.0, 1e9))
    assert lifted.x == pytest.approx(plain.x, abs=1e-4)
    assert lifted.flux == pytest.approx(plain.flux, rel=1e-4)


def test_negative_values(sky):
    image = noisy(sky((64, 64), 30.3, 20.8, 3000.0, 0.9) + 10) - 5000
    assert near(detect(Frame(image), Detection()), 30.3, 20.8, 0.1)


def test_the_frame_is_not_changed(sky):
    image = noisy(sky((64, 64), 30.0, 20.0, 3000.0, 0.9) + 10)
    image[5, 5] = np.nan
    before = image.copy()
    image.flags.writeable = False
    detect(Frame(image), Detection())
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_dead_pixels_make_no_spots_and_hide_none(sky, value):
    image = noisy(sky((SIDE, SIDE), 100.3, 90.8, 5000.0, 0.8) + 10)
    row, column = Streams(2, 0)("dead").integers(0, SIDE, (2, 60))
    far = np.hypot(column - 100.3, row - 90.8) > 4
    image[row[far], column[far]] = value
    image[0, :] = image[40:60, 200:210] = value
    spots = detect(Frame(image), Detection())
    assert len(spots) == 1
    assert near(spots, 100.3, 90.8, 0.1)


def test_a_star_on_a_dead_pixel_is_dropped(sky):
    image = noisy(sky((64, 64), 30.0, 20.0, 5000.0, 0.8) + 10)
    image[20, 31] = np.nan
    assert len(detect(Frame(image), Detection())) == 0


@pytest.mark.parametrize(("x", "y"), [(3.2, 2.6), (252.4, 253.1), (2.8, 252.7), (253.0, 3.0)])
def test_star_in_the_corner(sky, x, y):
    image = noisy(sky((SIDE, SIDE), x, y, 5000.0, 0.7) + 10)
    spots = detect(Frame(image), Detection())
    assert spots.x == pytest.approx([x], abs=0.1)
    assert spots.y == pytest.approx([y], abs=0.1)
    assert len(detect(Frame(image), Detection(edge=4))) == 0


def test_star_that_the_border_cuts_is_dropped(sky):
    image = noisy(sky((SIDE, SIDE), 0.4, 100.0, 5000.0, 0.7) + 10)
    assert len(detect(Frame(image), Detection())) == 0


def test_one_star_of_several_sizes(sky):
    for sigma in (0.45, 0.7, 1.0, 1.5, 2.0, 2.5):
        image = noisy(sky((SIDE, SIDE), 120.3, 77.7, 20000.0, sigma) + 10)
        spots = detect(Frame(image), Detection())
        assert len(spots) == 1
        assert near(spots, 120.3, 77.7, 0.3)


def test_five_hundred_stars(sky):
    grid = np.arange(20.0, 1010, 44)
    x, y = (a.ravel()[:500] for a in np.meshgrid(grid, grid))
    place = Streams(3, 0)("place")
    x, y = x + place.uniform(-9, 9, 500), y + place.uniform(-9, 9, 500)
    flux = 800 * 10 ** place.uniform(0, 2, 500)
    image = noisy(sky((1024, 1024), x, y, flux, 0.8) + 10)
    spots = detect(Frame(image), Detection(max_spots=1000))
    assert len(spots) == 500
    assert all(near(spots, *place, 0.5) for place in zip(x, y, strict=True))
    few = detect(Frame(image), Detection(max_spots=20))
    np.testing.assert_array_equal(few.flux, spots.flux[:20])


def test_a_permutation_of_rows_and_columns_turns_the_spots(sky):
    image = noisy(sky((SIDE, SIDE), np.array([50.3, 150.2]), np.array([60.1, 200.9]), 9e3, 0.9))
    spots = detect(Frame(image), Detection())
    turned = detect(Frame(image.T), Detection())
    np.testing.assert_allclose(turned.x, spots.y, atol=1e-6)
    np.testing.assert_allclose(turned.y, spots.x, atol=1e-6)
    np.testing.assert_allclose(turned.covariance, spots.covariance[:, ::-1, ::-1], rtol=1e-6)


def test_touching_stars_are_taken_apart(sky):
    image = noisy(sky((SIDE, SIDE), np.array([100.0, 106.0]), 80.0, np.array([9e3, 6e3]), 1.0) + 10)
    spots = detect(Frame(image), Detection())
    assert spots.x == pytest.approx([100, 106], abs=0.1)
    assert spots.area[0] == spots.area[1]


def test_bright_limb_over_a_third_of_the_frame(sky):
    x, y = np.array([30.0, 60.4, 110.2, 90.5]), np.array([40.2, 200.6, 128.3, 90.1])
    image = sky((SIDE, SIDE), x, y, 5000.0, 0.8) + 10
    row, column = np.mgrid[:SIDE, :SIDE]
    image += 20000 / (1 + np.exp((np.hypot(column - 570, row - 128) - 400) / 2))
    spots = detect(Frame(noisy(image)), Detection())
    assert len(spots) == 4
    assert all(near(spots, *place, 0.2) for place in zip(x, y, strict=True))


def test_gradient_and_uneven_noise(sky):
    x, y = np.array([30.0, 230.4]), np.array([40.2, 200.6])
    ramp = np.linspace(10, 4000, SIDE)
    image = sky((SIDE, SIDE), x, y, 9000.0, 0.8) + ramp
    spots = detect(Frame(noisy(image)), Detection())
    assert len(spots) == 2
    assert all(near(spots, *place, 0.3) for place in zip(x, y, strict=True))


def test_trees(sky):
    # Leaves: a random field of the size of stars, ten times brighter, over half of the frame.
    x, y = np.array([30.0, 90.4]), np.array([60.2, 30.6])
    image = sky((SIDE, SIDE), x, y, 9000.0, 0.8) + 30
    leaves = Streams(4, 0)("leaves").gamma(1.0, 400, (SIDE // 2 // 3 + 1, SIDE // 3 + 1))
    image[SIDE // 2 :] += np.kron(leaves, np.ones((3, 3)))[: SIDE // 2, :SIDE]
    spots = detect(Frame(noisy(image)), Detection())
    assert all(near(spots, *place, 0.2) for place in zip(x, y, strict=True))
    assert (spots.y > SIDE // 2).sum() <= 3


def test_hot_pixels_rows_and_columns_are_no_stars(sky):
    image = noisy(sky((SIDE, SIDE), 100.3, 90.8, 5000.0, 0.6) + 10)
    row, column = Streams(5, 0)("hot").integers(3, SIDE - 3, (2, 100))
    far = np.hypot(column - 100.3, row - 90.8) > 8
    image[row[far], column[far]] += 3000
    image[:, 200] += 2000
    image[30:60, 150] += 1000
    image[220, 20:30] += 1000
    spots = detect(Frame(image), Detection())
    assert near(spots, 100.3, 90.8, 0.1)
    # Of 100 hot pixels a pair may touch at a corner, as no rule can tell from a star.
    assert len(spots) <= 3


def test_a_high_threshold_finds_stars_among_warm_pixels_and_faint_stars(sky):
    """The noise of a few brighter pixels cannot be extrapolated to probabilities never observed."""
    draw = Streams(6, 0)("a warm sky")
    x, y = draw.uniform(10, SIDE - 10, (2, 320))
    flux = np.full(320, 60.0)
    flux[:20] = 300.0  # twenty sigma of the noise of 2, filtered
    x[:20], y[:20] = np.divmod(np.arange(20), 5) * np.array([[50], [40]]) + 40.3
    image = 70 + sky((SIDE, SIDE), x, y, flux, 0.6) + 2 * draw.standard_normal((SIDE, SIDE))
    warm = draw.random((SIDE, SIDE)) < 0.03
    image[warm] += draw.exponential(10.0, warm.sum())
    spots = detect(Frame(np.rint(image).astype(np.uint16)), Detection(threshold=12.0))
    assert sum(near(spots, *place, 0.5) for place in zip(x[:20], y[:20], strict=True)) >= 18
    assert len(spots) <= 22


def test_large_blobs_are_no_stars(sky):
    image = noisy(
        sky((SIDE, SIDE), np.array([100.0, 200.0]), 80.0, np.array([4e6, 5e3]), 12.0) + 10
    )
    assert len(detect(Frame(image), Detection())) == 0


def test_saturated_stars_are_found_and_not_believed(sky):
    image = noisy(sky((SIDE, SIDE), 100.3, 90.8, 2e5, 1.0) + 10)
    frame = Frame(np.minimum(image, 4095), electrons_per_dn=1.0)
    blind, aware = (detect(frame, Detection(saturation=s)) for s in (None, 4095.0))
    assert aware.x == pytest.approx([100.3], abs=0.3)
    assert aware.snr[0] < 10 < blind.snr[0]
    assert aware.covariance[0, 0, 0] > 10 * blind.covariance[0, 0, 0]


def test_dark_frame_takes_pattern_and_hot_pixels_off(sky):
    image = sky((SIDE, SIDE), 100.3, 90.8, 5000.0, 0.8) + 10
    glow = np.zeros((SIDE, SIDE))
    glow += np.linspace(0, 300, SIDE)
    glow[150:152, 60:62] = 5000.0  # a cluster, which alone would pass for a star
    dark = Frame(np.round(glow + 100).astype(np.uint16))
    frame = Frame(noisy(image + glow).astype(np.uint16), offset=100.0, electrons_per_dn=1.0)
    assert near(detect(frame, Detection()), 60.5, 150.5)
    clean = subtract_dark(frame, dark)
    assert np.isnan(clean.image[150:152, 60:62]).all()
    assert np.isnan(clean.image).sum() == 4
    assert clean.offset == 0
    assert clean.electrons_per_dn == 1
    spots = detect(clean, Detection())
    assert len(spots) == 1
    assert near(spots, 100.3, 90.8, 0.1)


def test_dark_frame_of_another_shape_is_refused():
    with pytest.raises(ValueError, match="dark must have the frame's shape"):
        subtract_dark(Frame(np.zeros((4, 5))), Frame(np.zeros((5, 4))))
    short, long = (Frame(np.zeros((4, 5)), exposure=second) for second in (0.1, 10.0))
    with pytest.warns(UserWarning, match="dark has an exposure of 10 s and the image of 0.1 s"):
        subtract_dark(short, long)
