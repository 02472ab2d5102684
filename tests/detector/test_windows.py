"""Which pixels windows must look at wherever they are."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.detector import Defects, Detector
from startrack.detector.maps import dark
from startrack.detector.windows import odd_pixels

DETECTOR = Detector(200, 150, 5e-6, 0.1, dark_current=10.0, read_noise=5.0, prnu=0.01, bits=16)


def test_pixels_of_nearly_even_response_are_none_of_them():
    """Ten thousand electrons, unequal by 1 %: a third of the shot noise is far from five of it."""
    assert len(odd_pixels(DETECTOR, 1000.0, 5.0)) == 0
    assert len(odd_pixels(replace(DETECTOR, prnu=0.3), 1000.0, 5.0)) > 1000


def test_hot_and_dead_pixels_are():
    """Sky 100, read noise 5: beyond 100 + 5 sqrt(125 + 1) = 156 electrons, or below 44."""
    one = replace(DETECTOR, prnu=0.0, defects=Defects(hot=0.02, hot_current=3000.0, dead=0.01))
    odd = odd_pixels(one, 100.0, 5.0)
    level = dark(one).ravel() * 0.1 + 100
    assert set(np.flatnonzero(level > 100 + 160)) <= set(odd)  # dead ones have no sky
    hot, dead = (level > 158).sum(), 0.01 * level.size
    assert len(odd) == pytest.approx(hot + dead, abs=5 * np.sqrt(dead))
    assert hot > 200
