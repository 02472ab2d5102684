"""Spots in the image plane of the believed camera, against the camera itself."""

import numpy as np
import pytest

from startrack.core.camera import Camera
from startrack.core.values import Spots
from startrack.identification import Identification
from startrack.identification.seen import keep_brightest, see, usable

FOCAL = 1500.0
CAMERA = Camera(1024, 768, FOCAL, 7.0, -4.0)
PIXEL = np.array([[3.0, 700.0], [518.5, 379.5], [900.25, 12.0], [400.0, 500.0]])
SETTINGS = Identification()


def spots(covariance=0.04, flux=(400.0, 100.0, 10.0, 1.0), snr=(40.0, 20.0, 10.0, 5.0)) -> Spots:
    matrices = np.multiply.outer(np.broadcast_to(covariance, 4), np.eye(2))
    return Spots(*PIXEL.T, np.array(flux), matrices, np.array(snr), np.ones(4, int))


def seen(one=None, camera=CAMERA, chosen=(0, 1, 2, 3), **settings):
    return see(one or spots(), np.array(chosen), camera, Identification(**settings))


@pytest.mark.parametrize("distortion", [{}, {"k1": -0.1, "p1": 1e-3}])
def test_directions_are_the_cameras(distortion):
    camera = Camera(1024, 768, FOCAL, 7.0, -4.0, **distortion)
    got = seen(camera=camera, chosen=(2, 0))
    wanted = camera.unproject(PIXEL[[2, 0]])
    np.testing.assert_allclose(got.direction, wanted, atol=1e-12)
    np.testing.assert_allclose(got.plane, wanted[:, :2] / wanted[:, 2:], atol=1e-12)


def test_the_image_ends_at_the_outer_edges_of_its_pixels():
    got = seen()
    corners = CAMERA.unproject(
        np.array([[-0.5, -0.5], [1023.5, 767.5], [-0.5, 767.5], [1023.5, -0.5]])
    )
    plane = corners[:, :2] / corners[:, 2:]
    np.testing.assert_allclose(got.low, plane[0], rtol=1e-12)
    np.testing.assert_allclose(got.high, plane[1], rtol=1e-12)
    assert got.corner == pytest.approx(np.arccos(corners[:, 2]).max(), rel=1e-9)
    assert got.area == pytest.approx(1024 * 768 / FOCAL**2)


def test_noise_is_the_mean_over_both_axes_within_limits():
    one = spots()
    one.covariance[:] = [
        np.diag([0.01, 0.07]),
        np.diag([1e-9, 0]),
        np.diag([90, 90]),
        np.full((2, 2), np.nan),
    ]
    np.testing.assert_allclose(seen(one).sigma * FOCAL, [0.2, 0.01, 2.0, 2.0])


def test_the_match_radius_is_at_least_three_sigma_of_the_verifying_spots():
    assert seen().radius * FOCAL == pytest.approx(2.0)
    noisy = spots(covariance=[1.0, 1.0, 4.0, 4.0])
    assert seen(noisy).radius * FOCAL == pytest.approx(3 * 1.5)
    assert seen(noisy, verify_spots=4, match_radius=9.0).radius * FOCAL == pytest.approx(9.0)
    matrices = np.eye(2) * np.repeat([1.0, 4.0, 4.0], 4)[:, None, None]
    ones = np.ones(12)
    twelve = Spots(*np.tile(PIXEL, (3, 1)).T, ones, matrices, ones, ones.astype(int))
    many = see(twelve, np.arange(12), CAMERA, Identification(verify_spots=4))
    assert many.radius * FOCAL == pytest.approx(3.0)
    assert many.excess * FOCAL == pytest.approx(2.0)


def test_magnitudes_and_their_errors():
    """A flux 100 times as large is five magnitudes; one per cent of flux is 0.010857 magnitude."""
    got = seen(spots(flux=(400.0, 4.0, -1.0, np.inf), snr=(100.0, 50.0, 0.0, 10.0)))
    assert got.magnitude[1] - got.magnitude[0] == pytest.approx(5.0)
    assert np.isnan(got.magnitude[2:]).all()
    np.testing.assert_allclose(got.blur, [0.010857, 0.021715, np.inf, 0.10857], rtol=1e-4)
    assert np.isnan(seen(spots(flux=(0.0, 1.0, 1.0, 1.0))).magnitude[0])


def test_the_first_are_cut_from_all_arrays_and_the_image_stays():
    every, few = seen(focal_tolerance=0.02), keep_brightest(seen(focal_tolerance=0.02), 2)
    for name, value in few._asdict().items():
        whole = getattr(every, name)
        np.testing.assert_array_equal(
            value, whole[:2] if np.shape(whole) and len(whole) == 4 else whole
        )
    assert few.focal == 0.02


def test_spots_without_a_finite_position_are_not_usable():
    one = spots()
    one.x[1], one.y[3] = np.nan, np.inf
    assert usable(one).tolist() == [0, 2]
