"""Windows against whole frames: the same numbers, the same spots."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from startrack.core import Curve
from startrack.core.streams import Streams
from startrack.design.case import Fidelity
from startrack.design.files import load_design
from startrack.detection import DarkMap, Detection
from startrack.detector import Defects, Hits, Pattern
from startrack.io import shipped
from startrack.motion import Motion
from startrack.observation.pointing import random_attitude
from startrack.trial import window, window_plan
from startrack.trial.chain import observe, run_random_trial, run_trials
from startrack.trial.window import spots_in_windows
from startrack.trial.window_plan import plan_windows

MARGINAL = 60.0  # digital number, twice the flux at which the threshold lies
CASE = load_design(shipped("designs/noise_only.toml")).case
BLIND = Curve((300e-9, 1200e-9), (1e-9, 1e-9))


def with_detector(**changes):
    detector = dataclasses.replace(CASE.instrument.detector, **changes)
    # Spots as they are measured: none is moved to the middle of the exposure.
    tracker = dataclasses.replace(CASE.tracker, row_delay=0.0)
    instrument = dataclasses.replace(CASE.instrument, detector=detector)
    return dataclasses.replace(CASE, instrument=instrument, tracker=tracker)


def both(case, number, seed=5):
    """Spots of a frame and of its windows (n, 3): x, y, flux; sorted by x, because fluxes may be
    equal."""
    attitude = random_attitude(Streams(seed, number))
    whole = observe(case, attitude, Streams(seed, number)).spots
    parts = spots_in_windows(case, attitude, Streams(seed, number))
    rows = (np.column_stack([one.x, one.y, one.flux]) for one in (whole, parts))
    return (spots[np.argsort(spots[:, 0])] for spots in rows)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"hits": Hits(5e4)},
        {"defects": Defects(dsnu=20.0, hot=1e-4, hot_current=5e3, dead=5e-5)},
        {"bits": 14, "adc_inl": 3.0, "nonlinearity": 0.02, "crosstalk": 0.03, "columns": 200},
        {"lag": 0.05},
        pytest.param(
            {"lag": 0.05, "row_delay": 20e-6, "defects": Defects(hot=1e-4, hot_current=5e3)},
            marks=pytest.mark.slow,
        ),
        {"row_delay": 20e-6, "columns": 100, "rows": 300},
    ],
    ids=lambda changes: "-".join(changes) or "plain",
)
def test_spots_are_those_of_the_frame(changes):
    """The stars' pixels have the noise of the frame; all spots that are not marginal are found
    in both."""
    case = with_detector(**changes)
    assert plan_windows(case).noise
    whole, parts = (spots[spots[:, 2] > MARGINAL] for spots in both(case, 0))
    assert len(whole) == len(parts) > 0
    np.testing.assert_allclose(parts, whole, rtol=1e-5, atol=1e-4)


HOT = Defects(dsnu=60.0, hot=1e-3, hot_current=3e3)


def with_map(case, **settings):
    detection = dataclasses.replace(case.tracker.detection, dark_map=DarkMap(**settings))
    return dataclasses.replace(case, tracker=dataclasses.replace(case.tracker, detection=detection))


@pytest.mark.parametrize(
    ("changes", "settings"),
    [
        ({"defects": HOT}, {}),
        ({"defects": dataclasses.replace(HOT, dsnu=10.0)}, {"subtracted": False}),
        ({"defects": HOT, "hits": Hits(5e4), "bits": 14}, {"frames": 4, "step": 8.0}),
        pytest.param({}, {"frames": 16}, marks=pytest.mark.slow),
    ],
    ids=["map", "list", "coarse map with hits", "no defects"],
)
def test_spots_less_the_dark_map_are_those_of_the_frame(changes, settings):
    """Hot pixels of a dark map need no windows."""
    case = with_map(with_detector(**changes), **settings)
    noise = plan_windows(case).noise
    assert noise
    assert len(noise.outliers) < 20
    whole, parts = (spots[spots[:, 2] > MARGINAL] for spots in both(case, 0))
    assert len(whole) == len(parts) > 0
    np.testing.assert_allclose(parts, whole, rtol=1e-5, atol=1e-4)


def test_hot_pixels_make_spots_that_a_dark_map_removes():
    """Frames without stars, 8 of each; at 6 sigma, noise makes one spot in 1000 of them."""
    spots = {}
    hot = with_detector(defects=HOT, quantum_efficiency=BLIND)
    for name, case in (("without", hot), ("with", with_map(hot))):
        spots[name] = sum(len(next(both(case, number))) for number in range(8))
    assert spots["without"] > 8
    assert spots["with"] <= 1


@pytest.mark.parametrize(
    ("threshold", "defects"), [(6.0, HOT), (4.0, None)], ids=["hot pixels", "noise"]
)
def test_the_whole_frame_is_searched_where_windows_would_take_longer(
    monkeypatch, threshold, defects
):
    """Work is counted in pixels: that of windows never exceeds that of the frame."""
    case = with_detector(defects=defects)
    tracker = dataclasses.replace(CASE.tracker, detection=Detection(threshold=threshold))
    case = dataclasses.replace(case, tracker=tracker)
    within = []
    monkeypatch.setattr(window, "expose_within", lambda windows, *_: within.append(windows))
    for one in both(case, 2):
        assert len(one) > 10
    assert not within
    np.testing.assert_array_equal(*both(case, 3))


def test_streaks_are_those_of_the_frame():
    motion = Motion(rate_x=0.01, rate_y=0.02)
    case = dataclasses.replace(CASE, instrument=dataclasses.replace(CASE.instrument, motion=motion))
    whole, parts = both(case, 1)
    assert len(whole) > 5
    np.testing.assert_allclose(parts, whole, rtol=1e-5, atol=1e-4)


def test_nothing_outside_the_windows_is_read():
    before = run_random_trial(CASE, 5, 1, Fidelity.WINDOW)
    shape = CASE.instrument.detector.rows, CASE.instrument.detector.columns
    plan = plan_windows(CASE)
    plan.detection.workspace.array("filtered", shape, np.float32)[...] = 1e9
    plan.workspace.array("digital numbers", shape, np.float32)[...] = 4095
    assert run_random_trial(CASE, 5, 1, Fidelity.WINDOW) == before


def test_trials_do_not_depend_on_their_company():
    alone = [run_trials(CASE, 2, [number], Fidelity.WINDOW) for number in (3, 0, 7)]
    assert (
        np.concatenate(alone).tobytes() == run_trials(CASE, 2, [3, 0, 7], Fidelity.WINDOW).tobytes()
    )


@pytest.mark.parametrize(
    ("effect", "value"),
    [
        ("blooming", True),
        ("em_gain", 10.0),
        ("settling", 0.01),
        ("read_noise_spread", 0.2),
        ("pattern", Pattern(row=2.0)),
    ],
)
def test_what_needs_the_whole_frame_is_refused_by_name(effect, value):
    with pytest.raises(ValueError, match=f"without {effect}; choose the fidelity frame"):
        run_random_trial(with_detector(**{effect: value}), 1, 0, Fidelity.WINDOW)


@pytest.mark.parametrize("mapped", [False, True], ids=["plain", "dark map"])
def test_noise_makes_as_many_false_spots_as_in_frames(monkeypatch, mapped):
    """Frames without stars, with a threshold that noise exceeds a few times a frame.

    5 standard deviations of the difference in the count, 1e-4 for the fluxes by Kolmogorov and
    Smirnov.
    """
    case = dataclasses.replace(
        with_detector(columns=256, rows=256, dark_current=400.0, quantum_efficiency=BLIND),
        tracker=dataclasses.replace(CASE.tracker, detection=Detection(threshold=4.0)),
    )
    monkeypatch.setattr(window_plan, "PROPOSAL", 1.0)  # windows, though frames would take less time
    if mapped:
        defects = Defects(dsnu=100.0, hot=0.01, hot_current=1e4)
        detector = dataclasses.replace(case.instrument.detector, defects=defects)
        case = with_map(
            dataclasses.replace(
                case, instrument=dataclasses.replace(case.instrument, detector=detector)
            )
        )
        assert plan_windows(case).noise
    found = [list(both(case, number)) for number in range(25)]
    whole, parts = (np.concatenate(each)[:, 2] for each in zip(*found, strict=True))
    assert len(whole) > 100
    assert abs(len(whole) - len(parts)) < 5 * np.sqrt(len(whole) + len(parts))
    assert stats.ks_2samp(whole, parts).pvalue > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("threshold", "changes"),
    [
        (6.0, {"exposure": 0.08}),
        (4.6, {"exposure": 0.013}),
        (4.6, {"exposure": 0.013, "crosstalk": 0.03}),
        (4.6, {"exposure": 0.013, "lag": 0.1}),
    ],
    ids=lambda changes: "-".join(changes) if isinstance(changes, dict) else "",
)
def test_outcomes_have_the_law_of_frames(threshold, changes):
    """5000 frames and 5000 windows with other seeds, bright stars and marginal ones: each of the
    three tests fails by chance once in 1000 runs."""
    optics = dataclasses.replace(CASE.instrument.optics, blur=10e-6)
    case = with_detector(columns=160, rows=160, pixel_pitch=22e-6, **changes)
    case = dataclasses.replace(
        case,
        instrument=dataclasses.replace(case.instrument, optics=optics),
        tracker=dataclasses.replace(CASE.tracker, detection=Detection(threshold=threshold)),
    )
    whole, parts = (
        run_trials(case, seed, range(5000), fidelity)
        for seed, fidelity in ((31, Fidelity.FRAME), (32, Fidelity.WINDOW))
    )
    assert stats.mannwhitneyu(whole["spots"], parts["spots"]).pvalue > 1e-3
    solved = [(each["solved"].sum(), (~each["solved"]).sum()) for each in (whole, parts)]
    assert stats.fisher_exact(solved)[1] > 1e-3
    errors = [each["error_x"][each["solved"] & ~each["false"]] for each in (whole, parts)]
    assert stats.ks_2samp(*errors).pvalue > 1e-3


def test_stars_through_a_lens_table_are_those_of_the_frame(tmp_path):
    """Place, colour and vignetting affect each star in windows as in frames."""
    from startrack.optics import save_lens
    from tests.optics.lenses import ideal

    table = ideal(vignetting=0.4)
    wavefront = np.zeros(table.wavefront.shape)
    wavefront[..., 1] = 300e-9 * table.field / table.field[-1]  # coma
    place = table.place * (1 + 1e-3 * np.linspace(-1, 1, 5)[:, None])  # lateral colour
    save_lens(tmp_path / "lens.fits", dataclasses.replace(table, wavefront=wavefront, place=place))
    optics = dataclasses.replace(
        CASE.instrument.optics, psf="auto", lens_file=str(tmp_path / "lens.fits"), f_number=4.0
    )
    detector = dataclasses.replace(CASE.instrument.detector, columns=300, rows=200)
    instrument = dataclasses.replace(CASE.instrument, optics=optics, detector=detector)
    case = dataclasses.replace(CASE, instrument=instrument)
    assert plan_windows(case).noise
    for number in range(2):
        whole, parts = (spots[spots[:, 2] > MARGINAL] for spots in both(case, number))
        assert len(whole) == len(parts) > 0
        np.testing.assert_allclose(parts, whole, rtol=1e-5, atol=2e-4)
