"""A simulated camera is calibrated from frames of stars, and its parameters are recovered."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.attitude.camera import UNKNOWNS
from startrack.calibration import Calibration, calibrate
from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.core.values import Matches, Status
from startrack.identification import Identification, build_index, identify, identify_blind

NOISE = 0.1


def frames(camera, rng, spots_at, count, stars=60, wrong=0):
    """Spots and matches of random frames, with small errors of the attitudes."""
    spots, matches = [], []
    for _ in range(count):
        pixel = rng.random((stars, 2)) * [camera.columns, camera.rows] - 0.5
        icrs_to_camera = Rotation.from_quat(rng.standard_normal(4))
        direction = icrs_to_camera.inv().apply(camera.unproject(pixel))
        noisy = pixel + NOISE * rng.standard_normal(pixel.shape)
        noisy[:wrong] += 1.5 * rng.standard_normal((wrong, 2))
        start = Rotation.from_rotvec(1e-4 * rng.standard_normal(3)) * icrs_to_camera
        every = np.arange(stars)
        spots.append(spots_at(noisy, NOISE))
        matches.append(Matches(Status.SOLVED, "", every, every, direction, camera, start, 0.0))
    return spots, matches


@pytest.mark.parametrize(
    ("count", "low", "high"),
    [(16, 34.6, 104.7), pytest.param(40, 108, 222, marks=pytest.mark.slow)],
)
def test_errors_are_those_that_the_covariance_says(spots_at, count, low, high):
    """Chi-square of calibrations, four unknowns each; 0.1 % false alarms either way."""
    rng = np.random.default_rng(1)
    truth = Camera(1024, 1024, 4000.0, 6.0, -9.0, k1=-0.2)
    start = Camera(1024, 1024, 4080.0)
    settings = Calibration(floor=0.0)
    total = 0.0
    names = ("focal_length_px", "principal_x", "principal_y", "k1")
    for _ in range(count):
        found = calibrate(*frames(truth, rng, spots_at, 4), start, settings)
        error = np.array([getattr(found.camera, n) - getattr(truth, n) for n in names])
        total += error @ np.linalg.solve(found.covariance[:4, :4], error)
        assert found.residual_rms == pytest.approx(NOISE, rel=0.2)
        assert found.frames == 4
        assert found.stars == 240
    assert low < total < high


def test_all_of_the_distortion_is_found_in_a_wide_field(spots_at):
    rng = np.random.default_rng(2)
    truth = Camera(1024, 768, 900.0, 5.0, 3.0, k1=-0.3, k2=0.1, p1=1e-3, p2=-2e-3, k3=-0.02)
    settings = Calibration(k2=1.0, k3=1.0, tangential=0.01)
    found = calibrate(*frames(truth, rng, spots_at, 6, wrong=3), Camera(1024, 768, 900.0), settings)
    for i, name in enumerate(UNKNOWNS):
        sigma = found.covariance[i, i] ** 0.5
        assert abs(getattr(found.camera, name) - getattr(truth, name)) < 5 * sigma, name


def test_what_is_not_asked_for_stays(spots_at):
    rng = np.random.default_rng(3)
    truth = Camera(512, 512, 1000.0, k1=-0.1)
    start = replace(truth, k1=0.05, focal_length_px=1003.0)
    found = calibrate(*frames(truth, rng, spots_at, 2), start, Calibration(k1=0.0, principal=0.0))
    assert found.camera.k1 == 0.05
    assert found.camera.principal_x == 0.0
    assert found.covariance[3, 3] == 0


def test_a_calibration_of_nothing_is_refused(spots_at):
    camera = Camera(64, 64, 100.0)
    with pytest.raises(ValueError, match="matches must hold a solved frame, got none in 0"):
        calibrate([], [], camera, Calibration())
    with pytest.raises(ValueError, match="matches must be as many as spots"):
        calibrate([spots_at(np.zeros((0, 2)), 1.0)], [], camera, Calibration())
    with pytest.raises(ValueError, match="k1 must not be negative"):
        Calibration(k1=-1.0)


def test_a_distorted_camera_is_calibrated_from_skies(design):
    """From the spots alone, with a focal length 2 % off and unknown distortion."""
    sky = design(12, 6.0)
    truth = replace(sky.camera, k1=-0.3)
    bent = replace(sky, camera=truth)
    rng = np.random.default_rng(4)
    seen = [bent.look(rng, noise=0.05, false=3) for _ in range(8)]
    camera, tolerance = sky.camera.scaled(1.02), 0.05
    for _ in range(2):
        settings = Identification(focal_tolerance=tolerance)
        matches = [identify(s.spots, camera, sky.stars, sky.index, settings) for s in seen]
        found = calibrate([s.spots for s in seen], matches, camera, Calibration(principal=0.0))
        camera, tolerance = found.camera, 0.001
    assert found.residual_rms < 0.1
    assert camera.focal_length_px == pytest.approx(truth.focal_length_px, rel=1e-4)
    assert camera.k1 == pytest.approx(-0.3, abs=5 * found.covariance[3, 3] ** 0.5)


def test_a_camera_of_which_nothing_is_known(design):
    sky = design(12, 6.0)
    rng = np.random.default_rng(5)
    built = {}

    def index_of(camera):
        return built.setdefault(round(camera.fov_x, 6), build_index(sky.stars, camera.fov_x))

    for _ in range(3):
        seen = sky.look(rng, noise=0.1, false=3)
        matches = identify_blind(seen.spots, 1024, 1024, sky.stars, index_of, Identification())
        assert seen.error(matches) < 3
        assert matches.camera.fov_x == pytest.approx(12 * deg, rel=1e-3)
