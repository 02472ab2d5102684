"""Excesses drawn by a tilted law against those of whole frames."""

import dataclasses

import cv2
import numpy as np
import pytest
from scipy import stats

from startrack.detector import Defects, Detector, frame_of
from startrack.detector.excess import excesses, numbers_of, rates_for, tilt_for
from startrack.detector.ground import ground, ground_tables
from startrack.detector.windows import odd_pixels
from startrack.streams import Streams

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
    level, tables = ground(detector, SKY), ground_tables(detector, SKY)
    return [frame_of(level, detector, Streams(7, n), tables).image for n in range(FRAMES)]


def passed_through(frames):
    return np.array([
        cv2.filter2D(one.astype(float), -1, WEIGHT, borderType=cv2.BORDER_REFLECT)
        for one in frames
    ])  # fmt: skip


@pytest.fixture(scope="module")
def frames():
    return images(DETECTOR)


@pytest.fixture(scope="module")
def filtered(frames):
    return passed_through(frames)


def drawn(level, regions=NONE, trials=FRAMES, detector=DETECTOR):
    """All excesses of many trials: row, column, numbers about it."""
    numbers = numbers_of(detector, SKY, odd_pixels(detector, SKY, 4.0).tobytes())
    tilt = tilt_for(numbers, WEIGHT, level, MESH, BORDER)
    rates = rates_for(numbers, tilt, np.full(len(tilt.most), level))
    found = [
        excesses(numbers, tilt, rates, MESH, BORDER, regions, Streams(8, n)) for n in range(trials)
    ]
    pixel = np.concatenate([each[0] for each in found])
    return (*np.divmod(pixel, detector.columns), np.concatenate([each[1] for each in found]))


@pytest.mark.parametrize("sigmas", [3.5, 4.5])
def test_excesses_come_as_often_and_as_high_as_in_frames(filtered, sigmas):
    """Counts within 4 standard deviations, heights by Kolmogorov and Smirnov beyond 1e-4.

    Excesses come in clumps of about three, which widens the counts of the frames.
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
    """The mean number of each pixel under the filter, given that the filter passes the level."""
    level = filtered.mean() + 3.5 * filtered.std()
    seen = [
        frames[n][y - 3 : y + 4, x - 3 : x + 4]
        for n, y, x in np.argwhere(filtered > level)
        if 3 <= y < 127 and 3 <= x < 137
    ]
    row, column, numbers = drawn(level)
    inside = (row >= 3) & (row < 127) & (column >= 3) & (column < 137)
    wanted, got = np.mean(seen, axis=0), numbers[inside].mean(axis=0)
    error = np.hypot(np.std(seen, axis=0) * np.sqrt(3 / len(seen)),
                     numbers[inside].std(axis=0) / np.sqrt(inside.sum()))  # fmt: skip
    assert (np.abs(wanted - got) < 4.5 * error).all()


def test_an_uneven_device_makes_them_where_its_pixels_are_high():
    """As often as in frames, 4 standard deviations, and in the same places, whose counts are told
    from each other: the correlation of two halves of the frames is reached."""
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


def test_levels_in_the_midst_of_the_noise_are_refused(filtered):
    with pytest.raises(ValueError, match="seldom passes, and here it is looked at"):
        drawn(float(filtered.mean()) + 1.0 * float(filtered.std()), trials=1)
