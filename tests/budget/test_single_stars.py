"""Single stars over magnitude, compared with stars of trials and of a flown tracker."""

from dataclasses import replace

import numpy as np
import pytest

from startrack import Streams, load_design, random_attitude, shipped
from startrack.budget import analytic, single_stars
from startrack.budget.single_stars import residuals
from startrack.catalog import open_sky
from startrack.core import ZERO_CELSIUS
from startrack.design import Fidelity
from startrack.metrics import summarise
from startrack.observation import colour_correction
from startrack.trial import run_trials
from startrack.trial.boxes import MEDIAN, boxes_in_windows


def flown(year: float, celsius: float):
    """Chandra's aspect camera at a year and a temperature of its CCD."""
    case = load_design(shipped("trackers/chandra-aca.toml")).case
    detector = case.instrument.detector
    detector = replace(
        detector,
        age=replace(detector.age, year=year),
        thermal=replace(detector.thermal, temperature=celsius + ZERO_CELSIUS),
    )
    return replace(case, instrument=replace(case.instrument, detector=detector))


def test_stars_in_boxes_scatter_as_those_of_a_flown_tracker():
    """Two guide stars of May 2005 (obs6120_2005, docs/figures/flight.md).

    Stars of 8.7 and 8.9 mag scatter by 0.0061 pixel rms from exposure to exposure, and by 0.0219 in
    all about their common motion.

    The total depends on the few pixels that a star crosses, and lies between that of stars without
    hot pixels and the rms over all pixels.
    """
    found = single_stars(flown(2005.4, -14.8))
    at = {
        name: np.interp([8.7, 8.9], found.magnitude, getattr(found, name)).mean()
        for name in ("temporal", "total", "usual")
    }
    assert 0.8 < at["temporal"] / 0.0061 < 1.25
    assert 0.8 * at["usual"] < 0.0219 < at["total"]
    assert (found.measured[found.magnitude < 9] == 1).all()


@pytest.mark.slow
@pytest.mark.parametrize(("year", "celsius"), [(2005.0, -19.0), (2025.0, -6.0)])
def test_stars_in_boxes_scatter_as_those_of_windows(year, celsius):
    """Median error over the prediction for each magnitude; 5 % (1 sigma) by the number of stars."""
    case, parts = flown(year, celsius), []
    found, stars = single_stars(case), open_sky(case.catalog).stars
    faint = colour_correction(case, stars.colour)
    for number in range(60):
        streams = Streams(7, number)
        attitude = random_attitude(streams)
        spots, matches = boxes_in_windows(case, attitude, streams)
        star, _ = stars.find(open_sky(case.believed_catalog).stars.identifier[matches.star])
        place = case.instrument.camera.project(attitude.apply(matches.direction))
        seen = np.column_stack([spots.x, spots.y])[matches.spot] - place
        parts.append(np.column_stack([stars.magnitude_g[star] + faint[star], seen]))
    magnitude, x, y = np.concatenate(parts).T
    good = (np.hypot(x, y) < 1) & (magnitude > found.magnitude[0]) & (magnitude < 9.5)
    assert good.sum() > 100
    usual = np.interp(magnitude[good], found.magnitude, found.usual)
    size = np.abs(np.column_stack([x, y])[good] - np.median([x[good], y[good]], axis=1))
    assert np.median(size / usual[:, None]) / MEDIAN == pytest.approx(1, abs=0.2)


def test_stars_of_a_searched_frame_scatter_as_those_of_trials():
    """Mean square over the prediction; some 300 stars measure it to 8 % (1 sigma)."""
    case = load_design(shipped("designs/noise_only.toml")).case
    found, seen = single_stars(case), residuals(case, 3, 16)
    good = (np.abs(seen.error) < 1).all(axis=1) & (seen.magnitude > 2)
    predicted = np.interp(seen.magnitude[good], found.magnitude, found.total)
    ratio = (seen.error[good] / predicted[:, None]) ** 2
    assert good.sum() > 100
    assert np.sqrt(ratio.mean()) == pytest.approx(1, abs=0.2)


@pytest.mark.slow
def test_the_budget_of_boxes_is_that_of_their_trials():
    """Errors across and about the boresight of a camera at launch, by 100 windows."""
    case = flown(2005.4, -14.8)
    budget, trials = analytic(case), summarise(run_trials(case, 2, range(100), Fidelity.WINDOW))
    for name in ("across", "about"):
        seen = getattr(trials, name)
        assert 0.8 * seen.low < getattr(budget, name) < 1.25 * seen.high, name
