"""Assumptions of drawn trials about the stars, and the names of what they refuse."""

import dataclasses
import math

import numpy as np
import pytest

from startrack import deg, run_trials
from startrack.catalog import open_sky
from startrack.core import Refused
from startrack.design.case import Fidelity
from startrack.detector import Defects, Hits
from startrack.motion import Motion, Tone
from startrack.observation.stars import electrons_of
from startrack.response.spot_response import COMPANION_RADIUS, COMPANION_RATIOS
from startrack.scene import Scene
from startrack.trial.chain import run_random_trial
from startrack.trial.spot_plan import plan_spots

from .designs import CASE, changed, with_detector


def rolling(motion, **tracker):
    """The example with a rolling shutter."""
    case = with_detector(row_delay=100e-6)
    instrument = dataclasses.replace(case.instrument, motion=motion)
    believed = dataclasses.replace(case.tracker, **tracker)
    return dataclasses.replace(case, instrument=instrument, tracker=believed)


@pytest.mark.parametrize(
    ("case", "named"),
    [
        (with_detector(hits=Hits(1e4)), "hits"),
        (with_detector(defects=Defects(dead=1e-3)), "dead pixels"),
        (rolling(Motion(tones=(Tone(5.0, 1e-5, 0.0),))), "jitter behind a rolling shutter"),
        (with_detector(blooming=True), "blooming"),
        (changed(motion=Motion(rate_z=0.1)), "a rate_z that smears"),
        (dataclasses.replace(CASE, scene=Scene(lights=("starlight",))), "lights of the scene"),
    ],
)
@pytest.mark.parametrize("fidelity", [Fidelity.SPOTS, Fidelity.COVARIANCE])
def test_what_needs_an_image_is_refused_by_name(case, named, fidelity):
    with pytest.raises(ValueError, match=f"without {named}"):
        run_random_trial(case, 1, 0, fidelity)


@pytest.mark.slow
def test_drawn_spots_of_a_rolling_shutter_are_those_of_windows():
    """A tracker that corrects its rows, and one that does not; 100 trials measure each error to 5 %
    (1 sigma).

    The covariance alone names what it cannot include.
    """
    motion, across = Motion(rate_x=0.15 * deg, rate_y=0.1 * deg), {}
    for delay in (None, 0.0):
        case = rolling(motion, row_delay=delay)
        for fidelity in (Fidelity.SPOTS, Fidelity.WINDOW):
            table = run_trials(case, 4, range(100), fidelity)
            good = table[table["solved"] & ~table["false"]]
            assert len(good) > 95
            square = (good["error_x"] ** 2 + good["error_y"] ** 2).mean() / 2
            across[delay, fidelity] = math.sqrt(square)
        drawn, seen = across[delay, Fidelity.SPOTS], across[delay, Fidelity.WINDOW]
        assert drawn == pytest.approx(seen, rel=0.2)
    assert across[0.0, Fidelity.SPOTS] > 3 * across[None, Fidelity.SPOTS]
    with pytest.raises(ValueError, match="covariance needs a detector without row_delay"):
        run_random_trial(case, 1, 0, Fidelity.COVARIANCE)


def test_companions_are_the_stars_near_each_detectable_one():
    """Against all pairs of the catalogue, for the detectable stars with the most companions."""
    plan, stars = plan_spots(CASE), open_sky(CASE.catalog).stars
    companions, index = plan.companions, plan.field.number.astype(int)
    flux = electrons_of(CASE)
    radius = (COMPANION_RADIUS + 1) / CASE.instrument.camera.focal_length_px
    count = np.diff(companions.start)
    assert count.sum() > 100
    for place in [*np.argsort(-count, kind="stable")[:50], *range(0, len(index), 997)]:
        apart = np.linalg.norm(stars.direction - stars.direction[index[place]], axis=1)
        near = (apart < radius) & (flux > flux[index[place]] * np.exp(COMPANION_RATIOS[0]))
        near[index[place]] = False
        of_plan = slice(companions.start[place], companions.start[place + 1])
        np.testing.assert_allclose(
            np.sort(companions.flux[of_plan]), np.sort(np.log(flux[near])), rtol=1e-12
        )
        np.testing.assert_allclose(
            np.sort(companions.direction[of_plan, 0]), np.sort(stars.direction[near, 0])
        )


def short(focal_length):
    """The example with a shorter focal length."""
    return changed(optics=dataclasses.replace(CASE.instrument.optics, focal_length=focal_length))


@pytest.mark.parametrize("fidelity", list(Fidelity))
def test_a_camera_of_120_degrees_is_solved(fidelity):
    """A pinhole whose columns span 120 deg; the rms error of 60 trials is 0.02 deg."""
    case = short(0.5 * 512 * 11e-6 / math.tan(60 * deg))
    assert case.instrument.camera.fov_x == pytest.approx(120 * deg, rel=1e-12)
    for number in range(2):
        outcome = run_random_trial(case, 1, number, fidelity)
        assert outcome.solved
        assert not outcome.false
        assert np.hypot(outcome.error_x, outcome.error_y) < 0.2 * deg


@pytest.mark.parametrize(
    "fidelity", [Fidelity.SPOTS, pytest.param(Fidelity.COVARIANCE, marks=pytest.mark.slow)]
)
def test_stars_that_overlap_over_half_the_sky_are_refused_before_pairs_are_made(fidelity):
    with pytest.raises(Refused, match="so long that stars do not overlap: within 57") as refusal:
        run_random_trial(short(1e-4), 1, 0, fidelity)
    assert refusal.value.key == "instrument.optics.focal_length"
