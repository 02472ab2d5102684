"""The messages of `startrack montecarlo` about requirements."""

import dataclasses
import json

import numpy as np

from startrack.cli.main import main
from startrack.cli.montecarlo import _required
from startrack.core import arcsec, deg
from startrack.design import Condition, Design, Fidelity, KeepOut, Requirements, save_design
from startrack.metrics import summarise
from startrack.montecarlo import Sampling
from startrack.trial import OUTCOMES
from startrack.verification import boresights, claims_of, counted


def test_conditions_that_are_not_run_are_named_beside_the_requirement(small, tmp_path, capsys):
    needs = dataclasses.replace(small.campaign.requirements, max_across=60 * arcsec)
    slew = Condition("fast slew", rate=1 * deg)
    campaign = dataclasses.replace(small.campaign, requirements=needs, conditions=(slew,))
    path = tmp_path / "design.toml"
    save_design(path, Design(small.case, campaign), "a test")
    arguments = ["montecarlo", str(path), "--trials", "3", "--fidelity", "covariance"]
    main([*arguments, "--workers", "1"])
    assert "`startrack verify` also judges: fast slew; rest" in capsys.readouterr().out
    main([*arguments, "--workers", "1", "--json"])
    assert json.loads(capsys.readouterr().out)["conditions_not_run"] == ["fast slew", "rest"]


def test_an_rms_that_is_limited_has_one_interval(small, tmp_path, capsys):
    """The interval is the verdict's."""
    needs = dataclasses.replace(small.campaign.requirements, max_across=60 * arcsec)
    path, command = tmp_path / "design.toml", ["montecarlo", "--fidelity", "covariance"]
    save_design(path, Design(small.case, dataclasses.replace(small.campaign, requirements=needs)))
    command += [str(path), "--trials", "12", "--workers", "1"]
    main([*command, "--json"])
    told = json.loads(capsys.readouterr().out)
    verdict = told["required"]["across"]
    assert verdict["value_arcsec"] == told["across_rms_arcsec"]
    assert [verdict["low_arcsec"], verdict["high_arcsec"]] == told["across_rms_arcsec_95"]
    main(command)
    text = capsys.readouterr().out
    [line] = [one for one in text.splitlines() if one.startswith("required")]
    assert "[" not in line
    assert "gamma" in line
    level = ["--set", "campaign.requirements.level=99.73 %"]
    main([*command, *level])
    text = capsys.readouterr().out
    assert "too few trials for an upper bound" in text
    assert "inf]" not in text


def test_regions_are_those_of_the_trials_that_count(small, tmp_path, capsys):
    """If blinded trials are left out, regions are counted by the boresights of the other trials
    alone."""
    needs = dataclasses.replace(
        small.campaign.requirements,
        max_across=60 * arcsec,
        sky="worst",
        min_keep_out=KeepOut(sun=80 * deg),
        blinded="left out",
    )
    scene = dataclasses.replace(
        small.case.scene, lights=("sun",), date="2026-01-01T00:00:00", days=360.0
    )
    case = dataclasses.replace(small.case, scene=scene)
    path = tmp_path / "design.toml"
    save_design(path, Design(case, dataclasses.replace(small.campaign, requirements=needs)))
    arguments = ["montecarlo", str(path), "--trials", "60", "--fidelity", "frame"]
    main([*arguments, "--workers", "1", "--seed", "3", "--json"])
    told = json.loads(capsys.readouterr().out)["required"]["across"]
    outcomes = Sampling(Fidelity.FRAME).trials(case, 3, range(60))
    judged = counted(needs, case, 3, outcomes)
    assert 20 < len(judged) < 55
    [claim] = [one for one in claims_of(needs) if one.name == "across"]
    bounds = claim.bounds(judged, boresights(3, judged), 0.05, 0.05)
    assert 1 < bounds.value / arcsec < 60
    assert told["value_arcsec"] == bounds.value / arcsec


def _verdict(needs, x, solved):
    """The summary and the lines of trials with errors x about the first two axes."""
    outcomes = np.zeros(len(x), OUTCOMES)
    outcomes["trial"], outcomes["solved"] = np.arange(len(x)), solved
    outcomes["error_x"] = outcomes["error_y"] = outcomes["error_z"] = x
    before = summarise(outcomes)
    attitudes = Sampling().attitudes_of(1, outcomes["trial"].tolist())
    boresight = attitudes.inv().apply([0.0, 0.0, 1.0])
    summary, _, lines = _required(needs, outcomes, boresight, before)
    return before, summary, lines


def test_an_rms_beside_trials_without_attitude_has_the_interval_of_the_verdict():
    """Sums with and without the failed trials differ in the last digit for many numbers."""
    rng = np.random.default_rng(1)
    needs = Requirements(max_across=60 * arcsec, max_about=60 * arcsec)
    for kind in ("per axis", "radial"):
        for _ in range(20):
            before, summary, lines = _verdict(
                dataclasses.replace(needs, kind=kind),
                rng.normal(0, 1e-5, 999),
                rng.random(999) < 0.9,
            )
            assert (summary.across != before.across) == (kind == "per axis")
            assert summary.about != before.about
            assert ["gamma" in line for line in lines] == [kind == "per axis", True]


def test_a_level_that_happens_to_equal_the_rms_is_none():
    needs = Requirements(
        max_across=60 * arcsec, max_about=60 * arcsec, level="90 %", kind="per axis"
    )
    before, summary, lines = _verdict(needs, np.full(100, 1e-5), np.ones(100, bool))
    assert summary == before
    assert not any("gamma" in line for line in lines)


def test_an_rms_in_the_worst_region_is_not_that_of_the_summary():
    rng = np.random.default_rng(2)
    needs = Requirements(max_across=60 * arcsec, sky="worst")
    before, summary, lines = _verdict(needs, rng.normal(0, 1e-5, 500), np.ones(500, bool))
    assert summary == before
    assert "gamma" not in lines[0]


def test_a_region_without_trials_bounds_no_error():
    """With five trials some of twelve regions stay empty, and these show no figure."""
    for level in ("rms", "99.73 %"):
        needs = Requirements(max_across=60 * arcsec, sky="worst", level=level)
        _, _, lines = _verdict(needs, np.full(5, 1e-5), np.ones(5, bool))
        assert lines[0].endswith(": not shown with 95 %")


def test_without_a_correct_attitude_there_is_no_error(small, tmp_path, capsys):
    path = tmp_path / "design.toml"
    save_design(path, Design(small.case))
    command = ["montecarlo", str(path), "--trials", "3", "--workers", "1", "--fidelity", "window"]
    main([*command, "--set", "instrument.detector.exposure=1 us"])
    told = capsys.readouterr().out
    assert told.startswith("no trial has a correct attitude, so that no error is known")
    assert "nan" not in told
