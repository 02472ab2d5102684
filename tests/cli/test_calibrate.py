"""The camera that `calibrate` writes is accepted by `solve` and in a design."""

import json
import math

import pytest

from startrack.cli.main import main
from startrack.cli.terminal import example
from startrack.design import load_design


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """A rendered frame and the camera that was fitted to it."""
    folder = tmp_path_factory.mktemp("calibrate")
    assert main(["simulate", "--ra", "83", "--dec", "-5", "--out", str(folder)]) == 0
    frame, camera = folder / "frame.fits", folder / "camera.toml"
    options = ["--fov", "9.3", "--distortion", "none", "--camera", str(camera)]
    assert main(["calibrate", str(frame), *options]) == 0
    return frame, camera


def test_solve_takes_the_camera(calibrated, capsys):
    frame, camera = calibrated
    assert main(["solve", str(frame), "--camera", str(camera), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    true = load_design(example()).case.instrument.camera
    assert found["fov_x_deg"] == pytest.approx(true.fov_x * 57.29578, rel=2e-4)
    assert found["residual_rms_px"] < 0.2


def test_the_direction_is_that_of_the_middle_and_the_optical_axis_is_said(
    calibrated, tmp_path, capsys
):
    """The camera's axis is moved by 50 columns: the stars rotate with it, the image centre
    stays."""
    frame, camera = calibrated
    moved = tmp_path / "moved.toml"
    lines = camera.read_text().splitlines()
    lines = ["principal_x = 50.0" if line.startswith("principal_x") else line for line in lines]
    moved.write_text("\n".join(lines))
    middle, axis = [], []
    for file in (camera, moved):
        assert main(["solve", str(frame), "--camera", str(file), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        middle.append((found["ra_deg"], found["dec_deg"]))
        axis.append((found["lens"]["ra_deg"], found["lens"]["dec_deg"]))
    assert middle[0] == pytest.approx((83.0, -5.0), abs=0.002)
    assert middle[1] == pytest.approx(middle[0], abs=0.002)
    pixel = found["fov_x_deg"] / found["lens"]["camera"]["columns"]
    apart = math.hypot(*(a - b for a, b in zip(axis[1], middle[1], strict=True)))
    assert apart == pytest.approx(50 * pixel, rel=0.1)
    assert main(["solve", str(frame), "--camera", str(moved)]) == 0
    assert "the optical axis at RA" in capsys.readouterr().out


def test_a_design_takes_the_camera(calibrated, tmp_path):
    path = tmp_path / "design.toml"
    path.write_text(f"{example().read_text()}\n{calibrated[1].read_text()}")
    case = load_design(path).case
    assert case.believed_camera == case.tracker.camera
    assert case.believed_camera.focal_length_px == pytest.approx(
        case.instrument.camera.focal_length_px, rel=2e-4
    )


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        (["--camera", "{camera}", "--fov", "9"], "must not both be given"),
        (["--camera", str(example())], "must have a table [tracker.camera]"),
    ],
)
def test_a_camera_that_cannot_be_used_is_refused(calibrated, options, rule, capsys):
    frame, camera = calibrated
    assert main(["solve", str(frame), *(one.format(camera=camera) for one in options)]) == 2
    assert rule in capsys.readouterr().err


def test_an_image_of_another_size_is_refused(calibrated, tmp_path, capsys):
    frame, camera = calibrated
    other = tmp_path / "other.toml"
    other.write_text(camera.read_text().replace("columns = ", "columns = 1"))
    assert main(["solve", str(frame), "--camera", str(other)]) == 1
    assert "pixels of the camera" in capsys.readouterr().err


@pytest.mark.parametrize("shift", [0, -600])
def test_stars_outside_the_stated_array_are_refused(tmp_path, capsys, shift):
    """An array that is too small, and coordinates from its middle."""
    path = tmp_path / "stars.csv"
    places = [(x, y) for x in range(0, 1200, 200) for y in range(0, 1200, 200)]
    rows = [f"{(x - 600) / 50},{(y - 600) / 50},{x + shift},{y + shift}" for x, y in places]
    path.write_text("\n".join(["x_angle_arcmin,y_angle_arcmin,column,row", *rows]) + "\n")
    size = "1201,1201" if shift else "600,1201"
    assert main(["calibrate", str(path), "--size", size, "--distortion", "none"]) == 2
    assert f"--size must hold all stars of the table, got {size}" in capsys.readouterr().err
    good = [f"--first-pixel={shift},{shift}", "--size", "1201,1201"]
    assert main(["calibrate", str(path), *good, "--distortion", "none"]) == 0
