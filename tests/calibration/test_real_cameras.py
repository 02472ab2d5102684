"""Cameras calibrated from real images, compared with independent values."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.catalog import Selection, open_sky
from startrack.cli.main import main
from startrack.core.units import arcsec, deg
from startrack.detection import Detection, detect
from startrack.identification import Identification, build_index, identify_blind
from startrack.io.images import read_image


def test_the_camera_of_four_images(outside, tmp_path, capsys):
    """The README of the images has a field of 11.433 deg and a radial distortion of +0.1 % at
    the edge."""
    images = sorted(str(path) for path in (outside / "images").glob("esa*.tiff"))
    out = tmp_path / "camera.json"
    assert main(["calibrate", *images, "--fov", "11", "--out", str(out)]) == 0
    found = json.loads(out.read_text())
    assert found["solved"] == len(images)
    assert found["fov_x_deg"] == pytest.approx(11.433, abs=0.004)
    edge = found["camera"]["columns"] / 2 / found["camera"]["focal_length_px"]
    assert found["camera"]["k1"] * edge**2 == pytest.approx(0.001, abs=0.0003)
    assert found["residual_rms_px"] < 0.3
    assert "k1" in capsys.readouterr().out


@pytest.mark.parametrize(
    "name", ["esa_Alt40_Azi45.tiff", pytest.param("cedar_hale_bopp.jpg", marks=pytest.mark.slow)]
)
def test_solved_without_any_field_of_view(outside, name):
    folder = outside / "images"
    truth = json.loads((folder / "truth.json").read_text())["images"][name]
    stars = open_sky(Selection()).stars
    matches = identify_blind(
        detect(read_image(folder / name), Detection()),
        truth["width"],
        truth["height"],
        stars,
        lambda camera: build_index(stars, camera.fov_y),
        Identification(),
    )
    assert matches.icrs_to_camera is not None, matches.reason
    true = Rotation.from_matrix(np.array(truth["R_icrs_to_cam"]))
    x, y, z = matches.icrs_to_camera.apply(true.inv().apply([0.0, 0.0, 1.0]))
    assert np.arctan2(np.hypot(x, y), z) < 60 * arcsec
    assert matches.camera.fov_x == pytest.approx(truth["fov_x_deg"] * deg, rel=0.006)


@pytest.mark.slow
def test_images_that_calibrate_nothing(tmp_path, capsys):
    import cv2

    blank, other = tmp_path / "blank.png", tmp_path / "other.png"
    noise = np.random.default_rng(1).integers(8, 12, (64, 64)).astype(np.uint8)
    cv2.imwrite(str(blank), noise)
    cv2.imwrite(str(other), noise[:32])
    assert main(["calibrate", str(blank), "--fov", "10"]) == 3
    assert main(["calibrate", str(blank), str(other), "--fov", "10"]) == 2
    assert "images must be of one camera" in capsys.readouterr().err
