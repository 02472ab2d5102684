"""Dark maps: the signal that they subtract from a frame, and the rest."""

import numpy as np
import pytest

from startrack.core.values import Frame
from startrack.detection import (
    DarkFrames,
    DarkMap,
    Detection,
    calibrated,
    detect,
    gaussian_psf,
    plan_detection,
)

RNG = np.random.default_rng(7)
SIGNAL = 100 + 3 * RNG.standard_normal((40, 50))
SIGNAL[10, 12], SIGNAL[0, 0], SIGNAL[30, 30:32] = 400.0, 300.0, 500.0
NOISE = 2.0


def plan(signal=SIGNAL, saturation=None, **settings):
    detection = Detection(dark_map=DarkMap(**settings), saturation=saturation)
    return plan_detection(detection, gaussian_psf(1.0), lambda: DarkFrames(signal, NOISE))


def frame(image):
    return Frame(np.rint(image).astype(np.uint16))


def test_what_remains_is_the_rounding_of_the_map_and_of_the_frame():
    """Both roundings are uniform over one step: the closed form of the rms difference, 2 % by
    chance."""
    for step in (0.5, 4.0):
        left = calibrated(frame(SIGNAL), plan(step=step)).value
        usual = np.ones(left.shape, bool)
        usual[[10, 0, 30, 30], [12, 0, 30, 31]] = False
        assert left[usual].std() == pytest.approx(np.sqrt((step**2 + 1) / 12), rel=0.1)
        assert left[usual].mean() == pytest.approx(100, abs=0.5)


def test_hot_pixels_take_the_mean_of_the_neighbours_that_are_not_hot():
    found = calibrated(frame(SIGNAL), plan(hot=20.0))
    assert np.flatnonzero(found.dead).tolist() == [0, 10 * 50 + 12, 30 * 50 + 30, 30 * 50 + 31]
    value = found.value
    assert value[0, 0] == pytest.approx(np.mean([value[0, 1], value[1, 0], value[1, 1]]))
    around = value[29:32, 29:32].copy()
    around[1, 1:] = np.nan
    assert value[30, 30] == pytest.approx(np.nanmean(around))


def test_a_list_of_hot_pixels_leaves_the_others_as_they_are():
    image = frame(SIGNAL)
    found = calibrated(image, plan(subtracted=False, hot=20.0))
    usual = found.dead == 0
    assert (found.value[usual] == image.image[usual]).all()
    assert (found.value[~usual] < 120).all()


def test_a_block_of_hot_pixels_takes_the_nearest_others():
    signal = np.full((30, 30), 100.0)
    signal[5:12, 7:14] = 900.0
    assert (calibrated(frame(signal), plan(signal)).value == 100).all()


def test_saturated_pixels_stay_saturated():
    image = np.full(SIGNAL.shape, 110.0)
    image[20, 20:23] = 4095
    value = calibrated(frame(image), plan(saturation=4095.0)).value
    assert (value[20, 20:23] == 4095).all()
    assert (value[5:8] < 130).all()


def test_a_map_without_dark_frames_or_of_another_size_is_refused():
    with pytest.raises(ValueError, match="dark_map needs dark frames of the detector"):
        detect(frame(SIGNAL), Detection(dark_map=DarkMap()), gaussian_psf(1.0))
    with pytest.raises(ValueError, match=r"shape \(40, 50\) of the dark map, got \(50, 40\)"):
        detect(frame(SIGNAL.T), plan())
