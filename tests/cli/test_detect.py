"""`startrack detect` from its arguments to its table, JSON and picture."""

import json
import warnings

import cv2
import numpy as np
import pytest
from astropy.io import fits

from startrack.cli.main import main
from startrack.core.streams import Streams
from startrack.plots import style


@pytest.fixture
def image(tmp_path, sky):
    light = sky((200, 300), np.array([50.2, 200.7]), np.array([60.4, 150.1]), 8000.0, 1.0) + 40
    path = tmp_path / "sky.png"
    cv2.imwrite(str(path), Streams(1, 0)("shot noise").poisson(light).astype(np.uint16))
    return path


def test_table_json_and_overlay(image, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(style, "DPI", 200)  # as users get them
    assert main(["detect", str(image)]) == 0
    table = capsys.readouterr().out.splitlines()
    assert table[0].startswith(f"{image}: 2 spots; noise alone makes")
    assert len(table) == 4
    arguments = ["detect", str(image), "--json", "--overlay", str(tmp_path / "drawn")]
    assert main([*arguments, "--centroid", "gaussian"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert sorted(spot["x"] for spot in found["spots"]) == pytest.approx([50.2, 200.7], abs=0.05)
    assert cv2.imread(found["overlay"]).shape[1] > 500


def test_an_image_that_is_saturated_says_so(tmp_path, capsys):
    """Images of which all, a tenth, or none of the pixels are saturated."""
    noise = np.random.default_rng(1).integers(90, 110, (100, 100)).astype(np.uint8)
    for rows, words in (
        (100, "all pixels have the number 255"),
        (10, "10% of the pixels"),
        (0, ""),
    ):
        picture = noise.copy()
        picture[:rows] = 255
        cv2.imwrite(str(tmp_path / "sky.png"), picture)
        assert main(["detect", str(tmp_path / "sky.png")]) == 0
        out = capsys.readouterr().out
        assert ("saturated" in out) == (rows > 0)
        assert words in out


def test_an_image_that_is_saturated_says_so_beside_pixels_without_a_number(tmp_path, capsys):
    """One of four rows has no number; one of the other three has the largest number."""
    picture = np.random.default_rng(1).normal(100, 5, (100, 100)).astype(np.float32)
    picture[:25], picture[25:50] = np.nan, 4095
    path = tmp_path / "sky.fits"
    fits.PrimaryHDU(picture).writeto(path)
    assert main(["detect", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["at_the_largest_number"] == pytest.approx(1 / 3)
    assert main(["detect", str(path)]) == 0
    assert "33% of the pixels have the largest number, 4095: saturated" in capsys.readouterr().out


def test_what_all_images_have_is_said_once(sky, tmp_path, capsys):
    """Pictures set filters of warnings, after which Python would repeat a warning."""
    light = sky((40, 40), np.array([20.2]), np.array([19.4]), 9000.0, 2.0) + 40
    paths = [str(tmp_path / f"{number}.fits") for number in range(3)]
    for path in paths:
        fits.PrimaryHDU(light.astype(np.int16), fits.Header({"BAYERPAT": "RGGB"})).writeto(path)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        assert main(["detect", *paths, "--overlay", str(tmp_path / "drawn")]) == 0
    found = capsys.readouterr()
    assert found.out.count("1 spot") == 3
    assert found.err.count("mosaic of colours (RGGB)") == 1


def test_settings_of_a_design(image, capsys):
    from startrack.cli.terminal import example

    arguments = ["detect", str(image), "--json", "--design", str(example())]
    assert main([*arguments, "--centroid", "likelihood", "--sigma", "1"]) == 0
    assert len(json.loads(capsys.readouterr().out)["spots"]) == 2


def test_wrong_images_and_settings_have_a_message(image, tmp_path, capsys):
    assert main(["detect", str(image), "--centroid", "best"]) == 2
    assert "centroid must be one of" in capsys.readouterr().err
    assert main(["detect", str(image), "--sigma", "0"]) == 2
    assert "--sigma must lie in [0.3, 10], got 0.0" in capsys.readouterr().err
    assert main(["detect", str(tmp_path / "none.png"), str(image), "--json"]) == 1
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (first["status"], second["status"]) == ("failed", "done")
    assert main(["detect", str(image), "--flat", str(tmp_path / "none.png")]) == 2
    assert main(["detect", str(image), "--false", "0.05", "--threshold", "8"]) == 2
    assert "--threshold must come without --false" in capsys.readouterr().err


def test_a_threshold_replaces_the_false_spots_of_a_design(image, capsys):
    from startrack.cli.terminal import example

    arguments = ["detect", str(image), "--json", "--design", str(example())]
    limits = []
    for more in ([], ["--set", "tracker.detection.false_per_frame=1"]):
        assert main([*arguments, *more, "--threshold", "7"]) == 0
        limits.append(json.loads(capsys.readouterr().out)["expected_false"])
    assert limits[0] == limits[1] < 1e-3
