"""Light of a user's function: sampled finely enough, against its own values between the samples."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

from startrack import core
from startrack.core import Refused, Streams
from startrack.core.units import deg
from startrack.scene import Scene, Sight
from startrack.scene.illuminate import _input, light_by_code

CAMERA = core.Camera(1024, 1024, 1024 / (2 * np.tan(10 * deg)))  # 20 degrees
AXIS = np.array([0.03, -0.05, 1.0]) / np.linalg.norm([0.03, -0.05, 1.0])


def glow(width):
    """Gaussian of a sigma (radian), half as wide in the last bin."""

    def light(given):
        away = np.arccos(np.clip(given.direction @ AXIS, -1, 1))[:, None]
        sigma = width * np.linspace(1, 0.5, len(given.wavelength))
        return 1e9 * np.exp(-(away**2) / 2 / sigma**2)

    return light


def uneven(given):
    return given.generator.random((len(given.direction), len(given.wavelength)))


def disc(given):
    inside = given.direction @ AXIS > np.cos(3 * deg)
    return np.outer(inside, np.ones(len(given.wavelength)))


@pytest.fixture
def light_of(monkeypatch):
    """The light (rows, columns, k) between the pixels' centres, and the size of its map."""

    def made(function):
        monkeypatch.setattr("startrack.core.call_code", lambda group, name, given: function(given))
        sight = Sight(Rotation.identity(), CAMERA, 6.0, Streams(1, 0))

        def given(count):  # of three bins, for time
            every = _input("a:light", Scene(), sight, count)
            return replace(every, wavelength=every.wavelength[::38])

        maps = list(light_by_code("a:light", given))
        side = len(maps[0].fraction)
        table = sum(np.multiply.outer(one.fraction, one.spectrum) for one in maps)
        axis = np.linspace(0, 1023, side)
        y, x = np.meshgrid(np.arange(0, 1024, 5.0), np.arange(0, 1024, 5.0), indexing="ij")
        seen = RegularGridInterpolator((axis, axis), table)((y, x))
        pixel = np.column_stack([x.ravel(), y.ravel()])
        direct = function(replace(given(2), direction=CAMERA.unproject(pixel)))
        return side, seen, direct.reshape(seen.shape)

    return made


@pytest.mark.parametrize(("width", "side"), [(1.0, 17), (1 * deg, 257), (0.5 * deg, 513)])
def test_a_glow_of_any_width_is_within_the_tolerance(light_of, width, side):
    found, seen, right = light_of(glow(width))
    assert found == side
    assert (np.abs(seen - right).max(axis=(0, 1)) <= 0.01 * right.max(axis=(0, 1))).all()
    assert seen.sum(axis=(0, 1)) == pytest.approx(right.sum(axis=(0, 1)), rel=5e-3)


def test_an_edge_is_within_a_point_of_its_place(light_of):
    side, seen, right = light_of(disc)
    assert side == 513
    assert seen.sum() == pytest.approx(right.sum(), rel=5e-3)


def test_light_without_neighbours_is_refused(light_of):
    with pytest.raises(Refused, match="must vary linearly between points 1/512"):
        light_of(uneven)
