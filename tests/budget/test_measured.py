"""The budget by trials: causes switched on the same sky and noise."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from startrack.budget import analytic, measured
from startrack.budget.budget import bare, causes
from startrack.budget.measured import contributions, terms
from startrack.core import YEAR
from startrack.core.streams import Streams
from startrack.core.units import arcsec
from startrack.design.files import load_design
from startrack.detection import DarkMap, Detection, detect
from startrack.detector import Age, Defects
from startrack.detector.parameters import Scan
from startrack.io import shipped
from startrack.metrics import Interpretation
from startrack.montecarlo.workers import Serial
from startrack.observation.pointing import random_attitude
from startrack.response.star_response import noise_free_frame
from startrack.trial.chain import observe


def parts(case, number: int = 0) -> dict[str, np.ndarray]:
    """The errors of one trial by cause, arcsec; the total is named `whole`."""
    streams = Streams(5, number)
    rows, _ = contributions(case, random_attitude(streams), streams)
    return dict(zip(["whole", *(name for name, _ in terms(case))], rows / arcsec, strict=True))


@pytest.mark.slow
def test_the_whole_is_the_trials_error(case):
    streams = Streams(5, 3)
    outcome = observe(case, random_attitude(streams), streams).outcome
    error = np.array([outcome.error_x, outcome.error_y, outcome.error_z]) / arcsec
    np.testing.assert_allclose(parts(case, 3)["whole"], error, rtol=1e-9)


def test_what_no_frame_shows_is_exact(troubled):
    part = parts(troubled)
    np.testing.assert_allclose(part["mounting"], [-7, 0, 0], atol=1e-3)
    np.testing.assert_allclose(part["time stamp"], [3.6, 1.8, 0], atol=1e-3)
    assert part["mounting swing"][[0, 2]] == pytest.approx(0, abs=1e-3)
    assert 0 < abs(part["mounting swing"][1]) <= 9


def test_parts_make_the_whole(small):
    """All causes except shot and read noise add up as vectors; these two add up as variances."""
    case = small.case
    spoilt = replace(
        case.instrument.detector, defects=Defects(dsnu=400.0), prnu=0.03, settling=0.02
    )
    rough = replace(case, instrument=replace(case.instrument, detector=spoilt))
    quiet_sum, noise, rest = [], [], []
    for number in range(12):
        part = parts(rough, number)
        still = sum(part[one] for one in part if one not in ("whole", "shot noise", "read noise"))
        quiet_sum.append(still)
        noise.append(np.square(part["shot noise"]) + np.square(part["read noise"]))
        rest.append(part["whole"] - still)
    # 12 trials of 3 axes: the ratio of two mean squares of normal errors scatters by 30 %.
    ratio = np.mean(np.square(rest), axis=0).sum() / np.mean(noise, axis=0).sum()
    assert 0.5 < ratio < 2


def test_age_is_in_the_dark_signal_alone(small):
    """Hot pixels that the dark map lacks displace stars, but not as neighbours or as method."""
    plain = small.case
    settings = replace(
        plain.tracker.detection, dark_map=DarkMap(frames=16, hot=200.0), dark_map_age=4 * YEAR
    )
    detector = plain.instrument.detector
    age = Age(time=5 * YEAR, fluence=2e11 / YEAR, depleted=1e-6)
    aged = replace(
        plain,
        instrument=replace(plain.instrument, detector=replace(detector, age=age)),
        tracker=replace(plain.tracker, detection=settings),
    )
    young, old = ([parts(case, number) for number in range(6)] for case in (plain, aged))
    for name in ("neighbours", "centroid method"):
        before, after = (np.array([part[name] for part in both]) for both in (young, old))
        np.testing.assert_allclose(after[:, :2], before[:, :2], atol=0.3)
    dark = np.array([part["DSNU, hot pixels"] for part in old])
    assert np.sqrt(np.mean(dark[:, :2] ** 2)) > 1.0


def test_each_cause_of_each_shipped_design_can_be_left_out():
    for path in [*shipped("designs").glob("*.toml"), *shipped("trackers").glob("*.toml")]:
        assert not causes(bare(load_design(path).case)), path


def test_settling_shifts_all_stars_alike(case):
    """Each pixel leaves 5 % in the next one: a shift of 0.05 / 0.95 pixel along the rows."""
    slow = replace(case.instrument.detector, settling=0.05)
    part = parts(replace(case, instrument=replace(case.instrument, detector=slow)))
    pixel = 1 / case.instrument.camera.focal_length_px / arcsec
    assert part["read-out"][1] == pytest.approx(0.05 / 0.95 * pixel, rel=0.1)
    assert abs(part["read-out"][0]) < 0.1 * part["read-out"][1]


def test_a_cause_that_is_absent_has_no_line(case):
    assert [cause.name for cause in causes(case)] == ["PRNU"]
    even = replace(case.instrument.detector, prnu=0.0)
    assert not causes(replace(case, instrument=replace(case.instrument, detector=even)))


def test_any_number_of_workers_makes_the_same_budget(case):
    with ThreadPoolExecutor(2) as executor:
        many = measured(case, 3, 2, executor, times=2, workers=2)
    one = measured(case, 3, 2, Serial(), times=2)
    for a, b in zip((*many.lines, many.whole), (*one.lines, one.whole), strict=True):
        np.testing.assert_array_equal(a.spread.error, b.spread.error)
    assert one.whole.spread.error.shape == (3, 2, 3)


def test_interpretations_are_ordered(case):
    """The error of the worst member over time, and of the worst time over members, exceed that
    of both together."""
    spread = measured(case, 4, 3, Serial(), times=3).whole.spread
    temporal, ensemble, mixed = (
        spread.level((0, 1), 0.6827, one)
        for one in (Interpretation.TEMPORAL, Interpretation.ENSEMBLE, Interpretation.MIXED)
    )
    # Quantiles of few errors are interpolated, which costs some per cent.
    assert temporal > 0.95 * mixed
    assert ensemble > 0.95 * mixed


def test_a_still_cause_stays_over_time(case):
    """A camera at rest has the same PRNU in each frame, and other noise."""
    still = replace(
        case, instrument=replace(case.instrument, motion=type(case.instrument.motion)())
    )
    budget = measured(still, 3, 4, Serial(), times=3)
    error = {line.name: line.spread.error for line in budget.lines}
    scatter = {name: one.std(axis=1).mean() / one.std() for name, one in error.items()}
    assert scatter["PRNU"] < 0.2
    assert scatter["shot noise"] > 0.4


def test_the_chessboard_moves_no_centroid(case):
    """In a frame without noise, a star has the same place with a small and a large ripple."""
    electrons = np.full((64, 64), 40.0)
    y, x = np.mgrid[:64, :64]
    electrons += 900 * np.exp(-((x - 30.3) ** 2 + (y - 33.8) ** 2) / 2 / 0.9**2)
    places = [
        detect(noise_free_frame(electrons, case.instrument.detector, ripple, 8.0), Detection())
        for ripple in (0.5, 8.0)
    ]
    assert [len(one) for one in places] == [1, 1]
    assert abs(places[0].x[0] - places[1].x[0]) < 2e-3
    assert abs(places[0].y[0] - places[1].y[0]) < 2e-3


def test_no_solved_trial_is_told(case):
    detector = replace(case.instrument.detector, exposure=1e-6)
    dark = replace(case, instrument=replace(case.instrument, detector=detector))
    with pytest.raises(ValueError, match="a budget needs solved trials, got none of 2"):
        measured(dark, 2, 1, Serial())


def test_a_scanning_detector_is_refused(case):
    lines = replace(case.instrument, detector=replace(case.instrument.detector, scan=Scan()))
    for budget in (analytic, lambda one: measured(one, 1, 1, Serial())):
        with pytest.raises(ValueError, match="scan must be absent for an error budget"):
            budget(replace(case, instrument=lines))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "designs/nanosatellite",
        *(f"trackers/{name}" for name in ("altair-hb", "apst", "rigel-l", "rufino-2013", "st5000")),
    ],
)
def test_the_analytic_budget_is_that_of_trials(name):
    """Each line that matters; 400 members measure an rms to 2.5 % across and 3.5 % about."""
    design = load_design(shipped(f"{name}.toml")).case
    beside = {line.name: line for line in analytic(design).lines}
    budget = measured(design, 400, 1, Serial())
    for line in budget.lines:
        if line.across > 0.2 * budget.across:
            # Few pairs of stars make most of what neighbours do.
            fraction = 0.6 if line.name == "neighbours" else 0.25
            parts = [beside[part] for part in line.name.split(", ")]
            across, about = (
                math.hypot(*(getattr(part, axis) for part in parts)) for axis in ("across", "about")
            )
            assert across == pytest.approx(line.across, rel=fraction)
            assert about == pytest.approx(line.about, rel=fraction)
    assert budget.across == pytest.approx(analytic(design).across, rel=0.15)
