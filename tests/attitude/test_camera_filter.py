"""A camera calibrated frame by frame, compared with the Cramér-Rao bound of all frames at once."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.attitude import CameraFilter, after_frame, attitude_doubt, first_camera
from startrack.attitude.camera import UNKNOWNS, Calibration, MatchedFrame, camera_vector
from startrack.core import Camera, Displacement, Matches, Spots, Status, node_places

DESIGN = Camera(1024, 1024, 1500.0)
TRUTH = replace(DESIGN, focal_length_px=1502.5, principal_x=4.0, principal_y=-3.0, k1=0.06)
PRIOR = Calibration(focal_length=0.003, principal=6.0, k1=0.1, floor=0.0)
FREE = [0, 1, 2, 3]
NOISE, STARS = 0.05, 12  # pixel
SMALL = 1e-4  # of finite differences


def frame(rng, camera: Camera, stars: int = STARS):
    """Stars on a camera, and their matches by a tracker with an attitude error."""
    pixel = rng.uniform(20, 1004, (stars, 2))
    direction = camera.unproject(pixel)
    attitude = Rotation.from_rotvec(rng.normal(0, 1, 3))
    seen = pixel + rng.normal(0, NOISE, pixel.shape)
    covariance = np.tile(NOISE**2 * np.eye(2), (stars, 1, 1))
    spots = Spots(*seen.T, np.ones(stars), covariance, np.full(stars, 50.0), np.ones(stars, int))
    believed = Rotation.from_rotvec(rng.normal(0, 3e-4, 3)) * attitude
    order = np.arange(stars)
    matches = Matches(
        Status.SOLVED, "", order, order, attitude.inv().apply(direction), camera, believed, -30.0
    )
    return spots, matches, direction


def information(directions) -> np.ndarray:
    """Information (4, 4) of the camera's unknowns, by finite differences and all attitudes at
    once."""
    total = np.diag(PRIOR.sigma(DESIGN)[FREE] ** -2.0)
    for direction in directions:
        columns = []
        for number in FREE:
            sides = []
            step = SMALL * max(abs(camera_vector(TRUTH)[number]), 1.0)
            for sign in (1, -1):
                changed = camera_vector(TRUTH)[number] + sign * step
                sides.append(replace(TRUTH, **{UNKNOWNS[number]: changed}).project(direction))
            columns.append((sides[0] - sides[1]).ravel() / 2 / step)
        for axis in np.eye(3):
            sides = [
                TRUTH.project(Rotation.from_rotvec(sign * SMALL * axis).apply(direction))
                for sign in (1, -1)
            ]
            columns.append((sides[0] - sides[1]).ravel() / 2 / SMALL)
        rows = np.column_stack(columns) / NOISE
        whole = rows.T @ rows
        cross = whole[:4, 4:]
        total += whole[:4, :4] - cross @ np.linalg.solve(whole[4:, 4:], cross.T)
    return total


def error(camera: Camera) -> np.ndarray:
    return (camera_vector(camera) - camera_vector(TRUTH))[FREE]


@pytest.mark.parametrize("frames", [50, pytest.param(1000, marks=pytest.mark.slow)])
def test_the_error_is_that_of_the_bound(frames):
    """Squared error over the bound, for 4 cameras with 4 unknowns: 1 within 0.35 (1 sigma)."""
    rng, settings, squares = np.random.default_rng(frames), CameraFilter(PRIOR), []
    for unit in range(4):
        known, directions = first_camera(DESIGN, settings), []
        for _ in range(frames):
            spots, matches, direction = frame(rng, TRUTH)
            known = after_frame(known, settings, spots, matches)
            directions.append(direction)
        bound = information(directions)
        squares.append(error(known.camera) @ bound @ error(known.camera) / 4)
        if not unit:
            stated = known.covariance[np.ix_(FREE, FREE)]
            np.testing.assert_allclose(
                np.linalg.inv(stated), bound, rtol=0.03, atol=1e-3 * bound.max()
            )
    assert np.mean(squares) < 2.4


def test_a_map_takes_up_what_the_distortion_leaves():
    """A smooth distortion of 0.1 pixel rms that no polynomial fits, with a map of 6 x 6 nodes.

    It is compared with the same filter without a map, by the residuals of fresh stars without their
    rotation.
    """
    rng, wave = np.random.default_rng(8), 2 * np.pi / 700

    def field(pixel):
        x, y = pixel.T
        return 0.14 * np.column_stack([np.sin(wave * y) * np.cos(wave * x), np.sin(wave * x)])

    value = field(node_places(1024, 1024)).T.ravel()
    truth = replace(DESIGN, residual=Displacement(1024, 1024, tuple(value.tolist())))
    left = {}
    for nodes in (0, 6):
        settings = CameraFilter(PRIOR, map=nodes, map_sigma=0.2)
        known = first_camera(DESIGN, settings)
        for _ in range(120):
            spots, matches, _ = frame(rng, truth)
            known = after_frame(known, settings, spots, matches)
        pixel = rng.uniform(20, 1004, (400, 2))
        seen, believed = truth.unproject(pixel), known.camera.unproject(pixel)
        turn, _ = Rotation.align_vectors(seen, believed)
        apart = DESIGN.project(turn.apply(believed)) - DESIGN.project(seen)
        left[nodes] = np.sqrt(np.mean(apart**2))
    assert left[0] > 0.06
    assert left[6] < 0.3 * left[0]


@pytest.mark.parametrize("nodes", [pytest.param(0, marks=pytest.mark.slow), 3])
def test_the_attitude_states_what_is_not_known_of_the_camera(nodes):
    """Normalised squared errors of 180 cameras drawn from the prior, 20 stars each: 3 within 0.3
    (1 sigma)."""
    rng, settings = np.random.default_rng(9), CameraFilter(PRIOR, map=nodes, map_sigma=0.3)
    known, squares = first_camera(DESIGN, settings), []
    for _ in range(180):
        step = settings.sigma(DESIGN) * rng.standard_normal(16 + 2 * nodes**2)
        spots, matches, direction = frame(rng, known.moved(step).camera, 20)
        block = MatchedFrame(spots, matches)
        for _ in range(3):
            normal = block.normal(DESIGN, np.arange(0), 0.0)
            block.turn(normal.attitude(np.zeros(0)))
        true = Rotation.align_vectors(direction, matches.direction)[0]
        wrong = (block.icrs_to_camera * true.inv()).as_rotvec()
        doubt = attitude_doubt(known, settings, spots, matches)
        squares.append(wrong @ np.linalg.solve(normal.inverse + doubt, wrong))
    assert np.mean(squares) == pytest.approx(3, abs=0.75)
    few = replace(
        matches, spot=matches.spot[:2], direction=matches.direction[:2], star=matches.star[:2]
    )
    assert not attitude_doubt(known, settings, spots, few).any()


def test_slopes_with_temperature_are_found():
    """Focal length and principal point that follow the temperature of an orbit."""
    rng = np.random.default_rng(5)
    settings = CameraFilter(PRIOR, focal_length_slope=5e-5, principal_slope=0.05)
    known = first_camera(DESIGN, settings)
    for k in range(200):
        warmer = 30 * np.sin(k / 15)
        camera = replace(
            TRUTH,
            focal_length_px=TRUTH.focal_length_px * (1 + 3e-5 * warmer),
            principal_x=TRUTH.principal_x + 0.02 * warmer,
        )
        spots, matches, _ = frame(rng, camera)
        known = after_frame(known, settings, spots, matches, 1.0, warmer)
    sigma = np.sqrt(np.diag(known.covariance)[8:11])
    true = np.array([3e-5 * TRUTH.focal_length_px, 0.02, 0.0])
    assert (np.abs(known.slope[:3] - true) < 4 * sigma).all()
    # Of a line through points at temperatures of mean zero: that of its middle over their rms; k1,
    # with which the focal length shares its error, has no slope.
    held = 1 / np.sqrt(np.linalg.inv(known.covariance[:4, :4])[0, 0])
    alone = held / np.sqrt(np.mean((30 * np.sin(np.arange(200) / 15)) ** 2))
    assert sigma[0] == pytest.approx(alone, rel=0.25)


def test_a_launch_shift_is_followed():
    """A filter whose principal point is a random walk follows a step of a pixel."""
    rng = np.random.default_rng(6)
    settings = CameraFilter(PRIOR, principal_walk=0.1)
    known, shifted = first_camera(DESIGN, settings), replace(TRUTH, principal_x=5.0)
    for k in range(300):
        spots, matches, _ = frame(rng, TRUTH if k < 100 else shifted)
        known = after_frame(known, settings, spots, matches, 1.0)
    sigma = np.sqrt(known.covariance[1, 1])
    assert known.camera.principal_x == pytest.approx(shifted.principal_x, abs=4 * sigma)
    assert sigma < 0.5


def test_a_map_of_one_node_is_refused():
    with pytest.raises(ValueError, match="map must be 0 or at least 2, got 1"):
        CameraFilter(map=1)


def test_false_matches_move_it_little():
    rng, settings = np.random.default_rng(7), CameraFilter(PRIOR)
    clean = dirty = first_camera(DESIGN, settings)
    for _ in range(100):
        spots, matches, _ = frame(rng, TRUTH)
        clean = after_frame(clean, settings, spots, matches)
        x = spots.x.copy()
        x[0] += rng.normal(0, 20)
        dirty = after_frame(dirty, settings, replace(spots, x=x), matches)
    plain = np.sqrt(np.diag(clean.covariance)[FREE])
    assert (np.abs(error(dirty.camera)) < 6 * plain).all()
    few = replace(
        matches, spot=matches.spot[:2], star=matches.star[:2], direction=matches.direction[:2]
    )
    assert after_frame(clean, settings, spots, few).camera == clean.camera
