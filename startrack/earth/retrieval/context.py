"""Images in the mid and the thermal infrared -> excess of each pixel over its surroundings."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from scipy import stats

from startrack.core import Floats, Singles, printed

LEAST = 1e-12  # relative variance; a channel with a smaller variance has no contrast


@printed
class Contrast(NamedTuple):
    """Difference of each pixel of the mid infrared from the prediction by its surroundings.

    score         1, excess over the standard deviation of the prediction
    mid, thermal  watt / m^2 / sr / m, as given
    mid_around, thermal_around  means of both channels over the surroundings
    """

    score: Singles
    mid: Floats
    thermal: Floats
    mid_around: Floats
    thermal_around: Floats


def pixels_around(window: int, guard: int) -> int:
    """Number of pixels of the surroundings."""
    return (2 * window + 1) ** 2 - (2 * guard + 1) ** 2


def threshold_of(false_alarms: float, window: int, guard: int) -> float:
    """The score that a given fraction of pixels of uniform ground exceeds: a quantile of Student's
    t.

    The n surrounding pixels leave n - 3 degrees of freedom: two means and a slope are estimated.
    """
    return float(stats.t.isf(false_alarms, pixels_around(window, guard) - 3))


def contrast_of(mid: Floats, thermal: Floats, window: int, guard: int) -> Contrast:
    """The contextual test of each pixel: mid infrared against its surroundings.

        score = (m - <m> - slope (t - <t>)) / s,   slope = <m' t'> / <t' t'>,
        s^2 = n / (n - 3) (<m' m'> - slope <m' t'>) (1 + 1 / n)

    <x> is the mean over the n pixels of a surrounding square without its middle; m' and t' are
    deviations from the means. Changes of temperature and emissivity that affect both channels cause
    no excess; a fire has an excess in the mid infrared alone.

    Source: contextual tests are those of Flasse and Ceccato (1996), Int. J. Remote Sensing 17,
    419, and of BIRD (Zhukov et al. 2006, Remote Sensing of Environment 100, 29), which tests
    the excess in the mid infrared and then the ratio of both channels. The linear
    prediction is that of Reed and Yu (1990), IEEE Trans. ASSP 38, 1760, for two channels.

    mid, thermal   (lines, columns) watt / m^2 / sr / m, of the same pixels
    window, guard  pixel, half a side of the square and of its middle
    Accuracy       statistical: exact for normal deviations that are independent between pixels.
                   A pixel of smooth ground differs from its surroundings by less than their
                   scatter; such ground has fewer false alarms.
    """
    count = pixels_around(window, guard)
    # The mean of the image is subtracted first, so that the squares lose no digits.
    level_m, level_t = float(mid.mean()), float(thermal.mean())
    m, t = mid - level_m, thermal - level_t

    def around(values: Floats) -> Floats:
        sums = (
            cv2.boxFilter(values, cv2.CV_64F, (2 * half + 1,) * 2, normalize=False)
            for half in (window, guard)
        )
        outer, inner = sums
        return np.asarray((outer - inner) / count)

    mean_m, mean_t = around(m), around(t)
    both = around(m * t) - mean_m * mean_t
    of_t = around(t * t) - mean_t**2
    of_m = around(m * m) - mean_m**2
    slope = np.where(of_t > LEAST * (t**2).mean(), both / np.maximum(of_t, 1e-300), 0.0)
    excess = m - mean_m - slope * (t - mean_t)
    variance = np.maximum(of_m - slope * both, 0) * (count + 1) / (count - 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        score = np.nan_to_num(excess / np.sqrt(variance), nan=0.0, posinf=math.inf)
    return Contrast(score.astype(np.float32), mid, thermal, mean_m + level_m, mean_t + level_t)
