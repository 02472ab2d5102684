"""`startrack earth`: maps, images, and the messages of wrong use."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import netcdf_file

from startrack.cli.earth import _other_air, _outside, read_scene
from startrack.cli.main import main
from startrack.earth.atmosphere import Air
from startrack.earth.geometry import observe_earth
from startrack.earth.geometry import scene as scene_of_files
from startrack.earth.imager import load_survey
from startrack.io import shipped

pytest.importorskip("sgp4")

PLACE = ("longitude", "latitude")
EXAMPLE = shipped("scenes/mountains.toml").read_text()


def scene(folder: Path, *changes: tuple[str, str]) -> Path:
    text = EXAMPLE.replace("sky_rays = 16", "sky_rays = 0").replace("= 480", "= 40")
    text = text.replace('"20 um"', '"240 um"').replace("cells = 768", "cells = 600")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.slow
def test_the_maps_of_a_scene(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["earth", "geometry", str(scene(tmp_path)), "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["seen"] == 1
    assert 0.01 < result["shadow"] < 0.5
    assert max(result["levels"]) >= 2
    with netcdf_file(out / "geometry.nc", mmap=False) as file:
        height, longitude = file.variables["height"][:], file.variables["longitude"][:]
        assert file.variables["height"].units == b"m"
        assert file.variables["latitude"].units == b"degree"
    assert height.shape == (40, 40)
    assert result["height_m"] == pytest.approx([height.min(), height.max()])
    assert abs(longitude.mean() - 10) < 0.05
    assert (out / "geometry.png").stat().st_size > 10_000


@pytest.fixture
def undrawn(monkeypatch):
    """Without the picture of the maps, which would take most of the time."""
    monkeypatch.setattr("startrack.plots.draw_geometry", lambda *_: None)


@pytest.mark.slow
@pytest.mark.parametrize("detector", ["matrix", "staggered", "tdi"])
def test_other_detectors_see_the_same_mountains(undrawn, tmp_path, capsys, detector):
    path = scene(tmp_path, ('"line"', f'"{detector}"'))
    assert main(["earth", "geometry", str(path), "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["seen"] == 1
    assert 1000 < result["height_m"][1] <= 3000


def test_a_camera_that_drifts_sees_other_ground(undrawn, tmp_path, capsys):
    """A roll of 1e-3 rad/s moves the ground by the angle times the distance, but not at the
    epoch."""
    places = []
    for motion in ("", '\n[motion]\nrate_y = "1e-3 rad/s"\n'):
        path = scene(tmp_path, ('"3000 m"', '"1 m"'), ('roll = "5 deg"', 'roll = "0 deg"'))
        path.write_text(path.read_text() + motion)
        assert main(["earth", "geometry", str(path), "--out", str(tmp_path), "--json"]) == 0
        capsys.readouterr()
        with netcdf_file(tmp_path / "geometry.nc", mmap=False) as file:
            places.append([np.radians(file.variables[name][:, 20]) for name in PLACE])
    (lon, lat), (moved_lon, moved_lat) = places
    shift = 6.371e6 * np.hypot(moved_lat - lat, (moved_lon - lon) * np.cos(lat))
    sensor = read_scene(path)[0].sensor
    time = sensor.dating(read_scene(path)[0].carrier).at(np.arange(40.0))
    np.testing.assert_allclose(shift, 1e-3 * np.abs(time) * 600e3, rtol=0.03, atol=0.1)


def test_a_matrix_is_the_same_in_one_piece_and_row_by_row(tmp_path, monkeypatch):
    """With three rays along each side, the order of rows, columns and rays is the same."""
    path = scene(tmp_path, ('"line"', '"matrix"'), ("columns = 40", "columns = 40\nrays = 3"))
    whole = list(observe_earth(read_scene(path)[0], tmp_path))
    monkeypatch.setattr(scene_of_files, "BATCH", 1)
    rows = list(observe_earth(read_scene(path)[0], tmp_path))
    assert [len(whole), len(rows)] == [1, 40]
    for name in PLACE:
        one = whole[0].mean(getattr(whole[0].ground, name))
        each = [strip.mean(getattr(strip.ground, name))[0] for strip in rows]
        np.testing.assert_array_equal(one, each)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (('"5 deg"', '"5 m"'), "pointing.roll must have a unit that converts to rad"),
        (("cells = 600", "cellls = 600"), "terrain.fractal.cellls is unknown"),
        (('"line"', '"lines"'), "sensor.detector must be one of matrix, line, staggered, tdi"),
        (("[orbit]", 'tle = ["1", "2"]\n[orbit]'), "one of orbit, tle and aircraft must be given"),
        (('"600 km"', '"60 km"'), "perigee above 80 km"),
        (("[orbit]", "[motion]\nrate = 1\n[orbit]"), "motion.rate is unknown"),
    ],
)
def test_a_wrong_scene_is_wrong_use(tmp_path, capsys, change, sentence):
    assert main(["earth", "geometry", str(scene(tmp_path, change)), "--out", str(tmp_path)]) == 2
    assert sentence in capsys.readouterr().err


def test_files_that_are_not_there(tmp_path, capsys):
    text = EXAMPLE[: EXAMPLE.index("[terrain.fractal]")] + 'files = ["dem/*.tif"]\n'
    path = tmp_path / "scene.toml"
    path.write_text(text)
    assert main(["earth", "geometry", str(path), "--out", str(tmp_path / "out")]) == 1
    assert "must name files, but there are none" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(["earth", "geometry", str(tmp_path / "none.toml")]) == 2
    assert "must be a scene file, or one of" in capsys.readouterr().err


def test_terrain_files_are_listed_and_can_be_flown_over(undrawn, tmp_path, capsys):
    """A scene file accepts the output of `terrain`."""
    pytest.importorskip("rasterio")
    from startrack.core.streams import Streams
    from startrack.earth.terrain import Grid, fractal
    from tests.earth.terrain.test_raster import write

    step = np.radians(8 / 3600)
    grid = Grid(np.radians(9.7), np.radians(47.3), step, step, 301, 301)
    write(tmp_path / "dem.tif", fractal(301, 301, Streams(1, 0), 1000.0), grid)
    assert main(["earth", "terrain", str(tmp_path / "*.tif")]) == 0
    listed = capsys.readouterr().out
    assert "301 x 301 cells" in listed
    table = listed[listed.index("[terrain]") : listed.index("#")]
    path = scene(tmp_path)
    head = path.read_text()
    path.write_text(head[: head.index("[terrain]")] + table)
    assert main(["earth", "geometry", str(path), "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["height_m"][1] <= 1000
    assert result["beside_terrain"] == 0
    assert main(["earth", "terrain", str(tmp_path / "scene.toml")]) == 2
    assert "must be a raster file of GDAL's GTiff" in capsys.readouterr().err
    wrong = np.full((301, 301), -32768.0, np.float32)
    write(tmp_path / "wrong.tif", wrong, grid)
    assert main(["earth", "terrain", str(tmp_path / "wrong.tif")]) == 0
    assert "some may not be heights of the Earth" in capsys.readouterr().out


def test_set_replaces_values_of_a_scene_with_and_without_a_camera(undrawn, tmp_path, capsys):
    few = ["--out", str(tmp_path), "--json"]
    for scene, keys in (
        ("hsrs", ("lines", "columns")),
        ("mountains", ("sensor.lines", "sensor.columns")),
    ):
        changes = [word for key in keys for word in ("--set", f"{key}=4")]
        assert main(["earth", "geometry", scene, *changes, *few]) == 0
        result = json.loads(capsys.readouterr().out)
        assert (result["lines"], result["columns"]) == (4, 4)
    assert main(["earth", "render", "hsrs", "--set", "orbit.altitud=600 km"]) == 2
    assert "orbit.altitud must be a parameter" in capsys.readouterr().err


def test_a_scene_without_a_camera_has_the_default_sensor(undrawn, tmp_path, capsys):
    text = shipped("scenes/mountains.toml").read_text()
    path = tmp_path / "scene.toml"
    path.write_text(text[: text.index("[sensor]")] + text[text.index("[terrain]") :])
    few = ["--set", "sensor.lines=2", "--set", "sensor.columns=2", "--out", str(tmp_path), "--json"]
    assert main(["earth", "geometry", str(path), *few]) == 0
    assert json.loads(capsys.readouterr().out)["lines"] == 2


def test_bands_outside_the_spectrum_are_named(undrawn, tmp_path, capsys):
    assert main(["earth", "spectrum", "hsrs", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.startswith("without a rectangle: mir, tir, not within 400 to 1000 nm")
    assert main(["earth", "spectrum", "sentinel2-msi", "--out", str(tmp_path)]) == 0
    assert "without a rectangle: B10, B11, B12, not within" in capsys.readouterr().out


def test_the_geometry_of_a_scene_with_channels_is_that_of_the_first(undrawn, tmp_path, capsys):
    """Four pixels of two lines of HSRS see the mountains of its scene."""
    text = shipped("scenes/hsrs.toml").read_text()
    rows = [row for row in text.splitlines() if not row.startswith(("lines", "columns"))]
    path = tmp_path / "scene.toml"
    path.write_text("\n".join(["lines = 2", "columns = 4", *rows]))
    assert main(["earth", "geometry", str(path), "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["lines"], result["columns"], result["seen"]) == (2, 4, 1.0)


def test_a_scene_that_misses_its_terrain_says_so(undrawn, tmp_path, capsys):
    """The terrain lies 25 degrees east of the place at which the camera looks."""
    path = scene(tmp_path, ('longitude = "10 deg"', 'longitude = "35 deg"'))
    assert main(["earth", "geometry", str(path), "--out", str(tmp_path)]) == 0
    assert "100 % of the visible ground has no heights" in capsys.readouterr().out


def test_output_of_modtran_becomes_a_table_that_a_scene_names(tmp_path, capsys):
    """Two runs of a minimal layout; each error is one sentence, with exit status 2."""
    for name, albedo in (("a.csv", 0.1), ("b.csv", 0.5)):
        lines = ["FREQ,TOT_TRANS,THRML_EM,SOL_SCAT,GRND_RFLT,DRCT_RFLT,TOTAL_RAD"]
        lines += [
            f"{place},0.9,0,0.1,{0.4 * albedo},{0.3 * albedo},1" for place in range(500, 601, 10)
        ]
        (tmp_path / name).write_text("\n".join(lines) + "\n")
    out = tmp_path / "air.csv"
    runs = ["earth", "air", str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), "--unit", "nm"]
    more = ["--albedo", "0.1", "0.5", "--out", str(out)]
    assert main([*runs, *more, "--sun-zenith", "30"]) == 0
    assert main([*runs, *more, "--sun-zenith", "50", "--add"]) == 0
    assert "11 wavelengths from 0.5 to 0.6 um" in capsys.readouterr().out
    assert len(out.read_text().splitlines()) == 23
    for wrong, words in (
        (["--albedo", "0", "0.5"], "albedos must be two different numbers"),
        (["--sun-zenith", "95", "--out", str(tmp_path / "c.csv")], "column sun_zenith"),
        (["--azimuth", "0", "--add", "--out", str(out)], "must have the columns"),
    ):
        assert main([*runs, *more, *wrong]) == 2
        assert words in capsys.readouterr().err
    assert not (tmp_path / "c.csv").exists()
    assert main([*runs[:3], str(tmp_path / "none.tp7"), *runs[4:], *more]) == 2


def test_an_infrared_band_says_that_its_aerosol_is_not_that_of_the_scene():
    survey = load_survey(shipped("scenes/hsrs.toml"))
    assert _other_air(survey, survey.channels[0]) == {}
    hazy = replace(survey, air=Air("urban", 40e3))
    assert _other_air(hazy, hazy.channels[0]) == {"aerosol_not_used": "urban, 40 km"}


def test_a_hot_spot_outside_the_image_is_named():
    """An image of 2 degrees across the date line, turned by 45 degrees."""
    line, column = np.mgrid[0:9, 0:9] / 8 - 0.5
    longitude = (180 + column - line + 180) % 360 - 180
    latitude = column + line
    places = [(math.radians(x), math.radians(y)) for x, y in ((-179.9, 0.1), (179.2, 0.9), (0, 0))]
    assert _outside(places, longitude, latitude) == [1, 2]
    assert _outside(places[:1], np.full((9, 9), np.nan), latitude) == []
