"""Each element has its own line of sight at its own time."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.earth.geometry import EarthScene, Orbit, Pointing, fly, ground_rate, observe_earth
from startrack.earth.geometry.scene import Fractal, Sensor, Terrain
from startrack.earth.geometry.sight import (
    Dating,
    line_elements,
    matrix_elements,
    scan_lines,
    sight,
    staggered_elements,
    tdi_elements,
)
from startrack.earth.terrain import ConstantHeight, geodetic, up

pytest.importorskip("sgp4")

ORBIT = Orbit("2026-06-21T10:00:00", altitude=600e3, anomaly=0.7)
CAMERA = Camera(101, 101, 1e5)  # 6 m on the ground
DOWN = Pointing()


@cache
def pixel_period():
    """Time in seconds in which the image moves by a pixel."""
    return 1 / (ground_rate(ORBIT) * CAMERA.focal_length_px)


def ground(rays):
    hits, _ = ConstantHeight().meet(rays)
    return rays.origin + hits.distance[:, None] * rays.direction


def metres(a, b):
    return np.linalg.norm(a - b, axis=-1)


def test_the_boresight_looks_down_but_for_aberration():
    """v / c = 25 microradian displaces the seen ground by 15 m at 600 km, against the flight."""
    rays = sight(CAMERA, np.array([[50.0, 50.0]]), np.zeros(1), ORBIT, DOWN)
    flight = fly(ORBIT, np.zeros(1))
    down = -flight.position[0] / np.linalg.norm(flight.position[0])
    shift = rays.direction[0] - down
    expected = -flight.velocity[0] / 299792458.0
    expected -= expected @ down * down
    np.testing.assert_allclose(shift, expected, atol=1e-9)
    assert np.linalg.norm(shift) * 600e3 == pytest.approx(15, abs=0.5)


def test_columns_run_across_and_rows_along_the_flight():
    pixel = np.array([[50.0, 50], [60, 50], [50, 60]])
    middle, across, along = ground(sight(CAMERA, pixel, np.zeros(3), ORBIT, DOWN))
    velocity = fly(ORBIT, np.zeros(1)).velocity[0]
    velocity /= np.linalg.norm(velocity)
    rise = up(*geodetic(middle)[:2])
    # The Earth turns below: the inertial flight is what rows follow, to 4 degrees.
    assert (along - middle) @ velocity == pytest.approx(60, abs=2)
    # With the boresight down and rows along the flight, columns count to the left.
    assert (across - middle) @ np.cross(rise, velocity) == pytest.approx(60, abs=2)


def test_a_line_advances_by_a_pixel():
    rays = scan_lines(
        CAMERA, line_elements(101, 50.0), np.arange(3.0), Dating(0.0, pixel_period()), ORBIT, DOWN
    )
    at = ground(rays).reshape(3, 101, 3)
    side = metres(at[0, 50], at[0, 51])
    assert metres(at[0, 50], at[1, 50]) == pytest.approx(side, rel=0.01)


def test_the_stages_of_tdi_see_one_place():
    elements = tdi_elements(3, 50.0, 16)
    rays = scan_lines(CAMERA, elements, np.zeros(1), Dating(0.0, pixel_period()), ORBIT, DOWN)
    at = ground(rays).reshape(3, 16, 3)
    # The Earth turns by up to 4 degrees of the flight: a pixel in 16 lines, but not along.
    velocity = fly(ORBIT, np.zeros(1)).inertial[0]
    assert np.abs((at - at[:, :1]) @ velocity / np.linalg.norm(velocity)).max() < 0.1 * 6
    wrong = tdi_elements(3, 50.0, 16, forwards=1)
    rays = scan_lines(CAMERA, wrong, np.zeros(1), Dating(0.0, pixel_period()), ORBIT, DOWN)
    at = ground(rays).reshape(3, 16, 3)
    assert metres(at[1, 0], at[1, 15]) > 25 * 6


def test_staggered_rows_mesh():
    """Columns that alternate between two rows see one line of ground, half a pixel apart."""
    elements = staggered_elements(40, 46.0, 8.0)
    rays = scan_lines(CAMERA, elements, np.zeros(1), Dating(0.0, pixel_period() / 2), ORBIT, DOWN)
    at = ground(rays)
    step = np.diff(at, axis=0)
    # The Earth turns below: one step is longer and the next one shorter.
    assert np.linalg.norm(step, axis=1).mean() == pytest.approx(3.0, rel=0.03)
    velocity = fly(ORBIT, np.zeros(1)).inertial[0]
    assert np.abs(step @ velocity / np.linalg.norm(velocity)).max() < 0.1 * 6


@pytest.mark.parametrize("period", [None, 0.3e-3, 2e-3])
def test_staggered_rows_of_a_scene_mesh_at_any_pace(period):
    """For any period, all pixels of a line see one line of the ground, within a tenth of a
    pixel."""
    sensor = Sensor("staggered", 40, 5, 1.0, 10e-6, period, 8)
    elements = sensor.elements(ORBIT)
    line = np.array([2.0])  # the middle one
    at = ground(scan_lines(sensor.camera, elements, line, sensor.dating(ORBIT), ORBIT, DOWN))
    velocity = fly(ORBIT, np.zeros(1)).inertial[0]
    along = at @ velocity / np.linalg.norm(velocity)
    assert np.ptp(along) < 0.1 * 6


def test_the_sun_is_that_of_the_middle_line():
    """In an image taken an hour after the epoch, the Sun is 15 degrees further west."""
    terrain = Terrain(fractal=Fractal(0.1, 0.1, cells=16))
    suns = [
        next(
            observe_earth(EarthScene(terrain, Sensor("line", 2, 1, delay=late), ORBIT), Path())
        ).ground.sun
        for late in (0.0, 3600.0)
    ]
    west = [np.degrees(np.arctan2(sun[1], sun[0])) for sun in suns]
    assert (west[0] - west[1]) % 360 == pytest.approx(15, abs=0.01)


def test_a_matrix_sees_all_at_once():
    frame = [
        scan_lines(CAMERA, row, np.zeros(1), Dating(2.0), ORBIT, DOWN)
        for row in (matrix_elements(101, first, 1) for first in (0, 1))
    ]
    np.testing.assert_array_equal(frame[0].origin[0], frame[1].origin[-1])


def test_jitter_enters_each_line():
    """A rotation about x of a microradian a line shifts the image along the flight."""
    lines, angle = np.arange(4.0), 1e-5
    dating = Dating(0.0, pixel_period())

    def turn(time):
        return np.outer(-np.round(time / pixel_period()) * angle, [1.0, 0, 0])

    still = scan_lines(CAMERA, line_elements(1, 50.0), lines, dating, ORBIT, DOWN)
    moved = scan_lines(CAMERA, line_elements(1, 50.0), lines, dating, ORBIT, DOWN, turn)
    shift = metres(ground(moved), ground(still))
    height = geodetic(fly(ORBIT, np.zeros(1)).position)[2][0]
    np.testing.assert_allclose(shift, lines * angle * height, rtol=1e-3, atol=1e-6)


@dataclass(frozen=True, eq=False)
class Fixed:
    """A camera with a constant attitude in ICRS."""

    icrs_to_camera: Rotation

    def camera_to_itrs(self, flight):
        return flight.icrs_to_itrs * self.icrs_to_camera.inv()


def test_a_camera_fixed_among_the_stars_keeps_its_direction():
    attitude = Rotation.from_euler("xyz", [0.3, 1.0, -0.4])
    time = np.array([0.0, 500.0])
    rays = sight(CAMERA, np.array([[50.0, 50], [50, 50]]), time, ORBIT, Fixed(attitude))
    flight = fly(ORBIT, time)
    seen = rays.direction + flight.velocity / 299792458.0
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    inertial = flight.icrs_to_itrs.inv().apply(seen)
    expected = attitude.inv().apply([0, 0, 1.0])
    np.testing.assert_allclose(inertial, np.tile(expected, (2, 1)), atol=1e-8)


def test_rays_share_a_pixel_evenly():
    rays = scan_lines(
        CAMERA, line_elements(1, 50.0), np.zeros(1), Dating(), ORBIT, DOWN, rays_per_side=3
    )
    assert len(rays) == 9
    np.testing.assert_allclose(rays.spread, 1 / 3e5)
    one = sight(CAMERA, np.array([[0.0, 50.0]]), np.zeros(1), ORBIT, DOWN)
    mean = rays.direction.mean(axis=0)
    np.testing.assert_allclose(mean / np.linalg.norm(mean), one.direction[0], atol=1e-12)
