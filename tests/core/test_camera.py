import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from startrack.core.camera import Camera

LENS = Camera(1024, 768, 1000.0, 12.3, -4.0, k1=-0.1, k2=0.02, p1=1e-3, p2=-2e-3, k3=0.001)


def test_boresight_falls_on_the_centre_of_an_even_array():
    """The centre of 4 x 2 pixels is (1.5, 0.5), between pixels, because the first centre is (0,
    0)."""
    assert Camera(4, 2, 10.0).project(np.array([[0, 0, 1.0]])).tolist() == [[1.5, 0.5]]


def test_signs():
    """+x goes to larger columns, +y to larger rows."""
    camera = Camera(100, 100, 50.0)
    right, down = camera.project(np.array([[0.1, 0, 1], [0, 0.1, 1]])) - camera.centre
    assert right.tolist() == [5.0, 0.0]
    assert down.tolist() == [0.0, 5.0]


def test_field_of_view_is_edge_to_edge():
    camera = Camera.from_field_of_view(640, 480, math.radians(20))
    edges = camera.unproject(np.array([[-0.5, 239.5], [639.5, 239.5]]))
    assert math.degrees(math.acos(edges[0] @ edges[1])) == pytest.approx(20, abs=1e-10)
    assert math.degrees(camera.fov_x) == pytest.approx(20, abs=1e-12)


def test_distortion_is_opencvs():
    """Against the definition in OpenCV's documentation, written out by hand."""
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    radial = 1 - 0.1 * r2 + 0.02 * r2**2 + 0.001 * r2**3
    u = x * radial + 2 * 1e-3 * x * y - 2e-3 * (r2 + 2 * x * x)
    v = y * radial + 1e-3 * (r2 + 2 * y * y) - 2 * 2e-3 * x * y
    expected = (1000 * u + 511.5 + 12.3, 1000 * v + 383.5 - 4.0)
    np.testing.assert_allclose(LENS.project(np.array([[x, y, 1]]))[0], expected, rtol=1e-13)


@given(
    st.floats(-0.5, 1023.5),
    st.floats(-0.5, 767.5),
    st.sampled_from([LENS, Camera(1024, 768, 1000.0), Camera(1024, 768, 5e6)]),
)
def test_project_undoes_unproject(x, y, camera):
    np.testing.assert_allclose(camera.project(camera.unproject([[x, y]])), [[x, y]], atol=1e-9)


def test_what_lies_behind_has_no_pixel():
    for camera in (LENS, Camera(10, 10, 10.0)):
        assert np.isnan(camera.project(np.array([[0.1, 0.2, -1.0], [1.0, 0, 0]]))).all()


def test_empty_input_gives_empty_output():
    assert LENS.project(np.zeros((0, 3))).shape == (0, 2)
    assert LENS.unproject(np.zeros((0, 2))).shape == (0, 3)


@pytest.mark.parametrize("bent", [(0, 0, 0, 0, 0), (-0.2, 0.05, 1e-3, -2e-3, 0.02)])
def test_camera_agrees_with_opencv(bent):
    camera = Camera(640, 480, 700.0, 3.0, 5.0, *bent)
    points = np.random.default_rng(0).uniform([-0.4, -0.3, 1], [0.4, 0.3, 1], (50, 3))
    matrix = np.array([[700.0, 0, 322.5], [0, 700.0, 244.5], [0, 0, 1]])
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(bent, float))
    np.testing.assert_allclose(camera.project(points), seen.reshape(-1, 2), atol=1e-10)


@pytest.mark.parametrize(
    "kind", [{"columns": 0}, {"rows": 2.5}, {"focal_length_px": -1.0}, {"k1": math.nan}]
)
def test_impossible_cameras_are_refused(kind):
    with pytest.raises((ValueError, TypeError), match=next(iter(kind))):
        Camera(**{"columns": 10, "rows": 10, "focal_length_px": 10.0, **kind})


def test_impossible_field_of_view_is_refused():
    with pytest.raises(ValueError, match="fov_x"):
        Camera.from_field_of_view(10, 10, math.pi)


def test_the_narrowest_field_is_not_zero():
    """atan of half the diagonal over the focal length, for an angle whose cosine rounds to 1."""
    for focal_length_px in (1e3, 1e6, 1e9, 1e12):  # pixel
        camera = Camera(301, 401, focal_length_px)
        expected = math.atan(math.hypot(301, 401) / 2 / focal_length_px)
        assert camera.half_diagonal == pytest.approx(expected, rel=1e-3)
