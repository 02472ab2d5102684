"""Dark frames for a dark map."""

import dataclasses

import numpy as np
import pytest

from startrack.detector import Defects, Detector, Hits, dark_frames
from startrack.detector.maps import dark
from startrack.detector.parameters import Scan

DETECTOR = Detector(
    *(120, 100, 5e-6, 0.1),
    dark_current=300.0,
    read_noise=6.0,
    full_well=20_000.0,
    offset=64,
    defects=Defects(dsnu=100.0, hot=0.01, hot_current=5e3),
)


@pytest.mark.parametrize("frames", [1, 16])
def test_the_mean_is_the_dark_signal_within_its_noise(frames):
    """Chi-square of 12,000 pixels over their number within 6 standard deviations."""
    mean, noise = dark_frames(DETECTOR, frames)
    electrons, step = dark(DETECTOR) * DETECTOR.exposure, DETECTOR.electrons_per_dn
    variance = ((electrons + DETECTOR.read_noise**2) / step**2 + 1 / 12) / frames
    error = mean - DETECTOR.offset - electrons / step
    assert (error**2 / variance).mean() == pytest.approx(1, abs=6 * np.sqrt(2 / mean.size))
    assert noise == pytest.approx(np.sqrt(np.median(variance) * frames), rel=0.01)


def test_the_map_of_a_device_is_always_the_same_and_without_hits():
    again = dataclasses.replace(DETECTOR, hits=Hits(1e8), lag=0.1)
    assert (dark_frames(again, 2)[0] == dark_frames(DETECTOR, 2)[0]).all()
    other = dataclasses.replace(DETECTOR, device_seed=1)
    assert (dark_frames(other, 2)[0] != dark_frames(DETECTOR, 2)[0]).any()


def test_lines_are_refused():
    lines = dataclasses.replace(DETECTOR, defects=None, scan=Scan())
    with pytest.raises(ValueError, match="dark_map must be left out for a detector that scans"):
        dark_frames(lines, 2)
