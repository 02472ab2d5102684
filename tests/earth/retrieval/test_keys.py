"""The keys of a scene file against the shipped files, and its JSON Schema against jsonschema."""

import copy
import json
import sys
import tomllib
from pathlib import Path

import pytest

from startrack import shipped
from startrack.earth.retrieval import load_earth_design, scene_keys, scene_schema

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).parents[3]
NAMES = {key.name for key in scene_keys()}
SCENES = sorted(
    path
    for path in shipped("scenes").glob("*.toml")
    if "camera" in tomllib.loads(path.read_text(encoding="utf-8"))
)


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scenes_are_of_the_schema(path: Path):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    jsonschema.Draft7Validator(scene_schema()).validate(table)
    load_earth_design(path)


def test_shipped_cameras_are_of_the_schema():
    for path in shipped("cameras").glob("*.toml"):
        camera = tomllib.loads(path.read_text(encoding="utf-8"))
        if "channels" in camera:
            jsonschema.Draft7Validator(scene_schema()).validate({"camera": camera})


def test_what_the_schema_refuses_no_file_may_hold():
    table = tomllib.loads(shipped("scenes/hsrs.toml").read_text(encoding="utf-8"))
    for place, key, value in (
        ("retrieval.hot_spots", "windows", 3),
        ("land", "texture", 2.0),
        ("campaign", "objective", "beauty"),
        ("orbit", "altitude", 500),
    ):
        wrong = copy.deepcopy(table)
        at = wrong
        for part in place.split("."):
            at = at[part]
        at[key] = value
        assert not jsonschema.Draft7Validator(scene_schema()).is_valid(wrong), key


def test_keys_are_those_of_channels_land_air_and_study():
    for name in (
        "camera.channels.passband.low",
        "camera.channels.required.snr",
        "land.temperature_texture",
        "air.visibility",
        "retrieval.hot_spots.false_alarms",
        "campaign.requirements.min_swath",
        "campaign.conditions.change.name",
    ):
        assert name in NAMES


def test_pages_are_of_today():
    sys.path.insert(0, str(ROOT / "docs"))
    import list_keys

    assert list_keys.SCENE.read_text(encoding="utf-8") == list_keys.scene_page(), (
        "python docs/list_keys.py writes it anew"
    )
    assert json.loads(list_keys.SCENE_SCHEMA.read_text(encoding="utf-8")) == scene_schema()
