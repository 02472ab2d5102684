"""Design files over another file, with the differences alone."""

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from startrack import load_design
from startrack.design import branches, replaced_all, save_overlay
from startrack.io import shipped

BASE = """
# The design of an engineer, with comments.
base = "designs/noise_only.toml"
[instrument.optics]
blur = { low = "4 um", high = "6 um" }   # nobody told us
[[campaign.choices]]
name = "instrument.detector"
values = ["star250", "mine.toml"]
"""
FOUND = {"instrument.optics.focal_length": 0.0312345678901234, "instrument.optics.f_number": 1.7}


@pytest.fixture
def base(tmp_path):
    (tmp_path / "mine.toml").write_text('columns = 640\nrows = 480\npixel_pitch = "5 um"\n')
    path = tmp_path / "mine" / "design.toml"
    path.parent.mkdir()
    path.write_text(BASE.replace("mine.toml", "../mine.toml"))
    return path


def overlay(tmp_path, design, base):
    path = tmp_path / "out" / "best.toml"
    path.parent.mkdir(exist_ok=True)
    save_overlay(path, design, base, "found\nhere")
    assert path.read_text().startswith("# found\n# here\n")
    read = load_design(path)
    assert (read.case, read.campaign) == (design.case, design.campaign)
    return tomllib.loads(path.read_text()), read


def test_only_what_differs_is_written_with_all_digits(tmp_path, base):
    design = load_design(base)
    best = replace(design, case=replaced_all(design.case, FOUND))
    table, read = overlay(tmp_path, best, base)
    assert table == {
        "base": "../mine/design.toml",
        "instrument": {"optics": {"focal_length": "31.2345678901234 mm", "f_number": 1.7}},
    }
    assert [unknown.name for unknown in read.unknowns] == ["instrument.optics.blur"]
    assert "# nobody told us" in base.read_text()


def test_a_chosen_detector_has_its_name(tmp_path, base):
    design = load_design(base)
    first, second = branches(design.case, design.campaign.choices)
    table, _ = overlay(tmp_path, replace(design, case=first.case), base)
    assert table["instrument"] == {"detector": {"product": "star250"}}
    table, _ = overlay(tmp_path, replace(design, case=second.case), base)
    [product] = table["instrument"]["detector"].values()
    assert Path(product).samefile(tmp_path / "mine.toml")


def test_the_changes_of_a_command_are_in_it_and_the_start_alone_is_short(tmp_path):
    base = shipped("designs/nanosatellite.toml")
    changed = load_design(base, ["campaign.trials=7", "variation.0.scale=0.5"])
    table, _ = overlay(tmp_path, changed, base)
    assert table["campaign"] == {"trials": 7}
    assert len(table["variation"]) == len(changed.case.variation)
    table, _ = overlay(tmp_path, load_design(base), base)
    assert list(table) == ["base"]


def test_what_was_taken_out_leaves_a_whole_design(tmp_path, base):
    """No file can remove a key of the file below it, so that the whole design is written."""
    base.write_text(base.read_text() + '[campaign.requirements]\nmax_rate = "0.1 deg/s"\n')
    assert load_design(base).campaign.requirements.max_rate
    table, _ = overlay(tmp_path, load_design(base, ["campaign.requirements.max_rate="]), base)
    assert "base" not in table
    assert "columns" in table["instrument"]["detector"]


def test_a_shipped_design_below_is_named_as_everywhere(tmp_path):
    """The shipped design is written by its name, not its path, because the file may be moved."""
    base = shipped("designs/noise_only.toml")
    design = load_design(base, ["instrument.optics.f_number=2.0"])
    table, _ = overlay(tmp_path, design, base)
    assert table == {"base": "designs/noise_only.toml", "instrument": {"optics": {"f_number": 2.0}}}
