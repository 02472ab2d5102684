"""Waves in the glint: the sea against published laws, images against Cox and Munk, errors."""

import math
from dataclasses import replace

import numpy as np
import pytest

from startrack import Refused
from startrack.core import Streams
from startrack.earth.retrieval import (
    EarthProblem,
    Sea,
    Waves,
    developed_sea,
    draw_sea,
    elevation_power,
    forecast_waves,
    load_earth_design,
    observe_waves,
    retrieve_waves,
    slope_variance,
)
from startrack.earth.retrieval.glint import glint_over, scatter_of

DESIGN = load_earth_design("waves")
OWN = DESIGN.retrieval.waves


@pytest.mark.parametrize("wind", [5.0, 10.0, 20.0])
def test_developed_sea_is_as_high_as_published(wind):
    """H = 0.21 U^2 / g (Pierson and Moskowitz 1964); 8 s of period at 11.5 m/s."""
    height, wavelength = developed_sea(wind)
    assert height == pytest.approx(0.21 * wind**2 / 9.81, rel=0.01)
    period = math.sqrt(2 * math.pi * wavelength / 9.81)
    assert period == pytest.approx(2 * math.pi * wind / (0.877 * 9.81), rel=0.001)


@pytest.mark.parametrize("wind", [5.0, 10.0])
def test_slopes_of_gravity_waves_lie_between_a_slick_and_a_clean_sea(wind):
    """Cox and Munk (1954): 0.008 + 0.00156 U under oil, 0.003 + 0.00512 U without it."""
    height, wavelength = developed_sea(wind)
    found = slope_variance(Sea(height, wavelength, 0.0, 1.0, 2.0), 0.017)
    assert 0.008 + 0.00156 * wind < found < 0.003 + 0.00512 * wind


@pytest.mark.parametrize(("peakedness", "spreading"), [(1.0, 2.0), (3.3, 9.0)])
def test_a_drawn_sea_has_its_height_its_slopes_and_its_direction(peakedness, spreading):
    sea = Sea(2.0, 80.0, 0.6, peakedness, spreading)
    step = 4.0, 5.0
    frequency = np.stack(
        np.meshgrid(*(np.fft.fftfreq(512, width) for width in step), indexing="ij"), -1
    )
    total = elevation_power(sea, frequency).sum() / (512**2 * step[0] * step[1])
    assert total == pytest.approx(2.0**2 / 16, rel=0.02)  # shorter waves: 1.25 / 8.5^2
    level, down, right = draw_sea(sea, Streams(1, 1)("sea"), 512, step, 10.0)
    assert 4 * level.std() == pytest.approx(2.0, rel=0.05)
    assert (down**2 + right**2).mean() == pytest.approx(slope_variance(sea, 10.0), rel=0.02)
    # Parseval: mean square slopes along both axes of |cos|^n about the direction.
    even = spreading / (spreading + 2) * math.cos(2 * 0.6)
    share = (down**2).mean() / (down**2 + right**2).mean()
    assert share == pytest.approx((1 + even) / 2, abs=0.04)
    long = draw_sea(sea, Streams(1, 1)("sea"), 256, step, 60.0)
    slopes = np.gradient(long[0], step[0], axis=0)[1:-1]
    assert np.corrcoef(slopes.ravel(), long[1][1:-1].ravel())[0, 1] > 0.999


def test_the_mean_light_does_not_depend_on_what_waves_are_drawn():
    """All waves together have the mean square slope of Cox and Munk (1954) for the wind.

    Waves at 45 degrees to the Sun have equal slopes towards the Sun and across.
    """
    own = replace(OWN, direction=OWN.sun_azimuth + math.pi / 4)
    calm = replace(own, significant_height=1e-3)
    light = [observe_waves(DESIGN, sea, 1, 1).radiance.mean() for sea in (calm, own)]
    assert light[1] / light[0] == pytest.approx(1.0, abs=0.01)


def test_height_and_direction_are_found_in_an_image():
    image = observe_waves(DESIGN, OWN, 1, 1)
    found = retrieve_waves(DESIGN, OWN, image.radiance)
    assert found.height == pytest.approx(image.height, rel=0.03)
    assert abs(math.remainder(found.direction - image.direction, math.pi)) < math.radians(2)
    assert found.wavelength == pytest.approx(OWN.peak_wavelength, rel=0.1)
    opposite = retrieve_waves(DESIGN, OWN, image.radiance[::-1, ::-1])
    assert opposite.height == pytest.approx(found.height, rel=1e-3)
    assert math.remainder(opposite.direction - found.direction, math.pi) == pytest.approx(
        0, abs=1e-3
    )


def test_a_wind_that_is_taken_for_another_changes_the_height():
    """Contrast is slope over mean square slope: with 12 % more mean square slope, the height is
    12 % larger."""
    image = observe_waves(DESIGN, OWN, 1, 2)
    believed = retrieve_waves(DESIGN, replace(OWN, wind=OWN.wind + 1), image.radiance)
    ratio = (0.003 + 0.00512 * (OWN.wind + 1)) / (0.003 + 0.00512 * OWN.wind)
    assert believed.height / image.height == pytest.approx(ratio, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("values", [{}, {"direction": -1.12}, {"sun_zenith": 0.7}])
def test_formula_and_trials_agree(values):
    own = replace(OWN, **values)
    expected = forecast_waves(DESIGN, own)
    squares = []
    for number in range(60):
        image = observe_waves(DESIGN, own, 1, number)
        found = retrieve_waves(DESIGN, own, image.radiance)
        turn = math.remainder(found.direction - image.direction, math.pi)
        squares.append([(found.height - image.height) ** 2, turn**2])
    height, direction = np.sqrt(np.mean(squares, axis=0))
    assert height == pytest.approx(expected.height_error, rel=0.25)
    assert direction == pytest.approx(expected.direction_error, rel=0.25)


def test_noise_and_blur_make_errors_larger():
    start = EarthProblem(DESIGN)
    as_designed = start.expect().parts
    for values in (
        {"channels.*.detector.read_noise": 500.0},
        {"channels.*.optics.f_number": 8.0, "channels.*.optics.blur": 6e-6},
    ):
        worse = start.replaced(values).expect().parts
        for name, value in as_designed.items():
            assert worse[name] > value


def test_what_is_no_sea_is_refused():
    with pytest.raises(Refused, match="significant_height"):
        forecast_waves(DESIGN, replace(OWN, significant_height=6.0))
    start = EarthProblem(DESIGN)
    with pytest.raises(Refused, match="bits of channel B8 must make steps"):
        start.replaced({"channels.*.detector.bits": 7, "channels.*.detector.offset": 4}).expect()
    with pytest.raises(Refused, match="visible enough"):
        start.replaced({"channels.*.detector.read_noise": 5000.0}).expect()
    with pytest.raises(Refused, match="follow the slopes"):
        forecast_waves(DESIGN, replace(OWN, sun_zenith=0.1))
    with pytest.raises(Refused, match="rays"):
        forecast_waves(replace(DESIGN, rays=2), OWN)
    with pytest.raises(Refused, match="channel"):
        forecast_waves(DESIGN, replace(OWN, channel="B99"))
    with pytest.raises(Refused, match="latitude"):
        replace(DESIGN.retrieval, latitude=0.5)
    with pytest.raises(Refused, match="peakedness"):
        Waves(peakedness=0.5)


@pytest.fixture(scope="module")
def drawn():
    """Random slopes (draws, 2, n, n) of a steep sea, and its statistics for an oblique Sun."""
    sea, size, step = Sea(2.0, 60.0, 0.4, 1.0, 2.0), 16, (10.0, 10.0)
    towards, rough = np.array([0.15, -0.06]), 0.02
    random = Streams(1, 1)("sea")
    draws = [draw_sea(sea, random, size, step, 20.0) for _ in range(4000)]
    level, slopes = np.array([draw[0] for draw in draws]), np.array([draw[1:] for draw in draws])
    state = glint_over(rough, towards, sea, size, step, 20.0)
    return sea, step, towards, rough, state, level, slopes


def test_brightness_varies_with_the_waves_as_drawn_seas_have_it(drawn):
    """Covariance of sums of squares of brightness and of elevation, against 4000 drawn seas.

    For 4000 seas the covariance along the Sun scatters by 3 %, across by 13 %. A brightness that
    depends on the slopes alone would have 1.16 and 0.54 times the values.
    """
    sea, step, towards, rough, state, level, slopes = drawn
    size = level.shape[1]
    down, right = np.meshgrid(*(np.fft.fftfreq(size, width) for width in step), indexing="ij")
    weight = np.exp(-((down / 0.02) ** 2) - (right / 0.03) ** 2)
    weight[0, 0] = 0.0
    bright = np.exp(-((towards[:, None, None] - slopes) ** 2).sum(1) / rough)
    bright = bright / bright.mean((1, 2), keepdims=True) - 1
    seen = (weight * np.abs(np.fft.fft2(bright)) ** 2).sum((1, 2)) / size**4
    wave = np.abs(np.fft.fft2(level)) ** 2 / size**4
    power = elevation_power(sea, np.stack([down, right], -1), 20.0) / (size**2 * step[0] * step[1])
    power[0, 0] = 0.0
    found = scatter_of(state, towards, sea, weight, step, 20.0).follows
    size_of = np.maximum(np.hypot(down, right), 1e-9)
    seen_by = np.abs(towards[0] * down + towards[1] * right) / size_of / np.hypot(*towards)
    half = (down > 0) | ((down == 0) & (right > 0))
    for waves, scatter in ((half & (seen_by > 0.8), 0.03), (half & (seen_by < 0.4), 0.13)):
        covariance = np.cov(seen, wave[:, waves].sum(1))[0, 1]
        assert covariance == pytest.approx((power * found)[waves].sum(), rel=3 * scatter)


def test_pairs_of_waves_are_not_independent_of_the_third(drawn):
    """Variance of sums of g z (z H z) of drawn seas, against g z of one sea with z H z of another.

    Sums of 4000 seas scatter by 3 %.
    """
    sea, step, towards, _, state, _, slopes = drawn
    size = slopes.shape[-1]
    weight = np.ones((size, size))
    weight[0, 0] = 0.0
    bend = np.outer(state.gain, state.gain) - np.linalg.inv(state.slopes)
    line = np.einsum("a,naxy->nxy", state.gain, slopes)
    pair = np.einsum("naxy,ab,nbxy->nxy", slopes, bend, slopes, optimize=True)
    pair -= pair.mean(0)
    together, apart = ((line * other).mean((1, 2)).var() for other in (pair, np.roll(pair, 1, 0)))
    found = scatter_of(state, towards, sea, weight, step, 20.0).pairs
    assert found > apart
    assert together == pytest.approx(apart + found, rel=0.15)
