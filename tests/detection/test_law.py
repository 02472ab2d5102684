"""Tails of filtered photon noise against the exact law; numbers of false spots against the
setting."""

import numpy as np
import pytest
from scipy.stats import norm, poisson

from startrack.core.streams import Streams
from startrack.core.values import Frame
from startrack.detection import Detection, detect, false_alarms, plan_detection
from startrack.detection.matched import Kernel, equivalent_sigmas, noise_from_gain
from startrack.detection.pixels import PixelGain

SIDE = 1024
LINE = np.array([1, 2, 1])


def exact_tail(mean, level):
    """P(weights 1, 2, 4 times Poisson numbers of means 4, 4 and 1 exceed the level), plus half
    of the probability of equality."""
    whole = np.ones(1)
    for weight, cells in ((1, 4), (2, 4), (4, 1)):
        count = np.arange(int(mean * cells + 12 * np.sqrt(mean * cells) + 40))
        law = np.zeros(weight * (len(count) - 1) + 1)
        law[::weight] = poisson.pmf(count, mean * cells)
        whole = np.convolve(whole, law)
    place = np.arange(len(whole))
    return whole[place > level].sum()


@pytest.mark.parametrize("mean", [2.0, 10.0, 60.0])
def test_the_level_is_passed_as_often_as_normal_noise_passes_it(mean):
    kernel = Kernel((np.outer(LINE, LINE) / 16).astype(np.float32), None, None)
    gain = PixelGain(0.5, 100.0, 0.0)
    rms, skewness, kurtosis = noise_from_gain(np.float64(100 + 2 * mean), gain, 0.0, kernel)
    level = mean + 0.5 * rms * equivalent_sigmas(5.0, skewness, kurtosis)
    # The sum moves in steps of 1/16, so the law is known between two of them only.
    low, high = (exact_tail(mean, 16 * level + half) for half in (0.5, -0.5))
    assert 0.9 * low < norm.sf(5.0) < 1.1 * high


def noise(trial, background, read_noise, seed, known):
    streams = Streams(seed, trial)
    image = streams("shot noise").poisson(background, (SIDE, SIDE)).astype(np.float32)
    image += read_noise * streams("read noise").standard_normal((SIDE, SIDE), np.float32)
    whole = np.round(image + 50).astype(np.uint16)
    return Frame(whole, np.nan, 1.0, 50.0, read_noise) if known else Frame(whole)


@pytest.mark.parametrize(
    ("sigma", "background", "read_noise", "known", "within"),
    [
        (0.7, 50, 5, True, 1.35),
        (1.2, 50, 5, True, 1.35),
        (0.7, 50, 5, False, 1.6),
        (1.0, 0.5, 0.5, True, 1.5),
        (1.0, 0.5, 0.5, False, 2.5),
    ],
)
def test_as_many_false_spots_as_are_allowed(sigma, background, read_noise, known, within):
    # 80 false spots, so that chance is 11 %; the rest is what the tiles know of their noise.
    wanted, frames = 20.0, 4
    settings = Detection(
        kernel_sigma=sigma, false_per_frame=wanted, max_spots=9999, sharpest_sigma=0.0
    )
    found = sum(
        len(detect(noise(k, background, read_noise, 21, known), settings)) for k in range(frames)
    )
    assert wanted / within < found / frames < wanted * within


def test_the_threshold_of_a_wish():
    plain = Detection(threshold=4.7, kernel_sigma=0.8)
    told = false_alarms(plain, 640, 480)
    same = Detection(false_per_frame=told, kernel_sigma=0.8)
    assert plan_detection(same).threshold(640 * 480) == pytest.approx(4.7, rel=1e-9)
    assert false_alarms(same, 640, 480) == pytest.approx(told, rel=1e-9)
    assert plan_detection(plain).threshold(10 * 10) == 4.7
    # More than noise can make in so small a frame.
    assert plan_detection(Detection(false_per_frame=1000.0)).threshold(8 * 8) == 1.5


@pytest.mark.parametrize("wanted", [0.0, -1.0, 1e9])
def test_a_wish_is_refused(wanted):
    with pytest.raises(ValueError, match="false_per_frame must lie in"):
        Detection(false_per_frame=wanted)
