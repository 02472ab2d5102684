"""Places of stars while rows are exposed, against motions with closed-form solutions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.values import LineOfSight
from startrack.detector import exposure

FOCAL = 4e5  # pixel, so long that a turn is a shift
CAMERA = Camera(200, 100, FOCAL)
DELAY = 50e-6
PATH = LineOfSight(np.array([-2e-3, 0.0, 2e-3]), np.array([0.2, 0.5, 0.3]), np.zeros((3, 3)))


def walking(columns: float, rows: float):
    """The motion function for stars that move right and down by some pixels a second."""

    def course(start, step):
        return np.multiply.outer(np.add.outer(start, step), np.array([-rows, columns, 0]) / FOCAL)

    return course


def places(pixel, course, path=PATH):
    direction = CAMERA.unproject(np.asarray(pixel, float))
    view = direction, path, Rotation.identity(), CAMERA
    return list(exposure.row_by_row(*view, DELAY, course))


@pytest.mark.parametrize("pace", [2000.0, -2000.0])
def test_a_star_that_walks_down_meets_its_row(pace):
    """row = row0 + v t and t = delay (row - middle): row - middle = (row0 - middle) / (1 - q).

    q = v delay = 0.1 is left of the error by each of four passes, and once more by the last
    projection: 1e-5 of 40 pixels. Along the path, the walk goes on.
    """
    pixel = np.array([[50.0, 10], [60, 49.5], [70, 89]])
    ((weight, x, y),) = places(pixel, walking(500.0, pace))
    row = 49.5 + (pixel[:, 1] - 49.5) / (1 - pace * DELAY)
    time = DELAY * (row - 49.5) + PATH.time[:, None]
    np.testing.assert_array_equal(weight, PATH.weight)
    np.testing.assert_allclose(x, pixel[:, 0] + 500 * time, atol=1e-3)
    np.testing.assert_allclose(y, pixel[:, 1] + pace * time, atol=1e-3)


def test_stars_beyond_the_array_keep_the_time_of_its_border():
    ((_, x, _),) = places([[50, -30], [50, 0], [50, 99], [50, 400]], walking(2000.0, 0.0))
    end = 2000 * DELAY * 49.5
    np.testing.assert_allclose(x[1], 50 + np.array([-end, -end, end, end]), atol=1e-4)


def test_a_star_behind_the_camera_is_nowhere():
    view = np.array([[0.0, 0, -1]]), PATH, Rotation.identity(), CAMERA
    ((_, x, y),) = exposure.row_by_row(*view, DELAY, walking(100.0, 100.0))
    assert np.isnan([x, y]).all()


@pytest.mark.parametrize("rolling", [False, True])
def test_a_long_path_comes_in_parts(monkeypatch, rolling):
    """Ten points of two stars with at most seven places at a time: parts of three points and one
    point."""
    time = np.linspace(-1e-3, 1e-3, 10)
    course = walking(3000.0, 1000.0)
    path = LineOfSight(time, np.arange(1, 11) / 55, course(np.zeros(1), time)[0])
    direction = CAMERA.unproject(np.array([[50.0, 10], [70, 89]]))
    view = direction, path, Rotation.identity(), CAMERA

    def seen():
        places = exposure.row_by_row if rolling else exposure.at_once
        return list(places(*view, DELAY, course) if rolling else places(*view))

    (whole,) = seen()
    monkeypatch.setattr(exposure, "BATCH", 7)
    parts = seen()
    assert [len(part[0]) for part in parts] == [3, 3, 3, 1]
    for one, pieces in zip(whole, zip(*parts, strict=True), strict=True):
        np.testing.assert_allclose(np.concatenate(pieces), one, rtol=1e-12)
    monkeypatch.setattr(exposure, "BATCH", 1)
    assert [len(part[0]) for part in seen()] == [1] * 10


def test_at_once_turns_the_sky_before_the_attitude_is_left():
    """scipy rotates star by star: the rotation of the path after the attitude."""
    rng = np.random.default_rng(4)
    path = LineOfSight(np.zeros(3), np.ones(3) / 3, rng.normal(0, 1e-4, (3, 3)))
    attitude = Rotation.from_rotvec([0.3, -1.0, 0.7])
    direction = attitude.inv().apply(CAMERA.unproject(rng.uniform(0, 100, (5, 2))))
    ((weight, x, y),) = exposure.at_once(direction, path, attitude, CAMERA)
    assert weight.tolist() == path.weight.tolist()
    for m, turn in enumerate(path.rotation):
        pixel = CAMERA.project(Rotation.from_rotvec(turn).apply(attitude.apply(direction)))
        np.testing.assert_allclose(np.column_stack([x[m], y[m]]), pixel, atol=1e-6)
