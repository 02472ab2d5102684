"""The reference of the keys against the files that use them."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import list_keys
import pytest

from startrack import design
from startrack.cli.main import main
from startrack.design.files import load_design
from startrack.design.keys import design_keys
from startrack.design.unknown import is_law
from startrack.io import shipped
from startrack.mission import Mission
from startrack.moving import moving_keys
from startrack.sequence import Sequence

WITHOUT_SOURCES = "import inspect; inspect.getsource = inspect.getsourcelines = None\n"
KEYS = {key.name: key for key in design_keys()}
DESIGNS = sorted(
    [path for folder in ("designs", "trackers") for path in shipped(folder).glob("*.toml")]
)


def keys_of(table: object, place: str = "") -> set[str]:
    """The names of all keys in a file; those of a list of tables once."""
    if isinstance(table, list):
        return set().union(*(keys_of(one, place) for one in table))
    if not isinstance(table, dict) or is_law(table):
        return set()
    found = set()
    for key, value in table.items():
        name = f"{place}.{key}" if place else key
        found |= {name} | keys_of(value, name)
    return found


def test_the_shipped_designs_use_no_other_keys():
    used = set().union(*(keys_of(tomllib.loads(path.read_text())) for path in DESIGNS))
    assert len(used) > 60
    assert used <= set(KEYS)


def test_every_key_has_a_meaning():
    assert len(KEYS) > 300
    assert [name for name, key in KEYS.items() if len(key.meaning) < 4] == []


@pytest.mark.parametrize(
    ("name", "kind", "unit", "default"),
    [
        ("instrument.optics.focal_length", "number", "mm", "required"),
        ("instrument.optics.blur", "number", "um, pixel, arcsec", '"0 um"'),
        ("instrument.detector.thermal", "table", "", "none"),
        ("instrument.detector.bits", "whole number", "", "12"),
        ("instrument.motion.tones", "tables", "", "[]"),
        ("instrument.motion.tones.frequency", "number", "Hz", "required"),
        ("scene.lights", "list of texts", "", "[]"),
        ("catalog.proper_motion", "true or false", "", "true"),
        ("campaign.fidelity", "one of frame, window, spots, covariance", "", '"window"'),
        ("campaign.requirements.volume_fixed", "number", "cm3", '"100 cm3"'),
    ],
)
def test_type_unit_and_default(name, kind, unit, default):
    key = KEYS[name]
    assert (key.kind, key.unit, key.default) == (kind, unit, default)


def test_a_default_may_be_written_into_a_file():
    """Each default that is not a list or table, written into a file, changes nothing."""
    plain = load_design(shipped("designs/noise_only.toml"))
    held = keys_of(tomllib.loads(shipped("designs/noise_only.toml").read_text()))
    tables = {"instrument.optics", "instrument.detector", "scene", "catalog", "campaign"}
    changes = [
        f"{name}={key.default}"
        for name, key in KEYS.items()
        if name.rpartition(".")[0] in tables
        and name not in held
        and key.default not in ("required", "none", "")
        and not key.default.startswith("[")
    ]
    assert len(changes) > 30
    assert load_design(shipped("designs/noise_only.toml"), changes) == plain


@pytest.mark.parametrize(
    "command",
    [
        ["keys"],
        pytest.param(["keys", "--schema"], marks=pytest.mark.slow),
        pytest.param(["init", "all.toml", "--all"], marks=pytest.mark.slow),
    ],
)
def test_without_docstrings_and_sources_all_stays(command, tmp_path, monkeypatch, capsys):
    """As `python -OO` compiles it, without docstrings and sources."""
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    monkeypatch.chdir(here)
    assert main(command) == 0
    expected = [capsys.readouterr().out, *(path.read_text("utf-8") for path in here.iterdir())]
    code = f"{WITHOUT_SOURCES}from startrack.cli.main import main; raise SystemExit(main())"
    made = subprocess.run(
        [sys.executable, "-OO", "-c", code, *command],
        capture_output=True,
        check=True,
        cwd=there,
        encoding="utf-8",
    )
    assert max(map(len, expected)) > 10000
    assert [made.stdout, *(path.read_text("utf-8") for path in there.iterdir())] == expected


def test_the_page_is_that_of_the_code():
    assert list_keys.PAGE.read_text(encoding="utf-8") == list_keys.page(), (
        "python docs/list_keys.py writes it anew"
    )
    assert len(re.findall(r"^\| `", list_keys.page(), re.MULTILINE)) == sum(
        key.kind not in list_keys.TABLES for key in KEYS.values()
    )
    assert Path(list_keys.PAGE).name == "reference.md"


@pytest.mark.parametrize(
    ("page", "text"),
    [
        (list_keys.MISSION, list_keys.mission_page),
        (list_keys.PROFILE, list_keys.profile_page),
        (list_keys.SEARCH, list_keys.search_page),
    ],
)
def test_the_pages_of_other_files_are_of_today(page, text):
    assert page.read_text(encoding="utf-8") == text(), "python docs/list_keys.py writes it anew"


@pytest.mark.parametrize(
    ("folder", "keys"),
    [
        ("missions", design.keys_of(Mission)),
        ("sequences", design.keys_of(Sequence)),
        ("searches", moving_keys()),
    ],
)
def test_shipped_files_of_other_kinds_have_the_keys_that_are_listed(folder, keys):
    known = {key.name for key in keys}
    for path in shipped(folder).glob("*.toml"):
        assert keys_of(tomllib.loads(path.read_text("utf-8"))) <= known, path
