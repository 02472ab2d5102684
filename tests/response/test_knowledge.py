"""The errors that a tracker assumes, against the errors of its stars."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from startrack.attitude import SolverSettings
from startrack.attitude.parameters import UNKNOWN_FLOOR
from startrack.catalog import open_sky
from startrack.core import arcsec
from startrack.design.case import Case, Fidelity
from startrack.design.files import load_design
from startrack.detector.parameters import Scan
from startrack.io import shipped
from startrack.motion import Motion, Tone
from startrack.response import knowledge_of
from startrack.trial.chain import run_trials


def tracker(name: str) -> Case:
    return load_design(shipped(name)).case


def believing(case: Case, floor: float | None) -> Case:
    return replace(
        case, tracker=replace(case.tracker, attitude=SolverSettings(centroid_floor=floor))
    )


@pytest.mark.parametrize("name", ["apst", pytest.param("st5000", marks=pytest.mark.slow)])
def test_trackers_state_the_covariance_of_their_errors(name):
    """60 windows: 3 +- 0.32 for normal errors; 0.95 is three sigma.

    With a floor of 0.015 pixel and a fixed focal length they stated 1.9 and 2.0.
    """
    outcomes = run_trials(tracker(f"trackers/{name}.toml"), 17, range(60), Fidelity.WINDOW)
    good = outcomes["solved"] & ~outcomes["false"]
    assert good.sum() > 56
    assert outcomes["nees"][good].mean() == pytest.approx(3, abs=0.95)


def test_a_shaken_tracker_states_its_jitter():
    """50 windows with jitter as the only addition: 3 +- 0.35, and 100 without its law."""
    case = tracker("designs/noise_only.toml")
    tones = tuple(Tone(30.0, **{f"rms_{axis}": 5 * arcsec}) for axis in "xyz")
    shaken = replace(case, instrument=replace(case.instrument, motion=Motion(tones=tones)))
    outcomes = run_trials(shaken, 17, range(50), Fidelity.WINDOW)
    assert outcomes["nees"][outcomes["solved"]].mean() == pytest.approx(3, abs=0.95)


def test_a_sharper_star_is_trusted_less():
    """For a star on few pixels, its S-curve and the response of its pixels matter more."""
    case = tracker("designs/noise_only.toml")
    sharp = replace(case.instrument.optics, blur=1e-6)
    keen = replace(case, instrument=replace(case.instrument, optics=sharp))
    assert np.median(knowledge_of(keen).systematic) > 2 * np.median(knowledge_of(case).systematic)


def test_a_star_beside_another_is_trusted_less():
    """Within two pixels of an equally bright star: tenths of a pixel; for others hundredths."""
    case = tracker("designs/noise_only.toml")
    stars, pixel = open_sky(case.catalog).stars, 1 / case.instrument.camera.focal_length_px
    distance = cKDTree(stars.direction).query(stars.direction[:500], 2)[0][:, 1]
    sigma = np.sqrt(knowledge_of(case).systematic[:500])
    alone = sigma[distance > 20 * pixel]
    assert np.median(alone) < 0.1
    near = np.flatnonzero(sigma > 0.2)
    assert len(near)
    assert (distance[near] < 8 * pixel).mean() > 0.9


def test_a_given_floor_is_that_of_all_stars():
    case = believing(tracker("designs/noise_only.toml"), 0.02)
    np.testing.assert_allclose(knowledge_of(case).systematic, 4e-4)


def test_a_scan_is_trusted_as_an_unknown_camera():
    case = tracker("designs/noise_only.toml")
    detector = replace(case.instrument.detector, scan=Scan())
    lines = replace(case, instrument=replace(case.instrument, detector=detector))
    np.testing.assert_allclose(knowledge_of(lines).systematic, UNKNOWN_FLOOR**2)


def test_stars_of_the_true_sky_find_their_trust():
    case = tracker("designs/noise_only.toml")
    stars = open_sky(case.catalog).stars
    np.testing.assert_array_equal(knowledge_of(case).places(stars[5:9]), np.arange(5, 9))
