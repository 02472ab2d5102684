"""Likelihood ratio of brightness against integrals over the zero point, and its robustness."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from startrack.identification.evidence import log_brightness

pytestmark = pytest.mark.usefixtures("in_python")
SPOTS = np.array([-8.0, -9.5, -7.2, -10.1, -8.8, -6.4, -9.0])
STARS = SPOTS + 12.0 + np.array([0.3, -0.2, 0.1, 0.0, 0.4, -0.3, -0.1])
OUTLIER_FRACTION = 0.1  # the fraction of stars that may be as bright as any spot


def ratio(spot, star, magnitude=SPOTS, expected=STARS, spot_blur=0.4, star_blur=0.3):
    """R of the equation of `log_brightness`; blurs are (k,) or the same for all."""
    k = len(spot)
    factor = log_brightness(
        magnitude,
        np.broadcast_to(spot_blur, k).astype(float),
        expected,
        np.broadcast_to(star_blur, k).astype(float),
        np.array(spot, int),
        np.array(star, int),
    )
    return 2 * np.exp(factor) - 1


def integral(spot, star, magnitude=SPOTS, expected=STARS, blur=0.5):
    """The same by scipy: all zero points within 2.25 magnitudes of the one by medians."""
    low, high = magnitude.min() - 0.5, magnitude.max() + 0.5
    flat = stats.uniform(low, high - low)
    bell = stats.norm(magnitude.mean(), max(magnitude.std(), 0.5))
    middle = np.median(magnitude) - np.median(expected)

    def product(z):
        each = 1.0
        for m, s in zip(spot, star, strict=True):
            chance = (bell.pdf(magnitude[m]) + flat.pdf(magnitude[m])) / 2
            likely = stats.norm.pdf(magnitude[m], expected[s] + middle + z, blur)
            each *= 0.9 * likely / chance + 0.1
        return each

    return quad(product, -2.25, 2.25, limit=200, epsabs=1e-12)[0] / 4.5


@pytest.mark.parametrize(
    ("spot", "star"),
    [([0], [0]), ([5], [5]), ([3], [3]), ([3, 5], [3, 5]), ([0, 1, 2], [0, 1, 2]), ([1], [4])],
)
def test_the_ratio_is_the_mean_over_zero_points(spot, star):
    """The true pairs lie well within the range of zero points, so that their sum is exact to
    1e-4."""
    assert ratio(spot, star) == pytest.approx(integral(spot, star), rel=1e-3)


def test_spots_of_one_brightness_have_a_spread_of_half_a_magnitude():
    even = np.array([-8.0, -8.02, -8.04, -8.06])
    stars = even + 12.0
    wanted = integral([0, 3], [0, 3], even, stars)
    assert ratio([0, 3], [0, 3], even, stars) == pytest.approx(wanted, rel=1e-3)


def test_the_noise_of_spot_and_star_add_in_squares():
    assert ratio([2], [1], spot_blur=0.3, star_blur=0.4) == pytest.approx(ratio([2], [1]))
    assert ratio([0, 1], [0, 1], spot_blur=0.5, star_blur=0.0) == pytest.approx(
        ratio([0, 1], [0, 1])
    )


def test_each_match_has_its_own_noise():
    """Exchanging the noise together with the matches changes nothing; given to the others it
    does."""
    spot, star = np.array([0, 1]), np.array([0, 4])
    own = ratio(spot, star, spot_blur=[0.1, 0.6], star_blur=[0.1, 0.6])
    assert ratio(spot[::-1], star[::-1], spot_blur=[0.6, 0.1], star_blur=[0.6, 0.1]) == (
        pytest.approx(own)
    )
    assert ratio(spot, star, spot_blur=[0.6, 0.1], star_blur=[0.6, 0.1]) != pytest.approx(own)


@pytest.mark.parametrize("matches", [1, 2, 3])
def test_stars_of_very_different_brightness_are_outliers(matches):
    """Each outlier has the factor 0.1, however large the difference."""
    expected = np.append(STARS, [60.0, 70.0, 80.0])
    far = 7 + np.arange(matches)
    assert ratio(far - 7, far, expected=expected) == pytest.approx(OUTLIER_FRACTION**matches)


def test_units_of_flux_and_zero_points_do_not_matter():
    every = np.arange(7)
    one = ratio(every, every)
    assert ratio(every, every, magnitude=SPOTS + 31.0) == pytest.approx(one)
    assert ratio(every, every, expected=STARS - 5.0) == pytest.approx(one)
    assert ratio(every, every, magnitude=SPOTS[::-1].copy(), expected=STARS[::-1].copy()) == (
        pytest.approx(one)
    )


@pytest.mark.parametrize("outlier", [-25.0, 15.0])
def test_one_extremely_bright_spot_does_not_move_the_zero_point(outlier):
    """The Moon among nine stars: the stars agree as before, by the scale of the medians."""
    expected = np.linspace(2.0, 6.0, 9)
    magnitude = np.append(expected - 12.0, outlier)
    every = np.arange(9)
    assert np.log(ratio(every, every, magnitude, expected)) > 9


def test_zero_points_come_from_medians_of_as_many_stars_as_there_are_spots():
    """The stars differ by eight magnitudes, so that any other zero point is far off."""
    magnitude = np.linspace(-10.0, -2.0, 9) ** 3 / 100
    expected = magnitude + 12.0
    every = np.arange(9)
    alone = ratio(every, every, magnitude, expected)
    assert np.log(alone) > 9
    faint = np.append(expected, np.linspace(13.0, 19.0, 40))
    assert ratio(every, every, magnitude, faint) == pytest.approx(alone, rel=1e-12)
    faint_first = np.roll(faint, 40)
    assert ratio(every, every + 40, magnitude, faint_first) == pytest.approx(alone, rel=1e-12)


def test_a_match_of_unknown_flux_has_the_factor_one():
    magnitude = np.append(SPOTS, np.nan)
    expected = np.append(STARS, 30.0)
    one = ratio([0, 2], [0, 2], magnitude, expected)
    assert ratio([0, 7, 2], [0, 3, 2], magnitude, expected) == one
    assert ratio([0, 1, 2], [0, 1, 2], magnitude, expected, [0.4, np.inf, 0.4]) == one


def test_one_known_flux_has_no_zero_point_and_two_have():
    two = np.array([-8.0, np.nan, -9.0])
    expected = np.array([4.0, 5.0, 3.0])
    wanted = integral([0, 1], [0, 2], two[[0, 2]], expected)
    assert ratio([0, 2], [0, 2], two, expected) == pytest.approx(wanted, rel=1e-3)
    assert ratio([0], [0], np.array([-8.0, np.nan, np.nan]), expected) == 1
