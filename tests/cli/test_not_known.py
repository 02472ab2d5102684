"""Commands on designs with unknown values: intervals beside the figures for middle values."""

import json

import numpy as np
import pytest

from startrack.cli.main import main
from startrack.cli.not_known import over_unknowns

DESIGN = """
base = "designs/noise_only.toml"
[scene]
background_g = { low = 18, high = 22 }
[instrument.optics]
f_number = { median = 2.0, factor = 1.2 }
"""
SHORT = ("--fidelity", "covariance", "--workers", "1", "--trials", "300", "--json")


@pytest.fixture
def run(capsys, tmp_path):
    """Run a command on the design with some of its values replaced; its JSON."""
    path = tmp_path / "design.toml"
    path.write_text(DESIGN)

    def result(command, *options, draws=6):
        main([command, str(path), *options, "--draws", str(draws), *SHORT])
        return json.loads(capsys.readouterr().out)

    return result


def test_values_over_unknowns_are_quantiles_of_draws_with_an_attitude():
    factors = np.column_stack([np.linspace(0.5, 1.5, 101), np.linspace(1, 3, 101)])
    found = over_unknowns((2.0, 10.0), np.vstack([factors, [[np.nan, np.nan]]]))
    assert found["across"]["median"] == pytest.approx(2.0)
    assert found["across"]["68"] == pytest.approx([1.32, 2.68])
    assert found["about"]["95"] == pytest.approx([10.5, 29.5])
    assert over_unknowns((2.0, 10.0), np.full((3, 2), np.nan)) == {}


def test_errors_of_trials_have_an_interval_over_what_is_not_known(run):
    found = run("montecarlo")["not_known"]
    across = found["across_arcsec"]
    assert across["95"][1] > 1.5 * across["95"][0]
    assert (found["unknowns"], found["draws"], found["without_attitude"]) == (2, 6, 0)
    assert across["95"][0] < across["68"][0] < across["median"] < across["68"][1]
    assert "not_known" not in run("montecarlo", draws=0)


def test_two_designs_with_the_same_unknowns_are_compared_draw_by_draw(run, tmp_path):
    """The interval of the ratio of two errors is narrower than those of the errors."""
    longer = tmp_path / "longer.toml"
    longer.write_text(f'{DESIGN}[instrument.detector]\nexposure = "150 ms"\n')
    ratio = run("compare", str(longer))["not_known"]
    assert ratio["across"]["shown"]
    least, most = ratio["across"]["95"]
    assert most < min(1, 1.3 * least)
    alike = run("compare", str(tmp_path / "design.toml"))["not_known"]
    assert alike["about"] == {"median": 1.0, "68": [1.0, 1.0], "95": [1.0, 1.0], "shown": False}


@pytest.mark.parametrize(
    ("limit", "verdict", "met"),
    [
        # The middle passes, as all draws do.
        pytest.param("9 arcsec", "not shown", 6, marks=pytest.mark.slow),
        ("0.38 arcsec", "not shown", None),  # the middle fails, but some draws do not
        pytest.param("0.05 arcsec", "fail", 0, marks=pytest.mark.slow),
    ],
)
def test_a_verdict_for_the_middle_alone_is_none(run, limit, verdict, met):
    found = run("verify", "--set", f"campaign.requirements.max_across={limit}")
    assert found["verdict"] == verdict
    count = found["draws"]["met"]["across"]
    assert count == met if met is not None else 0 < count < 6


@pytest.mark.parametrize(("age", "words"), [("5", "a number with a unit"), ("-5 yr", "negative")])
def test_an_age_that_is_none_is_refused_by_its_option(capsys, age, words):
    assert main(["predict", "sagitta", f"--age={age}"]) == 2
    said = capsys.readouterr().err
    assert "--age must" in said
    assert words in said
