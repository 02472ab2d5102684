"""Threshold crossings drawn by a tilted law, against those of whole frames."""

import dataclasses

import cv2
import numpy as np
import pytest
from scipy import ndimage, optimize, stats

from startrack.core.streams import Streams
from startrack.detector import Defects, Detector, frame_of
from startrack.detector.collect import background, background_tables
from startrack.detector.threshold_crossings import (
    NumberDistributions,
    number_distributions,
    proposal_rates,
    threshold_crossings,
    tilted_law,
)
from startrack.detector.windows import outlier_pixels

# Few electrons and coarse numbers, where a normal law would be far off.
DETECTOR = Detector(
    140, 130, 5e-6, 0.1, read_noise=1.5, prnu=0.1, full_well=8000.0, offset=20, bits=12
)
SKY = 4.0
FRAMES = 300
MESH, BORDER = 32, 2
NONE = np.zeros((0, 4), np.int64)


def bell(sigma, half):
    x = np.arange(-half, half + 1)
    line = np.exp(-(x**2) / (2 * sigma**2))
    return np.outer(line, line) / line.sum() ** 2


WEIGHT = bell(1.0, 3)


# So uneven that a pixel in ten lies off by more than its noise.
UNEVEN = dataclasses.replace(DETECTOR, defects=Defects(dsnu=15.0))


def images(detector):
    level, tables = background(detector, SKY), background_tables(detector, SKY)
    return [frame_of(level, detector, Streams(7, n), tables).image for n in range(FRAMES)]


def passed_through(frames):
    return np.array(
        [
            cv2.filter2D(one.astype(float), -1, WEIGHT, borderType=cv2.BORDER_REFLECT)
            for one in frames
        ]
    )


@pytest.fixture(scope="module")
def frames():
    return images(DETECTOR)


@pytest.fixture(scope="module")
def filtered(frames):
    return passed_through(frames)


def drawn(level, regions=NONE, trials=FRAMES, detector=DETECTOR):
    """All crossings of many trials: row, column, and the numbers around them."""
    numbers = number_distributions(detector, SKY, outlier_pixels(detector, SKY, 4.0))
    tilt = tilted_law(numbers, WEIGHT, level, MESH, BORDER)
    rates = proposal_rates(numbers, tilt, np.full(len(tilt.most), level))
    found = [
        threshold_crossings(numbers, tilt, rates, MESH, BORDER, regions, Streams(8, n))
        for n in range(trials)
    ]
    pixel = np.concatenate([each[0] for each in found])
    return (*np.divmod(pixel, detector.columns), np.concatenate([each[1] for each in found]))


@pytest.mark.parametrize("sigmas", [3.5, 4.5])
def test_excesses_come_as_often_and_as_high_as_in_frames(filtered, sigmas):
    """Counts within 4 standard deviations, heights by a test of Kolmogorov and Smirnov at 1e-4.

    Crossings come in groups of about three, which widens the distribution of the counts.
    """
    level = filtered.mean() + sigmas * filtered.std()
    inner = filtered[:, BORDER:-BORDER, BORDER:-BORDER]
    over = inner > level
    row, column, numbers = drawn(level)
    counts = over.sum(axis=(1, 2))
    spread = np.hypot(counts.std() * np.sqrt(FRAMES), np.sqrt(len(row)))
    assert abs(len(row) - counts.sum()) < 4 * spread
    inside = (row >= 3) & (row < 127) & (column >= 3) & (column < 137)
    height = (numbers[inside] * WEIGHT).sum(axis=(1, 2))
    assert (height > level).all()
    assert stats.ks_2samp(height, inner[over][:: 3 if sigmas < 4 else 1]).pvalue > 1e-4


def test_the_mirrored_border_has_its_own_rate(filtered):
    level = filtered.mean() + 3.5 * filtered.std()
    edge = np.zeros(filtered.shape[1:], bool)
    edge[BORDER:-BORDER, BORDER:-BORDER] = True
    edge[3:-3, 3:-3] = False
    counts = (filtered[:, edge] > level).sum(axis=1)
    row, column, _ = drawn(level)
    got = edge[row, column].sum()
    assert abs(got - counts.sum()) < 4 * np.hypot(counts.std() * np.sqrt(FRAMES), np.sqrt(got))


def test_numbers_about_an_excess_have_its_shape(frames, filtered):
    """The mean number of each pixel of the filter, given that the filter exceeds the level."""
    level = filtered.mean() + 3.5 * filtered.std()
    seen = [
        frames[n][y - 3 : y + 4, x - 3 : x + 4]
        for n, y, x in np.argwhere(filtered > level)
        if 3 <= y < 127 and 3 <= x < 137
    ]
    row, column, numbers = drawn(level)
    inside = (row >= 3) & (row < 127) & (column >= 3) & (column < 137)
    wanted, got = np.mean(seen, axis=0), numbers[inside].mean(axis=0)
    error = np.hypot(
        np.std(seen, axis=0) * np.sqrt(3 / len(seen)),
        numbers[inside].std(axis=0) / np.sqrt(inside.sum()),
    )
    assert (np.abs(wanted - got) < 4.5 * error).all()


def test_an_uneven_device_makes_them_where_its_pixels_are_high():
    """As often as in frames, within 4 standard deviations, and at the same places.

    The places are compared by their counts: the correlation is that of two halves of the frames.
    """
    filtered = passed_through(images(UNEVEN))[:, BORDER:-BORDER, BORDER:-BORDER]
    level = filtered.mean() + 3.5 * filtered.std()
    over = filtered > level
    counts = over.sum(axis=(1, 2))
    row, column, _ = drawn(level, detector=UNEVEN)
    spread = np.hypot(counts.std() * np.sqrt(FRAMES), np.sqrt(len(row)))
    assert abs(len(row) - counts.sum()) < 4 * spread
    place = np.zeros((130, 140))
    np.add.at(place, (row, column), 1)
    halves = over[::2].sum(axis=0), over[1::2].sum(axis=0)
    whole = over.sum(axis=0), place[BORDER:-BORDER, BORDER:-BORDER]
    alike, got = (np.corrcoef(*(each.ravel() for each in pair))[0, 1] for pair in (halves, whole))
    assert alike > 0.3
    assert got > alike


def test_regions_are_left_out():
    regions = np.array([[0, 0, 70, 130]])
    _, column, _ = drawn(22.0 + 1.6, regions, 50)
    assert len(column)
    assert (column >= 70).all()


def test_a_region_takes_the_excesses_in_it_and_no_other():
    """For one crossing in three its own pixel is a region, for the others the pixel left or
    above."""
    row, column, _ = drawn(22.0 + 1.6, trials=60)
    own = np.stack([column, row, column + 1, row + 1], axis=1)
    beside = np.concatenate([own[1::3] - [1, 0, 1, 0], own[2::3] - [0, 1, 0, 1]])
    regions = np.concatenate([own[::3], beside])
    taken = np.zeros((130, 140), bool)
    for left, top, right, bottom in regions:
        taken[top:bottom, left:right] = True
    lost = taken[row, column]
    kept = drawn(22.0 + 1.6, regions, trials=60)
    assert 10 < lost.sum() < len(row) / 2
    np.testing.assert_array_equal(kept[0], row[~lost])
    np.testing.assert_array_equal(kept[1], column[~lost])


LOWEST = 7
UNLIKE = np.random.default_rng(3).uniform(0.2, 1.0, (3, 5))  # no two weights alike
UNLIKE[0, 0] = UNLIKE[2, 3]  # but these


def uneven_laws():
    """Five laws of twelve numbers, and pixels between them."""
    rng = np.random.default_rng(5)
    law = rng.uniform(0.1, 1.0, (5, 12)) * np.exp(-np.arange(12) / np.arange(1, 6)[:, None])
    place = rng.uniform(0, 4, (9, 11)).astype(np.float32)
    place[4, 4], place[5, 7] = 0.0, 4.0
    return NumberDistributions(law / law.sum(axis=1, keepdims=True), place, LOWEST)


def cumulant(numbers, weight, theta, x, y):
    """log E exp(theta filtered), pixel by pixel, of a frame that numpy mirrors at its border."""
    law, place = numbers.probability, numbers.place.astype(float)
    down, across = (n // 2 for n in weight.shape)
    which = np.pad(
        np.arange(place.size).reshape(place.shape), ((down,) * 2, (across,) * 2), "symmetric"
    )[y : y + weight.shape[0], x : x + weight.shape[1]]
    fraction = np.bincount(which.ravel(), weight.ravel(), place.size)
    low = np.minimum(place.astype(int), len(law) - 2).ravel()
    t = place.ravel() - low
    own = law[low] * (1 - t[:, None]) + law[low + 1] * t[:, None]
    number = numbers.lowest + np.arange(law.shape[1])
    return np.log((own * np.exp(theta * np.outer(fraction, number))).sum(axis=1)).sum()


@pytest.mark.parametrize(("mesh", "border"), [(1, 0), (1, 2), (4, 0), (4, 1)])
def test_rates_are_those_of_the_exponential_moments(mesh, border):
    """exp(K - theta level), in the frame and mirrored at its border, tile by tile."""
    numbers = uneven_laws()
    typical = (LOWEST + 8.0) * UNLIKE.sum()
    tilt = tilted_law(numbers, UNLIKE, typical, mesh, border)
    down, across = -(-9 // mesh), -(-11 // mesh)
    level = typical + np.random.default_rng(6).uniform(0, 9, (down, across))
    rates = proposal_rates(numbers, tilt, level)
    wanted = np.zeros((down, across))
    for y in range(border, 9 - border):
        for x in range(border, 11 - border):
            k = cumulant(numbers, UNLIKE, tilt.theta, x, y)
            wanted[y // mesh, x // mesh] += np.exp(k - tilt.theta * level[y // mesh, x // mesh])
    assert rates.total == pytest.approx(wanted.sum(), rel=1e-6)
    np.testing.assert_allclose(
        np.diff(rates.fraction, prepend=0) * rates.total, wanted.ravel(), rtol=1e-5, atol=1e-9
    )


def test_rates_of_a_large_frame_take_a_few_filters(monkeypatch):
    """Some passes over the whole frame instead of a sum over weights at each pixel."""
    filters = []
    own = cv2.filter2D
    monkeypatch.setattr(cv2, "filter2D", lambda *a, **k: filters.append(a) or own(*a, **k))
    numbers = number_distributions(DETECTOR, SKY, outlier_pixels(DETECTOR, SKY, 4.0))
    tilted_law(numbers, WEIGHT, 23.6, MESH, BORDER)
    assert 1 <= len(filters) <= 4


@pytest.mark.parametrize("number", [3.0, 5.0, 8.0])
def test_theta_makes_the_level_typical(number):
    """The slope of K is the level: theta for the filter over an average pixel, by scipy's root."""
    numbers = uneven_laws()
    level = (LOWEST + number) * UNLIKE.sum()
    law, place = numbers.probability, float(np.median(numbers.place))
    own = law[int(place)] * (1 - place % 1) + law[int(place) + 1] * (place % 1)

    def mean(theta):
        tilted = own * np.exp(theta * np.outer(UNLIKE.ravel(), np.arange(12)))
        return UNLIKE.ravel() @ (tilted @ np.arange(12) / tilted.sum(axis=1))

    wanted = optimize.brentq(lambda theta: mean(theta) - number * UNLIKE.sum(), 0, 50)
    got = tilted_law(numbers, UNLIKE, level, 1, 0).theta
    assert got == pytest.approx(wanted, rel=1e-5)


def test_excesses_of_pixels_without_noise_are_where_the_filter_passes():
    """Each pixel has a known number: scipy gives the crossings, with the numbers around them."""
    place = np.random.default_rng(8).integers(0, 12, (9, 11))
    numbers = NumberDistributions(np.eye(12), place.astype(np.float32), LOWEST)
    filtered = ndimage.correlate(place + float(LOWEST), UNLIKE, mode="reflect")
    level = float(np.median(filtered))
    tilt = tilted_law(numbers, UNLIKE, 0.0, 4, 1)
    rates = proposal_rates(numbers, tilt, np.full((3, 3), level))
    around = np.pad(place, ((1, 1), (2, 2)), constant_values=-1) + LOWEST
    over = np.zeros(place.shape, bool)
    over[1:-1, 1:-1] = (filtered > level)[1:-1, 1:-1]
    times = np.zeros(place.size)
    for trial in range(100):
        found = threshold_crossings(numbers, tilt, rates, 4, 1, NONE, Streams(9, trial))
        for pixel, about in zip(*found, strict=True):
            y, x = divmod(pixel, 11)
            np.testing.assert_array_equal(about, around[y : y + 3, x : x + 5])
            times[pixel] += 1
    # Poisson's counts of mean 100 each: 5 standard deviations of 30 pixels fail once in 50 000.
    assert (times[~over.ravel()] == 0).all()
    assert np.abs(times[over.ravel()] - 100).max() < 50
