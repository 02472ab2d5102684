"""Trials and sequences of a tracker that searches boxes."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core import arcsec
from startrack.design import Fidelity
from startrack.detection import DarkMap
from startrack.detector import Defects
from startrack.metrics import Outcome
from startrack.sequence import Leg, Sequence
from startrack.sequence.run import Mode, run
from startrack.trial.boxes import boxed_stars
from startrack.trial.chain import run_random_trial, run_trials
from startrack.trial.spot_plan import require_fidelity


@pytest.fixture(scope="module")
def case(small):
    """The small design with boxes of eight pixels half width."""
    tracker = small.case.tracker
    scale = 1 / small.case.instrument.camera.focal_length_px
    box = replace(tracker.box, half_width=8 * scale, prior=1.5 * scale, size=8, stars=20)
    return replace(small.case, tracker=replace(tracker, acquisition="box", box=box))


def test_windows_and_frames_are_the_same(case):
    for number in range(3):
        whole = run_random_trial(case, 1, number)
        windows = run_random_trial(case, 1, number, Fidelity.WINDOW)
        assert whole.solved
        for name in Outcome._fields:
            assert getattr(windows, name) == pytest.approx(getattr(whole, name), rel=1e-9), name


def test_boxes_find_the_attitude(case):
    """First moments of 8 x 8 pixels, including light of neighbours, for half of the stars.

    The error is within a factor of five of a search of the whole frame, and no attitude is false.
    """
    rms = {}
    for name in ("box", "whole"):
        one = replace(case, tracker=replace(case.tracker, acquisition=name))
        outcomes = run_trials(one, 3, range(30), Fidelity.WINDOW)
        assert outcomes["solved"].mean() > 0.9
        assert not outcomes["false"].any()
        solved = outcomes[outcomes["solved"]]
        rms[name] = np.sqrt(np.mean(solved["error_x"] ** 2 + solved["error_y"] ** 2))
    assert rms["whole"] < rms["box"] < 5 * rms["whole"]


def test_a_sequence_acquires_by_the_frame_and_tracks_by_boxes(case):
    table = run(case, Sequence((Leg(2.0),)), 1, 0)
    assert table["mode"][0] == Mode.ACQUIRED
    assert (table["mode"][1:] == Mode.TRACKED).all()
    assert (table["spots"][1:] <= 20).all()
    assert np.abs(table["error_x"]).max() < 60 * arcsec


def test_cheaper_fidelities_refuse_boxes(case):
    with pytest.raises(ValueError, match="boxes"):
        require_fidelity(case, Fidelity.COVARIANCE)


def test_stars_of_a_unit_with_a_dark_map_are_those_of_its_equal_design(case):
    detection = replace(case.tracker.detection, dark_map=DarkMap(frames=2))
    box = replace(case.tracker.box, half_width=case.tracker.box.half_width / 3)
    defects = Defects(hot=1e-3, hot_current=500.0)
    detector = replace(case.instrument.detector, defects=defects)
    design = replace(
        case,
        tracker=replace(case.tracker, detection=detection, box=box),
        instrument=replace(case.instrument, detector=detector),
    )
    as_designed, unit = boxed_stars(design), boxed_stars(replace(design, design=design))
    for name in as_designed._fields:
        np.testing.assert_array_equal(getattr(unit, name), getattr(as_designed, name))
