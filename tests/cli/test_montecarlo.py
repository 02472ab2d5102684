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
