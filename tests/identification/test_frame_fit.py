"""Frames of a calibrated camera from the ground: refraction, and errors shared by neighbours."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.attitude import SolverSettings, solve
from startrack.core import Camera, FieldPolynomial, Matches, Status, arcsec, deg
from startrack.identification import fit_frame
from tests.identification.conftest import make_spots

NOISE = 0.1  # pixel
CAMERA = Camera(
    1280, 960, 2659.0, 25.7, -44.8, k1=-0.0465, k2=0.667, p1=1e-3,
    polynomial=FieldPolynomial((0.0, 0.0, 2e-3), (1e-3,)),
)  # fmt: skip
MIDDLE = np.array([[639.5, 479.5]])


def lifted(apparent, zenith):
    """True directions of apparent ones: R = 58.3 arcsec tan z, z the apparent zenith distance."""
    up = apparent @ zenith
    across = np.cross(apparent, zenith)
    angle = 58.3 * arcsec * np.linalg.norm(across, axis=1) / up  # tan z
    axis = across / np.linalg.norm(across, axis=1)[:, None]
    return Rotation.from_rotvec(-axis * angle[:, None]).apply(apparent)


def frame(rng, count=90, zenith_deg=None, smooth=0.0):
    """Spots and matches of a frame in the camera's axes, and the direction of its middle.

    zenith_deg  distance of the zenith; None: there is no air
    smooth      pixel rms, errors that are quadratic over the frame
    """
    place = rng.uniform(0, [1279, 959], (count, 2))
    every = np.vstack([place, MIDDLE])
    true = CAMERA.unproject(every)
    if zenith_deg is not None:
        turn = rng.uniform(0, 2 * np.pi)
        z = zenith_deg * deg
        true = lifted(
            true, np.array([np.sin(z) * np.cos(turn), np.sin(z) * np.sin(turn), np.cos(z)])
        )
    u, v = (every / [640, 480] - 1).T
    terms = np.column_stack([u * u, u * v, v * v, u**3, u * u * v])
    wrong = terms @ rng.normal(0, smooth, (5, 2))
    spots = make_spots(place + wrong[:-1] + rng.normal(0, NOISE, place.shape), NOISE)
    start = Rotation.from_rotvec(rng.normal(0, 2e-4, 3))
    index = np.arange(count)
    return (
        spots,
        Matches(Status.SOLVED, "", index, index, start.inv().apply(true[:-1]), CAMERA, start, 0.0),
        start.inv().apply(true[-1]),
    )


def normalised(lens, middle):
    """Error of the axis (pixel), and the error over its sigma, for two axes."""
    x, y, _ = lens.icrs_to_image.apply(middle)
    sigma = np.sqrt(lens.covariance.diagonal())
    return np.hypot(x, y) * 2659, np.hypot(x / sigma[1], y / sigma[0])


def test_refraction_of_the_air_is_estimated_and_the_middle_is_right():
    rng = np.random.default_rng(3)
    for zenith in (50, 65):
        spots, matches, middle = frame(rng, zenith_deg=zenith)
        lens = fit_frame(spots, matches)
        error, over = normalised(lens, middle)
        assert error < 0.3  # what is beyond the first derivative is left
        assert over < 1.3  # and stated
        grid = lens.matches.camera.polynomial
        squeeze = np.hypot(grid.x[1] - grid.y[2], grid.x[2] + grid.y[1] - 2e-3)
        # Smart, section 35: along the vertical by sec^2 z, along the horizon by 1.
        assert squeeze == pytest.approx(58.3 * arcsec * np.tan(zenith * deg) ** 2, rel=0.35)
        seen = lens.matches.camera.project(lens.matches.icrs_to_camera.apply(matches.direction))
        apart = seen - np.column_stack([spots.x, spots.y])
        assert lens.residual_rms == pytest.approx(np.sqrt(np.mean(apart**2)), rel=0.02)


def test_a_frame_without_air_keeps_the_camera():
    spots, matches, middle = frame(np.random.default_rng(4))
    lens = fit_frame(spots, matches)
    assert lens.matches.camera == CAMERA
    assert normalised(lens, middle)[0] < 0.05


@pytest.mark.parametrize("count", [5, 8, 90])
def test_the_error_that_neighbours_share_is_stated(count):
    """A smooth calibration error of 0.15 pixel does not average out over the stars."""
    rng, over, before = np.random.default_rng(5), [], []
    for _ in range(25):
        spots, matches, middle = frame(rng, count, smooth=0.15)
        over.append(normalised(fit_frame(spots, matches), middle)[1])
        usual = solve(spots, matches, SolverSettings())
        axis = usual.icrs_to_camera.apply(middle)
        seen = CAMERA.unproject(MIDDLE)[0]
        before.append(
            np.hypot(*(axis - seen)[:2]) / np.sqrt(np.trace(usual.covariance[:2, :2]) / 2)
        )
    assert np.median(before) > 2 or count < 90  # what independent errors would state
    assert np.median(over) < 1.18
    assert np.percentile(over, 95) < 2.45
