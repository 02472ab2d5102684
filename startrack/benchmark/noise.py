"""Digital numbers from expected electrons, against the exact distribution of the noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from startrack.benchmark.stage import Stage
from startrack.core import Floats, Streams
from startrack.detector import Detector, read_out

SIZE, BACKGROUND, READ_NOISE = 1024, 20.0, 8.0  # pixel; electron
FRAMES = 8
# A number is one electron, so that the histogram has many cells.
CAMERA = Detector(SIZE, SIZE, 5e-6, 0.1, full_well=4_095.0, read_noise=READ_NOISE)


def noise() -> Stage:
    """Even frames; the error is Kolmogorov's distance between histogram and exact distribution."""
    even = np.full((SIZE, SIZE), BACKGROUND)
    step = CAMERA.electrons_per_dn
    distributions = [np.cumsum(law(BACKGROUND, step, half)) for half in (0.5, 0.0)]

    def judge(frames: Sequence[NDArray[Any]]) -> float:
        count = sum(np.bincount(f.ravel().astype(np.int64), minlength=4096) for f in frames)
        fraction = np.cumsum(count) / np.sum(count)
        # A converter may round or truncate; it is judged by the distribution that fits it better.
        return min(float(np.abs(fraction - one).max()) for one in distributions)

    return Stage(
        "noise",
        f"a megapixel of {BACKGROUND:g} expected electrons, read noise {READ_NOISE:g}, "
        "to 12-bit numbers",
        f"distance of the distribution of {FRAMES} Mpx from the exact law",
        {"startrack": lambda: [read_out(even, CAMERA, Streams(1, n)) for n in range(FRAMES)]},
        judge,
        0.83 / math.sqrt(FRAMES * even.size),
        "that many pixels (median of Kolmogorov's law)",
        FRAMES,
    )


def law(mean: float, step: float, half: float) -> Floats:
    """Probability of each number: Poisson and normal, quantised by a converter of this step.

    half  0.5 where the converter rounds, 0 where it truncates
    """
    electrons = np.arange(math.ceil(mean + 12 * math.sqrt(mean) + 40))
    weight = stats.poisson.pmf(electrons, mean)
    edge = (np.arange(2**CAMERA.bits) + 1 - half) * step
    edge[-1] = np.inf
    z = (edge - electrons[:, None]) / READ_NOISE
    return np.diff(weight @ special.ndtr(z), prepend=0)
