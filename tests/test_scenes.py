"""Effects that a scene needs: left out one after the other, and the remaining chain."""

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "experiments"))
import leaving_out
from leaving_out import View, extra_time, gap, leave_out, observed
from scenes import main

from startrack.optics import Pupil

SIZES = {"tiny": 0.05, "small": 0.2, "large": 2.0}


def view(sizes=SIZES, **changes) -> View:
    """A model whose error is noise of rms one plus effects of known sizes, each with its own
    sign."""

    def observe(model, number):
        random = np.random.default_rng(number)
        noise, signs = random.standard_normal((50, 1)), random.choice([-1, 1], (50, len(sizes)))
        return noise + signs @ np.array([[size * (name in model)] for name, size in sizes.items()])

    return View(
        "made",
        "noise",
        frozenset(sizes),
        {name: lambda model, name=name: model - {name} for name in sizes},
        observe,
        lambda model, numbers, values: np.sqrt((values**2).mean((0, 1))),
        ("1",),
        **changes,
    )


def study(view: View, fraction=1 / 3):
    return leave_out(view, 20, 1, fraction, lambda what: None)


def test_an_effect_left_out_makes_the_error_that_it_has():
    found = {effect.name: effect.gap for effect in study(view()).effects}
    for name, size in SIZES.items():
        assert found[name].error[0] == pytest.approx(size, rel=1e-12)


def test_the_time_of_an_effect_does_not_depend_on_who_goes_first(monkeypatch):
    calls = itertools.count()

    def clocked(observe, model, number):
        first = next(calls) % 2 == 0
        return None, (5.0 if "slow" in model else 2.0) + first

    monkeypatch.setattr(leaving_out, "clocked", clocked)
    assert extra_time(view({"slow": 1.0}), frozenset(), range(4)) == 3.0


def test_what_is_small_together_is_spared_and_the_gap_is_as_stated():
    found = study(view())
    assert {effect.name for effect in found.effects if effect.kept} == {"large"}
    _, lean = found.ways
    assert found.bound[0] == pytest.approx(np.hypot(0.05, 0.2))
    # Of 1000 independent signs; five standard errors, false once in a million runs.
    assert lean.gap.error[0] == pytest.approx(found.bound[0], rel=5 * 0.25 / np.sqrt(2 * 1000))


def test_effects_that_are_too_much_together_are_not_all_spared():
    many = {f"effect {n}": 0.2 for n in range(9)}
    spared = [effect for effect in study(view(many), 0.4).effects if not effect.kept]
    # Noise of one and nine of 0.2 are an own error of sqrt(1.36): 0.4^2 of it holds 5.4 of them.
    assert len(spared) == 5


def test_what_takes_an_answer_away_is_kept():
    def without(model):
        return model | {"blind"}

    def observe(model, number):
        blind = "blind" in model and number == 3
        return np.full((1, 1), np.nan if blind else 1.0)

    made = replace(view(), effects={"sight": without}, observe=observe)
    (effect,) = study(made).effects
    assert effect.gap.changed == 1
    assert effect.gap.error[0] == 0
    assert effect.kept


def test_the_standard_error_is_that_of_trials_not_of_places():
    random = np.random.default_rng(1)
    found = []
    for _ in range(300):
        alike = np.repeat(random.standard_normal((40, 1, 1)), 30, axis=1)
        found.append(gap(alike, np.zeros_like(alike)))
    spread = np.std([one.error[0] for one in found])
    # The spread of 300 is known to 4 %, the median of what is stated to 1 %.
    assert np.median([one.sigma[0] for one in found]) == pytest.approx(spread, rel=0.2)


def test_a_refused_faster_way_is_named():
    def refuse(model, number):
        raise ValueError("fidelity must be frame")

    found = study(view(faster=refuse))
    assert found.refused == "fidelity must be frame"
    assert len(found.ways) == 2


@pytest.fixture(scope="module")
def dark():
    """With larger pixels, a plain lens and a black sky, which take less time."""
    import scenes_tracker

    found = next(scenes_tracker.views())
    full = found.without(["settling of the read-out", "zodiacal light", "airglow and cities"])
    pitch = 2 * full.instrument.detector.pixel_pitch
    full = scenes_tracker.with_detector(full, columns=256, rows=256, pixel_pitch=pitch)
    plain = {"psf": "airy", "aberrations": (), "pupil": Pupil(), "blur": 10e-6}
    full = scenes_tracker.with_optics(full, **plain)
    few = ("rolling shutter", "blooming", "lag", "read noise")
    return replace(found, full=full, effects={name: found.effects[name] for name in few})


@pytest.mark.slow
def test_a_dark_field_needs_its_read_noise_and_no_blooming(dark):
    found = {effect.name: effect for effect in leave_out(dark, 3, 1, 1 / 3, print).effects}
    assert found["blooming"].gap.error.tolist() == [0, 0]
    assert found["read noise"].fraction > 3 * found["lag"].fraction > 0
    assert found["read noise"].kept
    assert not found["blooming"].kept


def test_a_tracker_sees_the_same_noise_without_an_effect(dark):
    whole, without = (
        observed(dark.observe, model, [0]) for model in (dark.full, dark.without(["lag"]))
    )
    # Other noise would differ by 1.4 of it.
    assert 0 < np.nanmax(abs(whole - without)) < np.nanmax(abs(whole)) / 3


def test_the_imagers_noise_is_that_of_its_photons_and_its_read_out():
    import scenes_imager

    view = scenes_imager.view()
    detector = view.full.channel.detector
    bare = view.without([name for name in view.effects if name in BARE])
    values = observed(view.observe, bare, [0])
    electrons = (values - detector.offset) * detector.electrons_per_dn
    photons = np.sqrt(electrons.mean() + detector.read_noise**2) / detector.electrons_per_dn
    expected = np.hypot(photons, 12**-0.5)
    # Of 2304 pixels: 1.5 % is a standard error.
    assert view.own(bare, [0], values)[0] == pytest.approx(expected, rel=0.08)


BARE = (
    *("sky that a slope sees", "9 rays a pixel (4 instead)", "PRNU", "dark current"),
    *("DSNU and hot pixels", "non-linearity", "row and column noise", "settling of the read-out"),
)


@pytest.mark.slow
def test_the_experiment_leaves_table_values_and_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(
        sys, "argv", ["scenes.py", "--trials", "2", "--out", str(tmp_path), "in the dark"]
    )
    main()
    assert "| planets | 0; 0 |" in (tmp_path / "scenes.md").read_text()
    assert (tmp_path / "scenes.json").stat().st_size > 1000
    assert (tmp_path / "scenes.png").stat().st_size > 10_000
