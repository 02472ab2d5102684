"""What `startrack montecarlo` says of requirements."""

import dataclasses
import json

from startrack.cli.main import main
from startrack.core import arcsec, deg
from startrack.design import Condition, Design, save_design


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
    """That of the verdict."""
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
    assert "Hall" in line
    level = ["--set", "campaign.requirements.level=99.73 %"]
    main([*command, *level])
    text = capsys.readouterr().out
    assert "too few trials for an upper bound" in text
    assert "inf]" not in text
