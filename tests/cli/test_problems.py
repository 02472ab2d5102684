"""Commands on campaigns accept an Earth camera where possible, and otherwise say why not."""

import json

import pytest

from startrack.cli.main import main
from startrack.cli.pareto import front_words
from startrack.io import shipped

FEW = [
    "campaign.analytic_evaluations=4",
    "campaign.evaluations=3",
    "campaign.trials=25",
    "campaign.most_trials=25",
    "campaign.fresh_trials=50",
]


def test_a_change_of_a_scene_without_its_unit_is_said(capsys):
    assert main(["requirements", "hsrs", "--set", "orbit.altitude=-5"]) == 2
    assert "orbit.altitude must have a unit, such as '1 km', got -5.0" in capsys.readouterr().err


def test_the_mtf_of_staggered_lines_says_its_frequency(capsys):
    for scene, said in (("hsrs", 2), ("waoss", 0)):
        assert main(["requirements", scene]) == 0
        words = "at half a cycle per pixel; staggered lines sample twice as finely"
        assert capsys.readouterr().out.count(words) == said


def test_scenes_with_other_objectives_are_refused_before_any_trial(capsys):
    assert main(["compare", "mertis", "hsrs", "--trials", "100000000", *SHORT]) == 2
    words = "one objective, got error of emissivity and smallest fire"
    assert words in capsys.readouterr().err
    assert main(["compare", "noise_only", "hsrs", "--trials", "100000000"]) == 2
    words = "noise_only is a design of a star tracker and hsrs is a scene of an Earth camera"
    assert words in capsys.readouterr().err


@pytest.mark.slow
def test_an_earth_camera_is_optimised(tmp_path, capsys):
    changes = [word for change in FEW for word in ("--set", change)]
    words = ["optimize", "hsrs", "--workers", "1", "--out", str(tmp_path), *changes, "--json"]
    assert main(words) in (0, 3)
    found = json.loads(capsys.readouterr().out)
    assert found["factor"][0] >= 1
    assert set(found["best_si"]) == set(found["start_si"])
    assert {"aperture", "swath", "nominal: power"} <= set(found["verdicts"])
    answer = (tmp_path / "comparison.md").read_text().splitlines()[0]
    assert "in the smallest fire: " in answer
    assert answer.endswith("All limits are met.") == found["feasible"]
    assert (tmp_path / "convergence.png").stat().st_size > 10_000
    assert json.loads((tmp_path / "best.json").read_text()) == found["best_si"]


def test_trials_of_an_earth_camera_stand_beside_its_formula(tmp_path, capsys):
    out = str(tmp_path)
    assert main(["montecarlo", "mertis", "--trials", "20", "--out", out, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["trials"] == 20
    assert found["value"][1] <= found["value"][0] <= found["value"][2]
    assert found["expected"] == pytest.approx(found["value"][0], rel=0.5)
    lines = (tmp_path / "trials.csv").read_text().splitlines()
    assert len(lines) == 21
    assert lines[0].startswith('trial,"nominal: ')


def test_options_of_star_trackers_are_refused_for_a_scene(capsys):
    words = ["montecarlo", "mertis", "--trials", "5", "--fidelity", "spots", "--units", "3"]
    assert main(words) == 2
    assert "--fidelity, --units must be left out for a scene" in capsys.readouterr().err


def test_what_neither_trials_nor_formula_know_stands_below_the_table(capsys):
    assert main(["montecarlo", "mertis", "--trials", "5", "--workers", "1"]) == 0
    text = capsys.readouterr().out
    assert "Not counted: the optics' blur between spectra; smile" in text
    first = text.splitlines()[0]
    assert first.startswith("error of emissivity 0.00")
    assert first.endswith(
        "1 of 3 requirements met (nominal: wrong: not shown, evening: wrong: not shown)"
    )


@pytest.mark.parametrize("command", ["budget", "sequence"])
def test_what_takes_star_trackers_alone_says_what_takes_a_scene(command, capsys):
    assert main([command, "hsrs"]) == 2
    assert "a scene of an Earth camera, for the commands earth, page, requirements, optimize" in (
        capsys.readouterr().err
    )
    assert main([command, str(shipped("scenes/mertis.toml"))]) == 2


SHORT = ["--workers", "1", "--json"]
QUICK = ["--set", "retrieval.minerals.pixels=32"]


def test_limits_of_a_scene_are_judged(tmp_path, capsys):
    words = ["verify", "mertis", "--trials", "128", "--out", str(tmp_path), *QUICK, *SHORT]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "pass"
    names = [row["requirement"] for row in found["requirements"]]
    assert names == ["aperture", "nominal: wrong", "evening: wrong"]
    assert "verdict: pass" in (tmp_path / "verdict.md").read_text()


def test_two_scenes_are_compared(capsys):
    scene = str(shipped("scenes/mertis.toml"))
    assert main(["compare", "mertis", scene, "--trials", "32", *QUICK, *SHORT]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["statistics"]["error of emissivity"]["ratio"] == [1, 1, 1]
    assert main(["compare", "mertis", scene, "--trials", "32", *QUICK, *SHORT[:-1]]) == 0
    answer = capsys.readouterr().out.splitlines()[0]
    assert answer.endswith("error of emissivity 1 [1, 1]; no difference is shown")


@pytest.mark.slow
def test_a_scene_has_sensitivities_a_tolerance_a_front_and_a_page(tmp_path, capsys):
    out = ["--out", str(tmp_path), *QUICK, *SHORT]
    assert main(["what-matters", "mertis", "--designs", "8", *out]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["variables"]["retrieval.minerals.step"]["low"] > 0
    assert main(["sample", "mertis", *out]) in (0, 3)
    capsys.readouterr()
    assert main(["pareto", "mertis", "--points", "3", *out]) == 0
    front = json.loads(capsys.readouterr().out)
    assert len(front["points"]) >= 2
    assert front["goals"] == ["objective", "aperture"]
    first, last = (point["tried"] for point in (front["points"][0], front["points"][-1]))
    answer = (tmp_path / "front.md").read_text().splitlines()[0]
    ends = (
        f"error of emissivity {error:.4g} at aperture {size:.4g} m" for error, size in (first, last)
    )
    assert answer.endswith(" to ".join(ends))
    page = tmp_path / "page.html"
    assert main(["report", "mertis", "--trials", "64", "--out", str(page), *SHORT]) == 0
    assert "error of emissivity" in page.read_text()


def test_a_key_of_a_scene_is_swept_and_solved_for(tmp_path, capsys):
    """The swath of a scene grows with its height, so that its limit is met above one height."""
    swept = "channels.mir.detector.exposure=1..4 ms"
    out = ["--out", str(tmp_path), "--workers", "1", "--json"]
    assert main(["sweep", "hsrs", swept, "--points", "2", *out]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [row["channels.mir.detector.exposure"] for row in told["rows"]] == ["1 ms", "4 ms"]
    assert told["rows"][0]["value"] > told["rows"][1]["value"] > 0
    assert (tmp_path / "sweep.csv").read_text().startswith("channels.mir.detector.exposure,value")
    assert (tmp_path / "sweep.png").exists()
    key = ["orbit.altitude=400..800 km", "--until", "swath", "--points", "3"]
    assert main(["solve-for", "hsrs", *key, *out]) == 0
    [crossing] = json.loads(capsys.readouterr().out)["values"]
    assert 540 < crossing["value"] < 560
    assert crossing["kept_above"]
    key = [swept, "--until", "nominal: power", "--points", "2", "--trials", "0"]
    assert main(["solve-for", "hsrs", *key, *out]) == 3  # met by both
    left_out = json.loads(capsys.readouterr().out)["not_counted"]
    assert any("relief and clouds" in phrase for phrase in left_out)


def test_a_front_of_one_design_says_that_there_is_no_choice():
    assert front_words(1, "mass 1 kg", "mass 1 kg").startswith("1 design is the best by both goals")
    assert front_words(2, "mass 1 kg", "mass 2 kg").endswith("from mass 1 kg to mass 2 kg")
