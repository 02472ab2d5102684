import math

import numpy as np
import pytest
from scipy import special
from scipy.spatial.transform import Rotation

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.motion import (
    Broadband,
    Motion,
    Tone,
    image_path,
    realise_motion,
    sample_jitter,
    slew,
)
from startrack.motion.line_of_sight import join_panels, lobatto_points

PIXEL = 1e-4
ONE = Streams(1, 0)


def place(count):
    start, step, weight = lobatto_points(count)
    return join_panels(np.add.outer(start, step)), weight


def smeared(path, x, sigma):
    """The image along x of a Gaussian with a flux of one pixel^-1 on a path about y."""
    offset = path.rotation[:, 1] / PIXEL
    return np.exp(-0.5 * ((x[:, None] - offset) / sigma) ** 2) @ path.weight / sigma / 2.5066282746


def test_rest_is_one_point_for_every_trial():
    path = sample_jitter(Motion(), 0.1, PIXEL, ONE)
    assert path.rotation.tolist() == [[0.0, 0.0, 0.0]]
    assert path.weight.tolist() == [1.0]
    assert sample_jitter(Motion(tones=(Tone(10.0),)), 0.1, PIXEL, ONE).time.tolist() == [0.0]
    given = Motion(rate_x=0.1, tones=(Tone(10.0, rms_x=1e-4, phase=0.0),))
    assert sample_jitter(given, 0.1, PIXEL, ONE) is sample_jitter(given, 0.1, PIXEL, Streams(2, 5))


def test_moments_of_a_straight_path():
    """Uniform over its length: mean 0, variance L^2 / 12, fourth moment L^4 / 80."""
    path = slew(Motion(rate_x=0.01, rate_y=-0.02), 0.5, 1e-3)
    x, y, z = path.rotation.T
    assert path.weight.sum() == pytest.approx(1, rel=1e-14)
    assert path.weight @ x == pytest.approx(0, abs=1e-17)
    assert path.weight @ y**2 == pytest.approx(0.01**2 / 12, rel=1e-12)
    assert path.weight @ x**4 == pytest.approx(0.005**4 / 80, rel=1e-12)
    assert not z.any()


def test_a_path_starts_and_ends_with_the_exposure():
    for length in (0.3, 30.0, 300.0):
        path = slew(Motion(rate_z=length * PIXEL / 0.2), 0.2, PIXEL, 0.8)
        assert path.time[[0, -1]] == pytest.approx([-0.1, 0.1], rel=1e-14)
        assert (np.diff(path.time) > 0).all()
        assert path.rotation[-1, 2] - path.rotation[0, 2] == pytest.approx(-length * PIXEL)


@pytest.mark.parametrize("count", [3, 4, 9, 64, 65, 130])
def test_the_points_are_exact_to_their_degree_and_not_beyond(count):
    start, step, _ = lobatto_points(count)
    at, weight = place(count)
    assert weight.sum() == pytest.approx(1, rel=1e-13)
    assert len(at) == len(weight)
    if len(start) == 1:
        degree = 2 * len(step) - 3
        even = degree - 1
        assert weight @ at**even == pytest.approx(0.5**even / (even + 1), rel=1e-10)
        if count < 10:
            beyond = 0.5 ** (even + 2) / (even + 3)
            assert abs(weight @ at ** (even + 2) / beyond - 1) > 1e-4


def test_the_error_falls_exponentially():
    """A wave of ten cycles: no decrease up to pi / 2 points a cycle, then increasing order."""
    counts = np.array([16, 20, 24, 28, 32])
    errors = [abs(np.exp(20.6j * np.pi * t) @ w - np.sinc(10.3)) for t, w in map(place, counts)]
    order = -np.diff(np.log(errors)) / np.diff(np.log(counts))
    assert (np.diff(order) > 0).all()
    assert order[-1] > 40


@pytest.mark.parametrize("length", [0.01, 0.3, 1.0, 3.0, 10.0, 40.0, 150.0, 2000.0])
def test_a_straight_smear_is_a_gaussian_convolved_with_a_box(length):
    path = slew(Motion(rate_y=length * PIXEL / 0.1), 0.1, PIXEL, 0.1)
    x = np.concatenate([np.linspace(-4, 4, 33), length / 2 + np.linspace(-4, 4, 33)])
    up, down = ((x + s * length / 2) / 0.5 for s in (1, -1))
    np.testing.assert_allclose(
        smeared(path, x, 0.5), (special.ndtr(up) - special.ndtr(down)) / length, atol=1e-6
    )


def test_work_grows_with_the_length_of_the_path():
    """At most two points a pixel: no faster than the cycles of the sharpest detail."""
    for length in (10, 100, 1000, 10000):
        count = len(slew(Motion(rate_x=length * PIXEL / 0.1), 0.1, PIXEL, 0.1).time)
        assert length < count < 2.7 * length + 8
    cycles = [
        len(slew(Motion(tones=(Tone(f, rms_x=1e-5, phase=0.3),)), 0.1, PIXEL, 0.1).time)
        for f in (100.0, 1000.0, 5000.0)
    ]
    assert cycles[1] < 11 * cycles[0]
    assert cycles[2] < 5.5 * cycles[1]


def test_only_what_no_memory_holds_is_refused():
    assert len(slew(Motion(rate_x=1.0), 1.0, 1e-4, 0.1).time) > 10000
    with pytest.raises(
        ValueError, match=r"exposure must be short enough .* 32768 points, got 1 s in"
    ):
        slew(Motion(rate_x=10.0), 1.0, PIXEL)
    with pytest.raises(ValueError, match="exposure must be positive, got 0"):
        slew(Motion(), 0.0, PIXEL)
    with pytest.raises(TypeError, match="streams must be given where tone 0 is drawn"):
        slew(Motion(tones=(Tone(1.0, rms_x=1.0),)), 0.1, PIXEL)


def test_roll_is_sampled_for_the_corner():
    """The smear of a roll is the field angle's tangent times the turn: an arc about the centre."""
    half, angle = 0.3, 0.01
    path = slew(Motion(rate_z=angle / 0.1), 0.1, PIXEL, half)
    arc = math.tan(half) * angle / PIXEL
    assert arc < len(path.time) < 2.7 * arc + 8
    camera = Camera(4000, 4000, 1 / PIXEL)
    at = image_path(path, camera, [math.tan(half), 0.0, 1.0])
    assert np.linalg.norm(at[-1] - at[0]) == pytest.approx(arc, rel=1e-4)
    assert np.ptp(image_path(path, camera, [0.0, 0.0, 1.0])) == pytest.approx(0, abs=1e-9)


def test_stars_go_against_the_turn_of_the_camera():
    """Rotate the camera's own axes, then find a star at rest: a derivation without our formula."""
    camera = Camera(4000, 4000, 1 / PIXEL)
    star = np.array([0.05, 0.02, 1.0])
    for axis, name in enumerate(("rate_x", "rate_y", "rate_z")):
        path = slew(Motion(**{name: 0.02}), 0.5, PIXEL)
        axes = Rotation.from_rotvec(0.005 * np.eye(3)[axis]).apply(np.eye(3))
        seen = axes @ star
        expected = camera.project(seen)[0] - camera.project(star)[0]
        np.testing.assert_allclose(image_path(path, camera, star)[-1], expected, atol=1e-7)
    right = image_path(slew(Motion(rate_y=0.02), 0.5, PIXEL), camera, [0.0, 0.0, 1.0])
    assert right[-1, 0] < 0 < right[0, 0]  # it looks to the right: stars move to the left


def test_a_star_behind_the_camera_is_refused():
    path = slew(Motion(rate_y=1.0), 2.0, 1e-3)
    with pytest.raises(ValueError, match="the star must stay in front of the camera"):
        image_path(path, Camera(100, 100, 1000.0), [1.0, 0.0, 1.0])


def test_jitter_is_sampled_to_a_millionth_of_the_flux():
    """Against 20000 equal steps in time, for random motions of all sizes."""
    draw = np.random.default_rng(4)
    x = np.linspace(-4, 4, 65)
    for trial in range(12):
        size, top = 10 ** draw.uniform(-3, 0.3), 10 ** draw.uniform(0.7, 2.7)
        motion = Motion(
            rate_y=draw.normal() * 1e-4 * (trial % 3),
            tones=(Tone(top / 2, rms_y=size * PIXEL),),
            broadband=(Broadband("y", (0.1, 5.0, top), (size * 1e-9, size * 1e-9, size * 1e-12)),),
        )
        streams = Streams(9, trial)
        path = sample_jitter(motion, 0.1, PIXEL, streams, 0.2)
        fine = realise_motion(motion, 0.1, streams).at(
            (np.arange(20000) + 0.5) / 20000 * 0.1 - 0.05
        )
        dense = type(path)(np.zeros(0), np.full(20000, 1 / 20000), fine)
        np.testing.assert_allclose(smeared(path, x, 0.5), smeared(dense, x, 0.5), atol=2e-6)
