"""A drawn star against the projection of the camera, and its displacement by companions."""

import numpy as np
import pytest

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.observation.pointing import random_attitude
from startrack.response.spot_response import COMPANION_RADIUS
from startrack.trial.spot_plan import SpotView, plan_spots
from startrack.trial.spots import _project, _pulled

from .designs import CASE


def test_the_kernel_projects_as_the_camera_does():
    camera = Camera(800, 600, 900.0, 3.0, -5.0, -0.1, 0.05, 1e-3, -2e-3, 0.01)
    x, y = camera.centre
    view = SpotView(800, 600, 900.0, x, y, -0.1, 0.05, 1e-3, -2e-3, 0.01, 2, 0.0)
    attitude = random_attitude(Streams(1, 0))
    pixel = np.random.default_rng(1).uniform([0, 0], [799, 599], (50, 2))
    direction = attitude.inv().apply(camera.unproject(pixel))
    got = [_project.py_func(attitude.as_matrix(), each, view) for each in direction]
    np.testing.assert_allclose(got, camera.project(attitude.apply(direction)), atol=1e-9)


def test_a_companion_pulls_towards_itself_and_far_ones_do_not():
    pull, pulled = plan_spots(CASE).pull, _pulled.py_func
    assert pulled(COMPANION_RADIUS + 0.1, 0.0, 1.0, pull) == (0.0, 0.0)
    x, y = pulled(2.0, 0.0, -2.0, pull)
    assert 0.05 < x < 1.0
    assert abs(y) < 0.2 * x
    weaker, _ = pulled(2.0, 0.0, -2.8, pull)
    assert weaker == pytest.approx(x * np.exp(-0.8), rel=0.2)
    assert np.isnan(pulled(1.0, 0.0, 2.0, pull)[0])
