"""`startrack budget`."""

import json
from importlib import import_module

import pytest

from startrack.budget import Term, indices_of
from startrack.cli import budget as module
from startrack.cli.main import main
from startrack.io import cache, shipped


@pytest.fixture(autouse=True)
def _few_windows(monkeypatch):
    """Few windows, because the test asserts nothing about the trials beside a budget."""
    monkeypatch.setattr(import_module("startrack.budget.left_out"), "WINDOWS", 12)


def run(capsys, *arguments: str) -> tuple[int, str, str]:
    status = main(["budget", *arguments])
    out, err = capsys.readouterr()
    return status, out, err


def test_the_table_names_causes_and_terms(capsys):
    status, out, _ = run(capsys, "--full")
    assert status == 0
    for word in ("read noise", "PRNU", "temporal noise", "pixel spatial", "end to end", "99.73 %"):
        assert word in out
    assert "\nbetter: tracker.detection.centroid = 'likelihood' instead of 'gravity'" in out


def test_json_holds_both_columns(capsys):
    status, out, _ = run(capsys, "--json", "--montecarlo", "6", "--times", "2", "--workers", "1")
    assert status == 0
    result = json.loads(out)
    assert set(result["analytic"]["causes"]) == set(result["measured"]["causes"])
    assert set(result["analytic"]["terms"]) == {term.value for term in Term}
    assert set(result["measured"]["end to end"]["levels"]) == {"temporal", "ensemble", "mixed"}
    assert set(result["analytic"]["end to end"]["levels"]) == {"mixed"}
    assert 0.3 < result["measured"]["end to end"]["across"] < 1.5


def test_a_better_centroid_is_suggested_by_its_own_budget_and_followed_no_more(capsys):
    noise_only = str(shipped("designs/noise_only.toml"))
    fitted = ["--set", "tracker.detection.centroid=likelihood"]
    results = [
        json.loads(run(capsys, noise_only, "--full", "--json", *more)[1]) for more in ([], fitted)
    ]
    [better] = results[0]["better"]  # it tracks all stars that it sees
    assert better["value"] == "likelihood"
    assert better["across_arcsec"] == pytest.approx(results[1]["analytic"]["sum"]["across"])
    assert results[1]["better"] == []


def test_a_second_call_on_the_same_design_says_the_same_and_computes_nothing(capsys, monkeypatch):
    monkeypatch.setattr(cache, "LONG", 0.0)
    monkeypatch.setattr(cache, "interpreting", lambda: False)
    words = "noise_only", "--set", "instrument.detector.exposure=99 ms"
    first = run(capsys, *words)
    for place in (f"{module.__name__}.analytic", "startrack.budget.check"):
        monkeypatch.setattr(place, pytest.fail)
    assert run(capsys, *words) == first
    assert run(capsys, *words[:-1], "instrument.detector.exposure=98 ms")[0] == 1  # it computes


class Stopped(Exception):
    """Raised by a step that must not be reached."""


def _stops(*_args, **_named):
    raise Stopped


def test_the_table_stands_before_what_takes_longer(capsys, monkeypatch):
    monkeypatch.setattr(module.budgets, "single_stars", _stops)
    status, out, err = run(capsys, "--full")
    assert (status, "Stopped" in err) == (1, True)
    assert "root sum square" in out


@pytest.mark.parametrize("json_too", [(), ("--json",)])
def test_all_figures_stand_before_pictures_of_the_sky_are_drawn(
    capsys, monkeypatch, tmp_path, json_too
):
    monkeypatch.setattr("startrack.plots.draw_budget", _stops)
    status, out, err = run(capsys, "--out", str(tmp_path / "out"), *json_too)
    assert (status, "Stopped" in err) == (1, True)
    kept = json.loads((tmp_path / "out" / "budget.json").read_text())
    if json_too:
        assert json.loads(out) == kept | {"out": str(tmp_path / "out")}
    else:
        assert "root sum square" in out
        assert "trials (" in out


def test_why_stars_are_refused_stands_above_the_error_that_it_makes(capsys):
    noise_only = str(shipped("designs/noise_only.toml"))
    _, out, _ = run(capsys, noise_only, "--set", "instrument.optics.blur=0 um")
    assert out.count("are rejected as hot pixels") == 1
    assert out.index("are rejected as hot pixels") < out.index("arcsec rms per axis")


@pytest.mark.slow
def test_pictures_and_indices(capsys, tmp_path):
    profile = tmp_path / "calm.toml"
    profile.write_text('period = "0.5 s"\n[[legs]]\nduration = "3 s"\n')
    status, out, _ = run(
        capsys,
        "--profile",
        str(profile),
        "--sequences",
        "1",
        "--workers",
        "1",
        "--out",
        str(tmp_path / "out"),
    )
    assert status == 0
    assert "RKE" in out
    assert {one.name for one in (tmp_path / "out").iterdir()} == {
        *("budget.json", "budget.png", "sky.png", "curves.png")
    }
    assert (
        json.loads((tmp_path / "out" / "budget.json").read_text())["indices"]["AKE"]["across"] > 0
    )


@pytest.mark.parametrize("arguments", [["none.toml"], ["--profile", "none.toml"]])
def test_wrong_use_has_a_message(capsys, arguments):
    status, _, err = run(capsys, *arguments)
    assert status == 2
    assert "none.toml must be a" in err
    assert "Traceback" not in err


def test_the_number_of_sequences_is_that_of_the_option(capsys, tmp_path, monkeypatch):
    profile = tmp_path / "calm.toml"
    profile.write_text('period = "0.5 s"\n[[legs]]\nduration = "3 s"\n')
    flown = []

    def counted(case, sequence, members, *rest):
        flown.append(members)
        return indices_of(case, sequence, 1, *rest)

    monkeypatch.setattr(module.budgets, "indices_of", counted)
    asked = ["--profile", str(profile), "--sequences", "3", "--workers", "1"]
    assert run(capsys, *asked)[0] == 0
    assert flown == [3]


def test_a_design_with_unknown_values_ends_with_the_interval_of_its_prediction(capsys, tmp_path):
    path = tmp_path / "design.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\n[scene]\nbackground_g = { low = 18, high = 22 }\n'
    )
    _, out, _ = run(capsys, str(path), "--draws", "8", "--workers", "1", "--json")
    found = json.loads(out)["not_known"]["figures_arcsec"]["NEA"]["across"]
    assert main(["predict", str(path), "--draws", "8", "--workers", "1", "--json"]) == 0
    alone = json.loads(capsys.readouterr().out)["figures_arcsec"]["NEA"]["across"]
    assert found == alone
    assert found["95"][0] < found["median"] < found["95"][1]
