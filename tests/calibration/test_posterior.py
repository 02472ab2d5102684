import dataclasses

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack.attitude.camera import UNKNOWNS
from startrack.calibration import Calibration, calibrate
from startrack.calibration.posterior import Prior, project, sample_camera
from startrack.core.camera import Camera
from startrack.core.values import Matches, Spots, Status
from startrack.optimise.ensemble import Ensembles

CAMERA_0 = Camera(1024, 1024, 2000.0)
PRIOR = Prior(0.01, 10.0, 0.1, 0.02, 0.02)
SHORT = Ensembles(count=2, stretch=1500, most_steps=6000)


def frame(camera, believed, rng, stars=40, sigma=0.05):
    """Spots of stars spread over a frame, and their matches."""
    pixel = rng.uniform([0, 0], [camera.columns - 1, camera.rows - 1], (stars, 2))
    icrs_to_camera = Rotation.random(rng=rng)
    direction = icrs_to_camera.inv().apply(camera.unproject(pixel))
    noise = np.hypot(sigma, 0.02)
    x, y = (pixel + rng.normal(0, noise, pixel.shape)).T
    covariance = np.tile(sigma**2 * np.eye(2), (stars, 1, 1))
    one = np.ones(stars)
    spots = Spots(x, y, one, covariance, one, one.astype(int))
    near = Rotation.from_rotvec(rng.normal(0, 2e-4, 3)) * icrs_to_camera
    index = np.arange(stars)
    match = Matches(Status.SOLVED, "", index, index, direction, believed, near, 0.0)
    return spots, match


def drawn(rng):
    """A camera of the prior."""
    return dataclasses.replace(
        CAMERA_0,
        focal_length_px=2000 * (1 + 0.01 * rng.standard_normal()),
        principal_x=10 * rng.standard_normal(),
        principal_y=10 * rng.standard_normal(),
        k1=0.1 * rng.standard_normal(),
    )


def test_many_cameras_project_as_each():
    rng = np.random.default_rng(0)
    cameras = [
        dataclasses.replace(drawn(rng), k2=0.2 * rng.standard_normal(), p1=0.01, p2=-0.02, k3=0.1)
        for _ in range(4)
    ]
    direction = CAMERA_0.unproject(rng.uniform(0, 1023, (30, 2)))
    values = np.array([[getattr(one, name) for name in UNKNOWNS] for one in cameras])
    found = project(np.tile(direction, (4, 1, 1)), values, CAMERA_0)
    for one, pixel in zip(cameras, found, strict=True):
        np.testing.assert_allclose(pixel, one.project(direction), atol=1e-9)


@pytest.mark.slow
def test_it_agrees_with_least_squares_where_that_is_right():
    """Many stars: the posterior is normal, with the covariance of Gauss-Newton's fit."""
    rng = np.random.default_rng(2)
    camera = drawn(rng)
    spots, matches = zip(*(frame(camera, CAMERA_0, rng, 60) for _ in range(2)), strict=True)
    posterior = sample_camera(spots, matches, CAMERA_0, PRIOR, 1, SHORT)
    assert posterior.chains.converged, posterior.chains.reason_unconverged
    fitted = calibrate(
        spots, matches, CAMERA_0, Calibration(0.01, 10.0, k1=0.1, floor=0.02, steps=30)
    )
    sigma = np.sqrt(np.diag(fitted.covariance)[:4])
    flat = posterior.chains.flat
    best = [getattr(fitted.camera, name) for name in UNKNOWNS[:4]]
    np.testing.assert_allclose(flat.mean(axis=0), best, atol=0.25 * sigma.max(), rtol=0)
    np.testing.assert_allclose((flat.mean(axis=0) - best) / sigma, 0, atol=0.25)
    np.testing.assert_allclose(flat.std(axis=0), sigma, rtol=0.2)


@pytest.mark.slow
def test_one_narrow_frame_leaves_the_principal_point_open():
    rng = np.random.default_rng(3)
    narrow = Camera(512, 512, 8000.0)
    posterior = sample_camera(
        *zip(frame(narrow, narrow, rng, 15), strict=True), narrow, PRIOR, 1, SHORT
    )
    assert {"principal_x", "principal_y"} <= set(posterior.unconstrained)
    assert "focal_length_px" not in posterior.unconstrained


def test_without_a_frame_there_is_no_posterior():
    with pytest.raises(ValueError, match="4 stars"):
        sample_camera([], [], CAMERA_0, PRIOR, 1)


@pytest.mark.slow
def test_the_ranks_of_the_truth_are_uniform():
    """Simulation-based calibration over 100 cameras of the prior (Talts et al. 2018).

    Chi-square of the ranks in 10 bins for each of four unknowns; false alarm 4 x 2.5e-4 = 1e-3.
    """
    rng = np.random.default_rng(5)
    ranks = []
    for number in range(100):
        camera = drawn(rng)
        posterior = sample_camera(
            *zip(frame(camera, CAMERA_0, rng), strict=True), CAMERA_0, PRIOR, number, SHORT
        )
        truth = [getattr(camera, name) for name in UNKNOWNS[:4]]
        ranks.append((posterior.chains.flat < truth).mean(axis=0))
    counts = np.array([np.histogram(column, 10, (0, 1))[0] for column in np.transpose(ranks)])
    assert (stats.chisquare(counts, axis=1).pvalue > 2.5e-4).all()
