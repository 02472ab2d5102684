"""Effects that a budget says it leaves out, and their size in trials."""

import re
from dataclasses import replace

import pytest

from startrack.budget import ADVICE, advice, analytic, caveats, check, left_out, unseen
from startrack.core import Refused
from startrack.core.units import deg
from startrack.design import Fidelity, design_keys, load_design, replaced, replaced_all
from startrack.detector import Hits
from startrack.io import shipped
from startrack.metrics import summarise
from startrack.scene import Scene
from startrack.trial import run_trials


def test_nothing_is_left_out_of_the_example_and_trials_agree(case):
    budget = analytic(case)
    assert budget.left_out == ()
    assert budget.refused < 0.01
    found = check(case, budget, 1)
    assert (found.fidelity, found.summary.trials) == (Fidelity.WINDOW, 60)
    assert found.differs == ()
    assert caveats(case, ())[-1].startswith("noise only: a perfect unit")


def test_it_is_said_of_which_unit_something_is_not_counted(case):
    assert caveats(case, ("hits",))[0] == "not counted: hits"
    differing = load_design(shipped("designs/nanosatellite.toml")).case
    assert caveats(differing, ("hits",))[0] == "not counted of the unit as designed: hits"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"instrument.detector.hits": Hits(rate=1e5)}, "cosmic rays"),
        ({"instrument.detector.lag": 0.02}, "residual charge"),
        (
            {"instrument.detector.read_noise_rate": 1e6},
            "than at 1, for which instrument.detector.read",
        ),
        ({"instrument.motion.rate_z": 10 * deg}, "corners"),
        ({"instrument.optics.blur": 25e-6}, "shifts by noise of a window"),
        ({"catalog.limit_g": 5.0}, "wrong identification"),
    ],
)
def test_an_effect_that_is_not_counted_is_named(case, changes, said):
    for name, value in changes.items():
        case = replaced(case, name, value)
    assert any(said in one for one in analytic(case).left_out)


@pytest.mark.parametrize(
    ("change", "lost"), [({"principal_x": 20.0}, False), ({"focal_length_px": 1.02}, True)]
)
def test_stars_that_a_turn_of_the_attitude_does_not_bring_back_are_named(case, change, lost):
    """As in trials, a wrong principal point keeps all matches and a wrong scale loses most."""
    [(name, value)] = change.items()
    camera = case.believed_camera
    other = getattr(camera, name) * value if name == "focal_length_px" else value
    wrong = replaced(case, "tracker.camera", replace(camera, **{name: other}))
    try:
        said = any("match_radius" in one for one in analytic(wrong).left_out)
    except Refused as refusal:
        said = "match_radius" in str(refusal)
    before, after = (
        run_trials(one, 1, range(8), Fidelity.SPOTS)["stars"].mean() for one in (case, wrong)
    )
    assert said == lost
    assert (after > 0.9 * before) == (not lost)


def test_lights_are_named(case):
    scene = Scene(lights=("zodiacal", "moon"), date="2026-03-01T00:00:00")
    assert "by zodiacal, moon" in analytic(replace(case, scene=scene)).left_out[0]


def test_a_smear_that_the_tracker_does_not_know_is_named_and_found_by_trials(case):
    """At 2 deg / s the centre of gravity is sensitive to noise along the streak."""
    for name, value in (
        ("instrument.motion.rate_x", 2 * deg),
        ("tracker.detection.smear_x", 0.0),
        ("tracker.detection.smear_y", 0.0),
    ):
        case = replaced(case, name, value)
    budget = analytic(case)
    assert "8.9 pixel of smear that the tracker does not know" in budget.left_out[0]
    found = check(case, budget, 1)
    assert "across" in found.differs[0]
    assert "squared is" in found.summary.doubt


def test_advice_names_keys_that_there_are(case):
    keys = {key.name for key in design_keys()}
    for name, text in ADVICE.items():
        named = re.findall(r"(?:instrument|tracker)\.[a-z_.]*[a-z_]", text)
        assert named, name
        assert set(named) <= keys, name
    budget = analytic(case)
    assert advice(budget)[0].startswith("read noise")
    assert len(advice(budget)) == sum(line.across > 0 for line in budget.lines) > 4
    assert unseen(budget) == ""


def test_what_the_covariance_cannot_hold_is_named(case):
    wrong = replaced(case, "tracker.camera", replace(case.instrument.camera, k1=0.01))
    budget = analytic(wrong)
    assert unseen(budget).startswith("the tracker does not know of camera model")
    more = replace(budget, left_out=("a wide streak",))
    assert unseen(more) == f"{unseen(budget)}; effects that are left out"


def test_noise_that_the_converter_cuts_off_is_named(case):
    """200 windows have 0.41 arcsec [0.37, 0.45] across, the formula 0.54; with an offset, 0.55
    [0.50, 0.60]."""
    dark = {"instrument.detector.offset": 0, "instrument.detector.dark_current": 1.0}
    for name, value in dark.items():
        case = replaced(case, name, value)
    case = replaced(case, "scene.background_g", 25.0)
    assert any("instrument.detector.offset" in phrase for phrase in analytic(case, 64).left_out)
    offset = replaced(case, "instrument.detector.offset", 64)
    assert not any("detector.offset" in phrase for phrase in analytic(offset, 64).left_out)


def test_little_noise_is_cut_off_two_sigma_above_zero(case):
    """By 60 windows, an empty pixel 2.5 sigma above zero has the noise of one far above it."""
    near = replaced(case, "instrument.detector.offset", 3)
    budget = analytic(near)
    assert budget.left_out == ()
    assert check(near, budget, 1).differs == ()


def test_a_long_streak_on_a_large_detector_is_compared_by_windows(case, monkeypatch):
    """Drawn spots leave out the same as the formula, and would agree with it."""
    chosen = []

    def few(_, seed, numbers, fidelity):
        chosen.append(fidelity)
        return run_trials(case, seed, numbers[:2], Fidelity.SPOTS)

    monkeypatch.setattr(left_out, "LARGEST", 0)
    monkeypatch.setattr(left_out.trial, "run_trials", few)
    budget, fast = analytic(case, 64), replaced(case, "instrument.motion.rate_x", 7 * deg)
    assert any("streak" in phrase for phrase in left_out.of_the_case(fast))
    check(case, budget, 1)
    check(fast, budget, 1)
    assert chosen == [Fidelity.SPOTS, Fidelity.WINDOW]


def test_trials_without_an_attitude_have_no_error(case):
    dark = replaced(case, "instrument.detector.exposure", 1e-4)
    lost = summarise(run_trials(dark, 1, range(4), Fidelity.SPOTS))
    [said] = left_out.differences(analytic(case, 64), lost)
    assert said.endswith("none of 4 trials has a correct attitude")


def test_the_end_of_the_catalogue_is_named_where_the_sky_is_not_covered(case):
    """A field of 5 degrees with the same lens, which detects stars beyond the catalogue's limit."""
    narrow = replaced_all(
        case, {"instrument.optics.focal_length": 0.15, "instrument.optics.f_number": 2.0}
    )
    assert any("at which the tracker's catalogue ends" in one for one in analytic(narrow).left_out)
    assert not any("catalogue ends" in one for one in analytic(case).left_out)
