"""Peaks that look like hot pixels, against noisy stars."""

import numpy as np
import pytest

from startrack.detection.examine import chance_to_pass, is_hot, largest_fraction

LEVEL, NOISE, SHOT, HALF = 100.0, 2.0, 0.2, 9
FRACTION = largest_fraction(0.35)


def star(flux, sigma=0.6):
    """Expected numbers of a star centred between two pixels."""
    at = np.arange(-HALF, HALF + 1)
    x, y = np.meshgrid(at - 0.2, at + 0.1)
    return LEVEL + flux * np.exp(-(x**2 + y**2) / (2 * sigma**2)) / (2 * np.pi * sigma**2)


@pytest.mark.usefixtures("in_python")
@pytest.mark.parametrize("flux", [25.0, 40.0, 80.0])
def test_the_chance_to_pass_is_the_share_of_noisy_stars_that_do(flux):
    """1000 stars; 4 standard deviations of their fraction and of that of 400 patterns of noise."""
    mean, rng = star(flux), np.random.default_rng(3)
    spread = np.sqrt(NOISE**2 + SHOT * (mean - LEVEL))
    frames = (mean + spread * rng.standard_normal((1000, *mean.shape))).astype(np.float32)
    middle = np.array([HALF])
    passed = np.mean([not is_hot(each, HALF, HALF, 2, FRACTION) for each in frames])
    image = mean.astype(np.float32)
    chance = chance_to_pass(image, middle, middle, LEVEL, NOISE, SHOT, FRACTION)[0]
    doubt = np.sqrt(max(passed * (1 - passed), 1e-3) * (1 / 1000 + 1 / 400))
    assert 0.5 < chance <= 1
    assert abs(passed - chance) < 4 * doubt


def test_a_hot_pixel_never_passes():
    image = np.full((2 * HALF + 1, 2 * HALF + 1), LEVEL, np.float32)
    image[HALF, HALF] += 1000
    middle = np.array([HALF])
    assert chance_to_pass(image, middle, middle, LEVEL, NOISE, SHOT, FRACTION)[0] == 0
