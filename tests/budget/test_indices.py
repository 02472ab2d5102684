"""Sequences into the indices of the standard."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.budget import INDICES, indices_of
from startrack.core.units import arcsec, deg
from startrack.montecarlo.workers import Serial
from startrack.sequence import Leg, Sequence

CALM = Sequence((Leg(6.0, rate_x=0.06 * deg),), period=0.5)


def test_relative_and_mean_errors_make_the_whole(case):
    """Over whole windows the squares of RKE and MKE add up to the square of AKE: an identity."""
    found = indices_of(case, CALM, 2, 1, 2.0, Serial())
    assert set(found) == set(INDICES)
    square = {name: line.spread.rms() ** 2 for name, line in found.items()}
    np.testing.assert_allclose(square["RKE"] + square["MKE"], square["AKE"], rtol=1e-9)
    assert found["AKE"].spread.error.shape == (2, 12, 3)
    assert found["KDE"].spread.error.shape == (2, 2, 3)
    assert 0.1 < found["AKE"].across / arcsec < 3


def test_a_constant_error_is_mean_and_not_relative(case):
    """A principal point that is wrong by one pixel in all frames."""
    wrong = replace(case.instrument.camera, principal_x=1.0)
    misled = replace(case, tracker=replace(case.tracker, camera=wrong))
    found = indices_of(misled, CALM, 1, 1, 2.0, Serial())
    pixel = 1 / case.instrument.camera.focal_length_px
    assert found["MKE"].spread.rms()[1] == pytest.approx(pixel, rel=0.05)
    assert found["RKE"].spread.rms()[1] < 0.05 * pixel


def test_a_window_must_fit_twice(case):
    with pytest.raises(ValueError, match="window must fit twice into the 12 consecutive frames"):
        indices_of(case, CALM, 1, 1, 4.0, Serial())


def test_a_blind_sequence_is_told(case):
    detector = replace(case.instrument.detector, exposure=1e-6)
    dark = replace(case, instrument=replace(case.instrument, detector=detector))
    with pytest.raises(ValueError, match="needs solved consecutive frames, got 0 frames"):
        indices_of(dark, CALM, 1, 1, 1.0, Serial())
