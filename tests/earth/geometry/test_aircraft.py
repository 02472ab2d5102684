"""An aircraft: height, speed, heading, and the ground that its camera sees."""

import numpy as np
import pytest

from startrack.core.camera import Camera
from startrack.core.units import deg
from startrack.earth.geometry import Aircraft, Pointing, fly
from startrack.earth.geometry.sight import sight
from startrack.earth.terrain import ConstantHeight, geodetic, survey

EPOCH = "2026-06-21T10:00:00"
NORTHEAST = Aircraft(EPOCH, 10 * deg, 47 * deg, 3e3, 45 * deg, 80.0)


def test_it_keeps_height_and_speed():
    flight = fly(NORTHEAST, np.array([-600.0, 0.0, 600.0]))
    longitude, latitude, height = geodetic(flight.position)
    np.testing.assert_allclose(height, 3e3, atol=1.0)
    np.testing.assert_allclose(np.linalg.norm(flight.velocity, axis=1), 80.0, rtol=1e-9)
    assert (np.diff(longitude) > 0).all()
    assert (np.diff(latitude) > 0).all()
    gone = np.linalg.norm(flight.position[1] - flight.position[0])
    assert gone == pytest.approx(48e3, rel=1e-4)


@pytest.mark.parametrize("latitude", [-60.0, -20.0, 0.0, 47.0, 80.0])
def test_its_height_after_a_hundred_kilometres(latitude):
    """Within the 5 m by which a circle differs from the ellipsoid, for all headings."""
    worst = 0.0
    for heading in range(0, 360, 30):
        plane = Aircraft(EPOCH, 10 * deg, latitude * deg, 3e3, heading * deg, 100.0)
        place, _ = plane.state(np.array([-1000.0, 1000.0]))
        worst = max(worst, np.abs(geodetic(place)[2] - 3e3).max())
    assert worst < 5.5


def test_its_ground_moves_to_smaller_rows():
    """Ground ahead, at larger rows, is overflown later."""
    camera = Camera(11, 11, 1000.0)
    pixel = np.array([[5.0, 5.0], [5.0, 10.0]])
    rays = sight(camera, pixel, np.zeros(2), NORTHEAST, Pointing(), spread=0.0)
    ground = survey(ConstantHeight(0.0), rays, np.array([0.0, 0.0, 1.0]))
    ahead = ground.point[1] - ground.point[0]
    velocity = fly(NORTHEAST, np.zeros(1)).velocity[0]
    assert np.linalg.norm(ahead) == pytest.approx(15.0, rel=1e-2)  # 5 pixel of 1 mrad from 3 km
    assert ahead @ velocity / np.linalg.norm(ahead) / 80 == pytest.approx(1, abs=1e-3)


def test_poles_and_depths_are_refused():
    with pytest.raises(ValueError, match="latitude must lie in"):
        Aircraft(EPOCH, 0.0, 1.55)
    with pytest.raises(ValueError, match="altitude must lie in"):
        Aircraft(EPOCH, 0.0, 0.0, -10.0)
