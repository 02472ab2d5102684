"""A file or a name on the command line: what it is, and which commands take it."""

import json
from pathlib import Path

import pytest

from startrack.cli.files import (
    DESIGNS,
    GEOMETRY,
    GOALS,
    MISSION,
    SCENE,
    SEARCH,
    SEQUENCE,
    STUDIES,
    kind_of,
)
from startrack.cli.main import main
from startrack.cli.problems import ACTIONS
from startrack.io import shipped

FOLDERS = {"searches": SEARCH, "missions": MISSION, "sequences": SEQUENCE}
NOISE_ONLY = shipped("designs/noise_only.toml")
SCENES = {"goals": GOALS, "mountains": GEOMETRY}


def test_every_shipped_file_has_its_kind_by_path_and_by_name():
    for folder in (*DESIGNS, *FOLDERS, "scenes"):
        for file in shipped(folder).glob("*.toml"):
            kind = SCENES.get(file.stem, SCENE) if folder == "scenes" else FOLDERS.get(folder)
            assert kind_of(file) is kind_of(Path(file.stem)) is kind, file


def test_each_study_has_its_action():
    assert sorted(ACTIONS) == sorted(STUDIES)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "budget asteroidfinder",
            "is a search for moving objects, for the commands requirements, ",
        ),
        ("predict hsrs", "is a scene of an Earth camera, for the commands earth, page, "),
        ("optimize mountains", "is a scene without a camera, for the command earth geometry; "),
        ("requirements sun-synchronous", "is a mission, for the command mission; this command "),
        ("earth render asteroidfinder", "must be a scene of an Earth camera, and is a search for"),
        (f"earth render {NOISE_ONLY}", "and is the design of a star tracker; startrack simulate "),
        ("earth render mountains", "must name a camera; with a sensor it is for `earth geometry`"),
        ("init x.toml --from imx1", "--from must be a detector (ccd201-20, "),
        ("init x.toml --from hsrs --all", "--all must be left out for a copy, got --from hsrs"),
    ],
)
def test_another_kind_of_file_is_named_with_its_commands(capsys, words, said):
    assert main(words.split()) == 2
    assert said in capsys.readouterr().err


def test_the_figures_of_an_earth_camera_follow_a_changed_value(capsys):
    """A ground sample distance grows as the altitude: 1.1 times, but for the Earth's curvature."""
    found = []
    for km in (500, 550):
        main(["requirements", "hsrs", "--set", f"orbit.altitude={km} km", "--json"])
        found.append(json.loads(capsys.readouterr().out.splitlines()[1])["gsd"])
    assert found[1] / found[0] == pytest.approx(1.1, rel=0.002)


def test_the_requirements_of_a_search_for_moving_objects_are_judged_by_formula(capsys):
    """The aperture is focal length over f-number; with a smaller f-number it exceeds its limit."""
    assert main(["requirements", "asteroidfinder"]) == 0
    assert capsys.readouterr().out.startswith("flux of the objects of which 50% are found: ")
    lens = ("instrument.optics.focal_length=600 mm", "instrument.optics.f_number=2.5")
    faster = [word for value in lens for word in ("--set", value)]
    assert main(["requirements", "asteroidfinder", *faster]) == 3
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("aperture")]
    assert line.split() == ["aperture", "0.24", "m", "at", "most", "0.225", "-0.067", "NOT", "MET"]


def test_where_a_formula_refuses_a_scene_the_figures_of_its_channels_stay(capsys):
    """The Sun is too high for a forecast of waves."""
    high = ["--set", "retrieval.waves.sun_zenith=3 deg"]
    assert main(["requirements", "waves", *high]) == 3
    out = capsys.readouterr().out
    assert "no forecast: brightness must follow the slopes of waves" in out.splitlines()[0]
    assert "pixel on the ground" in out
