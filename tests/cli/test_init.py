"""`startrack init`: a design that loads, for every detector of the catalogue; copies of files."""

import re
import tomllib
from dataclasses import replace

import pytest

from startrack.cli.init import COPIED
from startrack.cli.main import main
from startrack.design import load_design, products, template
from startrack.io import shipped


@pytest.mark.parametrize("product", ["", *products()])
def test_it_loads_and_has_the_detector(product, tmp_path, capsys):
    path = tmp_path / "mine.toml"
    assert main(["init", str(path), *(["--from", product] if product else [])]) == 0
    example, found = load_design(shipped("designs/nanosatellite.toml")), load_design(path)
    said = capsys.readouterr().out
    needs, given = found.campaign.requirements, example.campaign.requirements
    kept = {name: getattr(given, name) for name in ("max_power", "min_update_rate")}
    assert replace(needs, **kept) == given
    assert replace(found.campaign, requirements=given) == example.campaign
    assert ("cannot keep the limit of the example" in said) == (needs != given)
    # The design keeps its limits, with the room of the example's where they follow its detector.
    assert needs.power(found.case) <= needs.max_power
    assert found.case.instrument.detector.update_rate >= needs.min_update_rate
    if needs.max_power > given.max_power:
        room = given.max_power - given.power(example.case)
        spare = needs.max_power - needs.power(found.case)
        assert room <= spare <= room + 0.1 * needs.max_power
    assert found.case.instrument.optics == example.case.instrument.optics
    detector = found.case.instrument.detector
    assert product == "" or detector != example.case.instrument.detector
    assert found.case.tracker.detection.saturation == 2**detector.bits - 1


def test_all_keys_are_defaults(tmp_path):
    """Except for keys that the class of units sets: without it, nothing changes."""
    path, bare = tmp_path / "all.toml", tmp_path / "bare.toml"
    main(["init", str(path), "--all"])
    # Without the marks of comments before keys, the values stand there as a file has them.
    lines = path.read_text().splitlines()
    table = "\n".join(re.sub(r"^# (\w+ = )", r"\1", line) for line in lines)
    assert tomllib.loads(table)["tracker"]["detection"]["window"] == 5
    example = shipped("designs/nanosatellite.toml").read_text()
    for text, where in ((table, path), (example, bare)):
        less, includes = re.subn(r"(?ms)^include = \[.*?\]$", "", text)
        assert includes == 1
        where.write_text(less)
    assert load_design(path).case == load_design(bare).case


def test_nothing_is_overwritten(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    path.write_text("kept")
    assert main(["init", str(path)]) == 2
    assert path.read_text() == "kept"
    assert "must not exist yet" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "following"),
    [
        ("hsrs", "requirements"),
        ("asteroidfinder", "montecarlo"),
        ("nanosatellite", "budget"),
        ("sun-synchronous", "mission"),
        ("slew", "sequence --profile"),
    ],
)
def test_a_shipped_file_is_copied(tmp_path, capsys, name, following):
    path = tmp_path / "mine.toml"
    assert main(["init", str(path), "--from", name]) == 0
    assert f"next: startrack {following} {path}" in capsys.readouterr().out
    (original,) = (
        file for folder in COPIED if (file := shipped(folder) / f"{name}.toml").is_file()
    )
    assert path.read_text() == original.read_text()


def test_a_copied_design_is_the_shipped_one(tmp_path):
    path = tmp_path / "mine.toml"
    main(["init", str(path), "--from", "nanosatellite"])
    assert load_design(path).case == load_design(shipped("designs/nanosatellite.toml")).case


def test_an_unknown_detector_is_named_with_those_there_are(tmp_path, capsys):
    assert main(["init", str(tmp_path / "x.toml"), "--from", "imx1"]) == 2
    assert "imx250" in capsys.readouterr().err
    with pytest.raises(ValueError, match="imx1"):
        template("imx1")


def test_what_is_written_takes_a_level(tmp_path):
    """With units, each unit has the number of trials that the level needs."""
    path = tmp_path / "mine.toml"
    path.write_text(template("imx250"))
    campaign = load_design(path, ["campaign.requirements.level=99.73 %"]).campaign
    assert campaign.requirements.accuracy[0].objective.fraction == pytest.approx(0.9973)
    assert campaign.trials_per_unit == 371
