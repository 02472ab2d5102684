import json
import subprocess
import sys

import numpy as np
import pytest

from startrack.cli import what_matters
from startrack.cli.main import main
from startrack.io import shipped

QUICK = ("--designs", "8", "--workers", "1")


@pytest.fixture(scope="module")
def design(tmp_path_factory):
    """A design of two variables, with a limit that one of them decides."""
    folder = tmp_path_factory.mktemp("matters")
    text = shipped("designs/noise_only.toml").read_text()
    head, *variables = text.split("[[campaign.variables]]")
    path = folder / "design.toml"
    path.write_text("[[campaign.variables]]".join([head, variables[1], variables[4]]))
    return path


def test_the_first_line_answers_and_the_table_has_a_row_for_each(design, capsys):
    folder = design.parent  # whose ledger serves the next test, too
    assert main(["what-matters", str(design), *QUICK, "--out", str(folder)]) == 0
    answer, _, head, *rows = capsys.readouterr().out.splitlines()
    assert (
        "shares of its variance over the ranges, with interactions: optics.f_number (100 %)"
        in answer
    )
    assert answer.endswith("detection.threshold does not matter")
    assert "within 1 % of the best" in head
    assert [row.split()[0] for row in rows[:2]] == ["optics.f_number", "detection.threshold"]
    assert "to 120 ms from 80 ms" in rows[2]  # the lever that buys most
    assert answer in (folder / "what-matters.md").read_text()
    page = (folder / "what-matters.html").read_text()
    assert "optics.f_number" in page
    assert "data:image/png" in page


def test_the_earlier_name_says_what_it_is_called_and_does_the_same(design, capsys):
    found = []
    for name in ("what-matters", "sensitivity"):
        main([name, str(design), *QUICK, "--units", "0", "--json", "--out", str(design.parent)])
        told = capsys.readouterr()
        found.append(json.loads(told.out))
    assert found[0] == found[1]
    assert found[0]["changes"] == {}
    assert "sensitivity is called what-matters now; the earlier name works until" in told.err
    row = found[0]["variables"]["instrument.optics.f_number"]
    assert row["low_arcsec"] < found[0]["error_arcsec"] < row["high_arcsec"]


def test_the_earlier_options_of_the_budget_say_where_they_are(capsys):
    assert main(["budget", "--levers", "--units", "2", "--profile", "none"]) == 2
    assert "levers and tolerances are part of startrack what-matters" in capsys.readouterr().err


def test_a_design_without_a_campaign_has_levers(design, tmp_path, capsys):
    path = tmp_path / "plain.toml"
    path.write_text(design.read_text().partition("[campaign]")[0])
    assert main(["what-matters", str(path), "--out", str(tmp_path)]) == 0
    answer, _, head, first, *_ = capsys.readouterr().out.splitlines()
    assert answer.startswith(
        "instrument.detector.exposure to 120 ms from 80 ms has the largest gain"
    )
    assert head.split() == ["what", "step", "objective", "(%)", "costs"]
    assert first.split()[-4:] == ["-25.88", "power", "-162", "mW"]
    assert main(["what-matters", str(path), "--units", "0", "--out", str(tmp_path)]) == 2
    assert "must have [campaign] with variables" in capsys.readouterr().err


def test_the_list_of_commands_has_the_present_name_alone():
    told = subprocess.run(
        [sys.executable, "-m", "startrack.cli", "--help"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "what-matters" in told
    assert "sensitivity" not in told


def test_how_long_it_takes_is_said_where_that_is_long(monkeypatch, capsys):
    """300 forecasts of 6 s take 30 min, which is printed; for 0.01 s nothing is printed."""
    for seconds, words in ((6.0, "300 forecasts take about 30 min; fewer --designs"), (0.01, "")):
        clock, counted = iter(seconds * np.arange(10)), []
        monkeypatch.setattr(what_matters.time, "monotonic", lambda clock=clock: next(clock))
        count = what_matters._timed(counted.append, 300)
        next(clock), next(clock), next(clock)  # while three are computed
        for _ in range(5):
            count(1)
        assert counted == [1] * 5
        said = capsys.readouterr().err
        assert words in said
        assert said.count("startrack:") == bool(words)
