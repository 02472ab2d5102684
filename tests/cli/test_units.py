"""`startrack montecarlo --units`: errors of units, yield, and the worst unit explained."""

import json
import re
from importlib import import_module

import numpy as np
import pytest

from startrack.budget import Term, UnitBudgets
from startrack.cli.main import main
from startrack.cli.units import ADVICE, units_answer
from startrack.core import arcsec
from startrack.design import design_keys
from startrack.montecarlo import Store

DESIGN = """
base = "designs/noise_only.toml"
lifetime = "5 yr"
[instrument.residual]
rms = 0.1
[[variation]]
name = "instrument.optics.focal_length"
vary = "relative"
sigma = 0.002
[[variation]]
name = "instrument.residual.temperature"
law = "sinusoid"
amplitude = "10 K"
per = "environment"
[campaign.requirements]
max_across = "8 arcsec"
"""


@pytest.fixture(autouse=True)
def _few_windows(monkeypatch):
    """Few windows, because the test asserts nothing about the trials of the unit as designed."""
    monkeypatch.setattr(import_module("startrack.budget.left_out"), "WINDOWS", 4)


@pytest.fixture
def design(tmp_path):
    path = tmp_path / "varied.toml"
    path.write_text(DESIGN)
    return path


def test_the_largest_part_is_of_the_median_unit_as_the_error_beside_it_is():
    """Three units of 1, 2 and 30 arcsec, nearly all of it in one class."""
    error = np.array([1.0, 2.0, 30.0])[:, None] * np.ones(3) * arcsec
    terms = {Term.FIELD: 0.9 * error, Term.NOISE: 0.19**0.5 * error}
    mean = np.zeros((3, 1, 3))
    units = UnitBudgets(
        0.0, mean, error[:, None], np.ones((3, 1)), np.zeros((3, 3)), terms, np.ones(3)
    )
    answer = units_answer(units, ())
    assert answer.startswith("error 2 arcsec across")
    assert "largest class across: FOV spatial, 1.8 arcsec;" in answer


def test_units_have_a_yield_and_the_worst_is_explained(design, tmp_path, capsys):
    command = ["montecarlo", str(design), "--units", "6", "--trials", "10", "--seed", "3"]
    command += ["--fidelity", "covariance", "--environments", "2", "--workers", "1", "--json"]
    main([*command, "--out", str(tmp_path / "out")])
    found = json.loads(capsys.readouterr().out)["units"]
    assert found["count"] == 6
    assert found["age_years"] == pytest.approx(5)
    [share] = found["yields"]
    assert share["most_arcsec"] == pytest.approx(8)
    assert share["low"] <= share["value"] <= share["high"]
    # The residual makes the worst unit; the tracker fits the focal length with the attitude.
    removes = found["worst"]["removes"]
    assert removes["instrument.residual"] < -0.2
    assert abs(removes["instrument.optics.focal_length per unit"]) < 0.05
    with Store(tmp_path / "out" / "campaign.sqlite") as store:
        table = store.outcomes()
        assert store.sampling.units.trials == 10
    assert (table["unit"] == np.arange(60) // 10).all()
    assert (table["environment"] == np.arange(60) % 10 // 5).all()


def test_a_yield_of_a_level_needs_trials_beyond_it(design, capsys):
    command = ["montecarlo", str(design), "--units", "2", "--fidelity", "covariance"]
    command += ["--workers", "1", "--environments", "1"]
    command += ["--set", "campaign.requirements.level=90 %", "--trials"]
    main([*command, "9"])
    shown = capsys.readouterr().out
    assert "it needs --trials 10 for each unit" in shown
    assert "yield, " not in shown
    main([*command, "10", "--json"])
    assert len(json.loads(capsys.readouterr().out)["units"]["yields"]) == 1


def test_trials_of_the_unit_as_designed_say_what_they_leave_out(design, capsys):
    main(["montecarlo", str(design), "--trials", "4", "--fidelity", "covariance", "--workers", "1"])
    assert "noise only" in capsys.readouterr().out


def test_units_of_a_design_in_which_nothing_varies_are_refused(capsys):
    assert main(["montecarlo", "--units", "2", "--trials", "4"]) == 2
    assert "[[variation]]" in capsys.readouterr().err


def test_the_budget_has_both_ends_of_life(design, capsys):
    aged = ["--set", "lifetime=10 yr", "--set", "campaign.requirements.max_about=400 arcsec"]
    main(["budget", str(design), "--units", "2", "--tolerances", "--json", *aged])
    told = json.loads(capsys.readouterr().out)
    begin, end = told["units"]
    assert (begin["age_years"], end["age_years"]) == (0, pytest.approx(10))
    # Nothing here changes with age.
    assert begin["rms_arcsec"] == end["rms_arcsec"]
    classes = begin["classes_rms_arcsec"]
    # A tenth of a pixel of 65 arcsec in each star, shared by some of them, is fixed to the field.
    assert 1 < classes["FOV spatial"]["across"] < 6.5
    assert classes["temporal noise"]["across"] < classes["FOV spatial"]["across"]
    for kinds in begin["levels_arcsec"].values():
        rising = [level["across"] for level in kinds.values()]
        assert rising == sorted(rising)
    # The worst member of all times exceeds the mean of members and times.
    temporal, mixed = (begin["levels_arcsec"][kind]["95.45"] for kind in ("temporal", "mixed"))
    assert temporal["across"] >= mixed["across"]
    shares = {one["requirement"]: one["value"] for one in begin["yields"]}
    assert shares["rms error about the boresight"] == 1.0
    # The rms of the residual buys most; its temperature nothing, for it has no drift.
    halved = told["tolerances"]["halved"]
    names = [one["tolerance"] for one in halved]
    assert names[0] == "instrument.residual.rms"
    swing = halved[names.index("instrument.residual.temperature per environment")]
    assert swing["gain_arcsec"]["value"] == 0
    gains = [one["gain_arcsec"]["value"] for one in halved]
    assert gains == sorted(gains, reverse=True)
    assert 0 < gains[0] < told["tolerances"]["level_arcsec"]


@pytest.mark.slow
def test_levers_are_steps_that_a_maker_may_take_with_what_they_cost(design, capsys):
    calibrated = ["--set", "tracker.calibration.positions=100"]
    main(["budget", str(design), "--units", "2", "--levers", "--json", *calibrated])
    found = json.loads(capsys.readouterr().out)
    levers = {lever["lever"]: lever for lever in found["levers"]["levers"]}
    gains = [lever["gain_arcsec"]["value"] for lever in levers.values()]
    assert gains == sorted(gains, reverse=True)
    # A tenth of a pixel in each star decides, which a map takes off.
    best = list(levers)[:3]
    assert "tracker.calibration.map" in best
    assert "instrument.residual.rms" in best
    assert levers["tracker.calibration.positions"]["calibration_h"] == pytest.approx(
        100 * 30 / 3600
    )
    assert levers["instrument.optics.f_number"]["mass_kg"] > 0
    # What datasheets state grows with what it counts.
    stated = list(found["units"][0]["as_published_arcsec"].values())
    across = [errors["across"] for errors in stated]
    assert across == sorted(across)


def test_the_budget_of_units_needs_something_that_varies(capsys):
    assert main(["budget", "--units", "2"]) == 2
    assert "[[variation]]" in capsys.readouterr().err


def test_classes_of_units_say_what_they_are_and_which_keys_change_them(design, capsys):
    main(["budget", str(design), "--units", "2"])
    shown = capsys.readouterr().out
    assert "\nFOV spatial (" in shown
    assert "\nthermo-elastic (" not in shown  # nothing turns the boresight here
    keys = {key.name for key in design_keys()}
    for text in ADVICE.values():
        named = set(re.findall(r"(?:instrument|tracker)\.[a-z_.]*[a-z_]", text))
        assert named <= keys


def test_requirements_are_verified_by_the_yield_at_both_ends_of_life(design, tmp_path, capsys):
    """Three units are too few to show anything; the exit status says so."""
    command = ["verify", str(design), "--units", "3", "--fidelity", "covariance", "--workers", "1"]
    command += ["--set", "campaign.unit_trials=4", "--out", str(tmp_path / "out"), "--json"]
    assert main(command) == 3
    found = json.loads(capsys.readouterr().out)
    assert (found["units"], found["trials_each"], found["noise_only"]) == (3, 8, False)
    own = found["requirements"][0]
    assert (own["condition"], own["requirement"], own["least_yield"]) == ("nominal", "across", 0.95)
    assert [one["age_years"] for one in own["ages"]] == pytest.approx([0, 5])
    for one in own["ages"]:
        assert one["bounds"][0] <= one["yield"] <= one["bounds"][1]
    assert "yield, 5 yr (%)" in (tmp_path / "out" / "verdict.md").read_text()


def test_tolerances_need_units(capsys):
    assert main(["budget", "--tolerances"]) == 2
    assert "--tolerances needs --units" in capsys.readouterr().err


def test_more_environments_than_trials_of_a_unit_are_refused(design, capsys):
    command = ["montecarlo", str(design), "--units", "2", "--trials", "4", "--workers", "1"]
    command += ["--fidelity", "covariance", "--environments"]
    assert main([*command, "5"]) == 2
    shown = capsys.readouterr().err
    assert "--environments must be at most --trials, the 4 trials of each unit, got 5" in shown
    assert main(["montecarlo", str(design), "--trials", "4", "--environments", "2"]) == 2
    assert "--environments needs --units" in capsys.readouterr().err


@pytest.mark.parametrize(("asked", "met"), [(["--environments", "4"], 4), ([], 4)])
def test_units_of_few_trials_have_an_environment_for_each(asked, met, design, tmp_path):
    """Also by default, if there are fewer trials than the usual ten environments."""
    command = ["montecarlo", str(design), "--units", "2", "--trials", "4", "--workers", "1"]
    main([*command, "--fidelity", "covariance", "--out", str(tmp_path / "out"), *asked])
    with Store(tmp_path / "out" / "campaign.sqlite") as store:
        assert len(set(store.outcomes()["environment"])) == met
