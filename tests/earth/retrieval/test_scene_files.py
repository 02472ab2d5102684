"""A scene file over another one: merged channels, replaced cameras, and files beside the base."""

from pathlib import Path

import pytest

from startrack.cli.files import SCENE, kind_of
from startrack.core import Refused
from startrack.earth.retrieval import load_earth_design, save_earth_overlay
from startrack.io import shipped

BASE = Path(str(shipped("scenes/hsrs.toml")))


def written(folder, text):
    file = folder / "mine.toml"
    file.write_text(f'base = "scenes/hsrs.toml"\n{text}')
    return file


def test_a_table_with_the_name_of_a_channel_changes_this_channel(tmp_path):
    file = written(tmp_path, "[camera.channels.tir.optics]\nf_number = 2.5\n")
    changed, first = load_earth_design(file), load_earth_design(BASE)
    assert changed == load_earth_design(BASE, ["channels.tir.optics.f_number=2.5"])
    assert changed.camera.channels[0] == first.camera.channels[0]


def test_a_camera_replaces_that_of_the_base(tmp_path):
    file = written(tmp_path, "")
    file.write_text('base = "scenes/sentinel2-msi.toml"\ncamera = "hsrs"\n')
    assert load_earth_design(file).camera == load_earth_design(BASE).camera


def test_a_file_without_the_keys_of_a_scene_is_one_by_its_base(tmp_path):
    assert kind_of(written(tmp_path, '[orbit]\naltitude = "600 km"\n')) is SCENE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[camera.channels.swir.optics]\nf_number = 2.5\n", "camera.channels.swir must be a key"),
        ("[camera.channels.tir.optics]\nf_number = -1\n", "f_number"),
        ('camera = "nothing"\n', "camera must be one of"),
    ],
)
def test_a_message_names_the_overlay(tmp_path, text, message):
    file = written(tmp_path, text)
    with pytest.raises(Refused, match=f"{file}.*{message}"):
        load_earth_design(file)


def test_names_of_rasters_are_from_the_folder_of_their_file(tmp_path):
    (tmp_path / "below").mkdir()
    below = tmp_path / "below" / "scene.toml"
    below.write_text(
        BASE.read_text()
        .replace('highest = "3500 m"', 'highest = "3500 m"\nfiles = ["dem/*.tif"]')
        .replace("[air]", '[[clouds]]\nheight = "2 km"\nfile = "cover.tif"\n\n[air]')
    )
    above = tmp_path / "mine.toml"
    above.write_text('base = "below/scene.toml"\n')
    design = load_earth_design(above)
    assert design.terrain.files == (str(tmp_path / "below" / "dem" / "*.tif"),)
    assert design.clouds[0].file == str(tmp_path / "below" / "cover.tif")


CHANGES = {
    "hsrs": ["channels.*.optics.f_number=2.1", "orbit.altitude=612.3 km"],
    "fields": ["retrieval.land_cover.field=251 m", "channels.B4.detector.exposure=1.7 ms"],
    "mertis": ["campaign.trials=77"],
}


@pytest.mark.parametrize("name", CHANGES)
def test_an_overlay_reads_back_to_its_design(tmp_path, name):
    file, base = tmp_path / "mine.toml", Path(str(shipped(f"scenes/{name}.toml")))
    design = load_earth_design(base, CHANGES[name])
    save_earth_overlay(file, design, base)
    assert load_earth_design(file) == design
    assert file.read_text().startswith(f'base = "scenes/{name}.toml"')
    assert len(file.read_text().splitlines()) < 15
