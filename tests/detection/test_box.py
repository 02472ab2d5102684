"""Search boxes: the spots in them, compared with images written out here."""

import math

import numpy as np
import pytest

from startrack.core import Frame, arcsec
from startrack.detection import Box, Detection, box_reach, plan_detection, take
from startrack.detection.box import clipped_level, star_image
from startrack.detection.star_model import gaussian_psf

SIGMA = 1.2
PLAN = plan_detection(Detection(), gaussian_psf(SIGMA), None)


def image(stars, noise=3.0, seed=0, side=120):
    """A frame of stars (x, y, flux) on a background of 100, integrated over pixels by the error
    function."""
    value = np.full((side, side), 100.0)
    edge = np.arange(side + 1) - 0.5
    for x, y, flux in stars:
        lines = [
            np.diff([math.erf((e - at) / SIGMA / math.sqrt(2)) / 2 for e in edge]) for at in (y, x)
        ]
        value += flux * np.outer(*lines)
    value += noise * np.random.default_rng(seed).standard_normal(value.shape)
    return Frame(value.astype(np.float32), 1.0, 1.0, 100.0, noise)


@pytest.mark.parametrize("size", [4, 6, 8])
def test_a_star_is_taken_wherever_it_is_in_its_box(size):
    """Its place is within 5 sigma of its own noise plus 0.1 pixel for the edges of small images."""
    stars = [(40.3, 50.8, 5000.0), (80.0, 30.5, 3000.0)]
    box = Box(size=size)
    expected = np.array([[44.0, 45.0], [74.5, 37.0]])
    taken = take(image(stars), expected, np.array([5000.0, 3000.0]), 10.0, box, PLAN)
    sigma = np.sqrt(taken.covariance[:, 0, 0])
    allowed = 5 * sigma
    assert (np.abs(taken.x - [40.3, 80.0]) < allowed).all()
    assert (np.abs(taken.y - [50.8, 30.5]) < allowed).all()
    np.testing.assert_allclose(taken.flux, [5000, 3000], rtol=0.08)
    assert len(taken.spots()) == 2


def test_the_scatter_is_as_stated():
    """The mean square error of 400 noisy stars over the stated one, false alarm 1e-4."""
    rng = np.random.default_rng(4)
    places = np.array([(x, y) for x in range(20, 420, 20) for y in range(20, 420, 20)], float)
    places += rng.uniform(-0.5, 0.5, places.shape)
    stars = np.column_stack([places, np.full(len(places), 2000.0)])
    frame = image(stars, seed=5, side=440)
    sky = image(stars, noise=0.0, side=440).image - 100
    frame.image[...] += rng.poisson(sky) - sky
    taken = take(
        frame,
        places + rng.uniform(-3, 3, places.shape),
        np.full(len(places), 2000.0),
        6.0,
        Box(size=8),
        PLAN,
    )
    square = (taken.x - places[:, 0]) ** 2 / taken.covariance[:, 0, 0]
    assert 0.75 < square.mean() < 1.35


def test_the_brightest_within_the_limits_is_taken():
    """Beside a hot pixel as bright as the star, and a brighter star above the limit of
    brightness."""
    true, flux = (40.3, 50.8), np.array([1000.0])
    place = np.array([[42.0, 50.0]])
    frame = image([(*true, 1000.0)])
    frame.image[44, 46] += 1300
    taken = take(frame, place, flux, 10.0, Box(), PLAN)
    assert np.hypot(taken.x[0] - 46, taken.y[0] - 44) < 0.5
    frame.image[44, 46] += 20000  # far too bright: it is not the star
    taken = take(frame, place, flux, 10.0, Box(), PLAN)
    assert np.hypot(taken.x[0] - true[0], taken.y[0] - true[1]) < 0.3
    far = take(frame, np.array([[42.0, 75.0]]), flux, 10.0, Box(), PLAN)
    assert not far.found[0]
    assert len(far.spots()) == 0


def test_a_dynamic_background_takes_off_a_slope_and_a_hot_corner():
    frame = image([(40.3, 50.8, 2000.0)], noise=1.0)
    frame.image[...] += 2 * np.arange(120)[:, None]
    frame.image[47, 37] += 5000  # a corner of the background of the image
    for background, works in (("dynamic", True), ("none", False)):
        box = Box(background=background, brighter=0.7)
        taken = take(frame, np.array([[40.0, 51.0]]), np.array([2000.0]), 2.0, box, PLAN)
        good = taken.found[0] and np.hypot(taken.x[0] - 40.3, taken.y[0] - 50.8) < 0.2
        assert good == works, background


@pytest.mark.parametrize(
    ("pixels", "level"),
    [
        ([0, 0, 0, 0, 0, 0, 0, 100], 0),  # 100 is 87.5 from the mean of 12.5
        ([0, 0, 0, 0, 0, 0, 0, 11], 11 / 8),  # within 10 numbers
        ([20, 20, 20, 20, 20, 20, 20, 60], 25),  # within 1.5 times the mean
        ([20, 20, 20, 20, 20, 20, 60, 200], 25.714),  # without 200, of a mean of 47.5, 60 stays
        ([-4, -4, -4, -4, -4, -4, -4, 4], -3),
    ],
)
def test_the_clipped_background_is_that_of_the_published_rule(pixels, level):
    """By hand: the farthest value is left out while it deviates by 1.5 times the mean and by 10."""
    value = np.full((2, 8, 8), 1e6)
    for n, (row, column) in enumerate((r, c) for r in (0, 7) for c in (0, 1, 6, 7)):
        value[:, row, column] = pixels[n]
    assert clipped_level(value) == pytest.approx([level] * 2, abs=1e-3)


def test_more_hits_than_are_kept_drop_the_star():
    """A box of 12 x 12 blocks, of which some 25 are as bright as a hit."""
    true = np.array([[40.3, 50.8]])
    frame = image([(*true[0], 3000.0)])
    for x in range(30, 52, 4):
        for y in range(40, 62, 4):
            if max(abs(x - 40), abs(y - 51)) > 4:
                frame.image[y, x] += 800
    found = {}
    for hits in (4, 1000):
        taken = take(frame, true, np.array([3000.0]), 12.0, Box(hits=hits, hit=0.5), PLAN)
        found[hits] = np.hypot(taken.x[0] - true[0, 0], taken.y[0] - true[0, 1]) < 0.3
    assert found == {4: False, 1000: True}


def test_boxes_beyond_the_frame_find_nothing():
    taken = take(
        image([(5.0, 5.0, 5000.0)]),
        np.array([[5.0, 5.0], [np.nan, 3.0]]),
        np.array([5e3, 5e3]),
        10.0,
        Box(),
        PLAN,
    )
    assert not taken.found.any()


def test_what_an_image_holds():
    """An 8 x 8 image of a star of 1.2 pixel contains nearly all of its light, without
    background."""
    held = star_image(gaussian_psf(SIGMA), Box(size=8, background="none"))
    assert held.fraction == pytest.approx(0.998, abs=0.002)
    assert held.moment == pytest.approx((0, 0), abs=0.003)
    assert star_image(gaussian_psf(SIGMA), Box(size=4)).fraction < held.fraction
    assert box_reach(Box(half_width=120 * arcsec), 990 / 0.024) == pytest.approx(24.0, abs=0.01)


@pytest.mark.parametrize(
    ("values", "rule"),
    [({"size": 5}, "size"), ({"background": "flat"}, "background"), ({"half_width": 0.0}, "half")],
)
def test_boxes_that_make_no_sense_are_refused(values, rule):
    with pytest.raises(ValueError, match=rule):
        Box(**values)
