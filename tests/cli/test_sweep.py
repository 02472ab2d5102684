"""`startrack sweep` and `solve-for` on the command line."""

import csv
import json

import pytest

from startrack import save_design
from startrack.cli.main import main

F_NUMBER = "instrument.optics.f_number"


@pytest.fixture(scope="module")
def design(small, tmp_path_factory):
    file = tmp_path_factory.mktemp("swept") / "small.toml"
    save_design(file, small)
    return str(file)


def test_a_sweep_writes_table_and_picture_and_continues(design, tmp_path, capsys):
    command = ["sweep", design, f"{F_NUMBER}=1.4,-3", "--workers", "1", "--out", str(tmp_path)]
    assert main(command) == 3  # one value is refused
    out = capsys.readouterr().out
    assert out.splitlines()[0].startswith("1 of 2 values meet the requirements; the error across")
    assert "must lie in [0.3, 200], got -3" in out
    with (tmp_path / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row[F_NUMBER] for row in rows] == ["1.4", "-3"]
    assert float(rows[0]["across_rms_arcsec"]) > 0
    assert rows[1]["across_rms_arcsec"] == ""
    assert "must lie in" in rows[1]["refused"]
    assert (tmp_path / "sweep.png").read_bytes()[:4] == b"\x89PNG"
    assert main([*command, "--json"]) == 3
    result = json.loads(capsys.readouterr().out)
    assert result["rows"][0]["across_rms_arcsec"] == float(rows[0]["across_rms_arcsec"])


def test_intervals_of_trials_have_two_columns(design, tmp_path, capsys):
    more = ["--trials", "20", "--fidelity", "covariance", "--workers", "1", "--out", str(tmp_path)]
    assert main(["sweep", design, f"{F_NUMBER}=1.4", *more]) == 0
    with (tmp_path / "sweep.csv").open() as file:
        [row] = csv.DictReader(file)
    low, value, high = (
        float(row[f"across_rms_arcsec{end}"]) for end in ("_95_low", "", "_95_high")
    )
    assert low < value < high
    assert float(row["margin: mass"]) > 0
    assert "20 trials of fidelity covariance, seed 1" in capsys.readouterr().out


def test_a_value_at_a_limit_is_the_first_line(design, tmp_path, capsys):
    more = ["--until", "mass=0.4 kg", "--points", "3", "--workers", "1", "--out", str(tmp_path)]
    assert main(["solve-for", design, f"{F_NUMBER}=1..4", *more]) == 0
    answer = capsys.readouterr().out.splitlines()[0]
    assert answer.startswith(f"mass=0.4 kg: {F_NUMBER} must be at least ")
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["answer"] == answer
    assert result["values"][0]["kept_above"] is True
    assert (tmp_path / "solve-for.png").exists()
    more[1] = "mass=90 kg"
    assert main(["solve-for", design, f"{F_NUMBER}=1..2", *more]) == 3
    assert "kept at every value of" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["sweep", "noise_only", F_NUMBER], "a key must be KEY=A..B or KEY=A,B,C"),
        (["sweep", "noise_only", "a=1..2"], "a is unknown"),
        (["sweep", "noise_only", "a=1", "b=1", "c=1"], "keys must be one or two, got 3"),
        (["sweep", "nanosatelite", "a=1"], "shipped are designs/nanosatellite.toml"),
        (["sweep", "hsrs", "a=1..2"], "a must be a parameter of the design"),
        (["solve-for", "noise_only", "a=1..2", "--until", "both=3"], "a limit must be of across"),
        (
            [
                *("solve-for", "noise_only", "instrument.optics.f_number=1..2"),
                *("--until", "across=-1 arcsec"),
            ],
            "until 'across=-1 arcsec': the limit must be positive",
        ),
        (["solve-for", "noise_only", "a", "--until", "mass"], "must have a range, as KEY=A..B"),
    ],
)
def test_wrong_use_is_said(words, message, tmp_path, capsys):
    assert main([*words, "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
