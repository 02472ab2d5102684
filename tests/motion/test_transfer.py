"""Transfer functions and time densities of paths that have a closed form."""

import math

import numpy as np
import pytest
from krutz_2011 import density, nyquist_mtf
from scipy import special

from startrack.core.camera import Camera
from startrack.motion import Motion, Tone, image_path, realise_motion, slew, transfer

PIXEL = 1e-8  # so small that the tangent bends no path
CAMERA = Camera(2001, 2001, 1 / PIXEL)
AHEAD = np.array([0.0, 0.0, 1.0])
FREQUENCY = np.array([[0.1, 0], [0.5, 0], [0, 0.5], [0.3, -0.4], [0.7, 0.2]])


def seen(motion, exposure=0.1):
    path = slew(motion, exposure, PIXEL, 0.01)
    return path, image_path(path, CAMERA, AHEAD)


def circle(radius, frequency=10.0):
    """A tone about x and y, a quarter of a cycle apart; radius in pixel."""
    rms = radius * PIXEL / math.sqrt(2)
    return Motion(tones=(Tone(frequency, rms_x=rms, rms_y=rms, phase=0.7, lead_y=-math.pi / 2),))


def test_rest():
    path, offset = seen(Motion())
    np.testing.assert_array_equal(transfer(offset, path.weight, FREQUENCY), 1.0)
    assert nyquist_mtf(offset, path.weight) == (1.0, 1.0)


@pytest.mark.parametrize("length", [0.2, 3.0, 77.0, 5000.0])
def test_straight_lines_are_sinc(length):
    """Also for pure y motion, where v_x is always 0; 5000 pixel are more than the frame."""
    for name, axis in (("rate_y", 0), ("rate_x", 1)):
        path, offset = seen(Motion(**{name: length * PIXEL / 0.1}))
        np.testing.assert_allclose(
            transfer(offset, path.weight, FREQUENCY),
            np.sinc(FREQUENCY[:, axis] * length),
            atol=4e-6,
        )


@pytest.mark.parametrize("radius", [0.05, 0.5, 3.0, 20.0])
def test_full_circles_and_whole_sines_are_bessel_functions(radius):
    path, offset = seen(circle(radius))
    length = np.hypot(*FREQUENCY[:3].T)
    # The path passes through the origin, and its circle's centre does not: compare the moduli.
    np.testing.assert_allclose(
        abs(transfer(offset, path.weight, FREQUENCY[:3])),
        abs(special.j0(2 * np.pi * length * radius)),
        atol=4e-6,
    )
    sine = Motion(tones=(Tone(30.0, rms_y=radius * PIXEL / math.sqrt(2), phase=1.0),))
    path, offset = seen(sine)
    np.testing.assert_allclose(
        np.array(nyquist_mtf(offset, path.weight)), [abs(special.j0(np.pi * radius)), 1], atol=4e-6
    )


def test_the_phase_of_the_transfer_function_is_the_shift():
    """A shift by one pixel to larger columns turns the phase by -2 pi f."""
    value = transfer(np.array([[1.0, 0.0]]), np.ones(1), np.array([0.25, 0.0]))
    assert value == pytest.approx(-1j)


def arc(count, angle=math.pi / 2, radius=20.0):
    """Eq. (16): along a circle from the right of the origin, at constant speed."""
    time = np.linspace(0, 1, count)
    return time, radius * np.column_stack([np.sin(angle * time), np.cos(angle * time)])


def test_quarter_circle_has_the_time_of_equation_14():
    """t_k = asin(x / R) / omega: the time in a column is the difference between its sides.

    It is finite in the last column, where the path turns and 1 / |v_x| is infinite.
    """
    time, offset = arc(20001)
    image = density(time, offset, 41, 41)
    edge = np.clip(np.arange(-20.5, 21), 0, 20)
    expected = np.diff(np.arcsin(edge / 20)) / (math.pi / 2)
    np.testing.assert_allclose(image.sum(axis=0), expected, atol=1e-8)
    np.testing.assert_allclose(image.sum(axis=1), expected, atol=1e-8)
    assert image.sum() == pytest.approx(1, rel=1e-12)
    assert image[40, 20] > 0  # it starts at (0, R), at the largest row
    assert image[0, 20] == 0


def test_density_converges_at_second_order():
    exact = np.diff(np.arcsin(np.clip(np.arange(-20.5, 21), 0, 20) / 20)) / (math.pi / 2)
    counts = np.array([21, 41, 81, 161, 321])
    error = [abs(density(*arc(n), 41, 41).sum(axis=0) - exact).sum() for n in counts]
    slope = np.polyfit(np.log(counts - 1), np.log(error), 1)[0]
    assert slope == pytest.approx(-2, abs=0.35)


def test_full_circle_and_turning_points():
    """A sine's density is that of the arcsine law, with peaks at its turning points."""
    time, offset = arc(40001, 2 * math.pi)
    image = density(time, offset, 43, 43)
    edge = np.clip(np.arange(-21.5, 22), -20, 20)
    expected = np.diff(np.arcsin(edge / 20)) / math.pi
    np.testing.assert_allclose(image.sum(axis=0), expected, atol=1e-7)
    np.testing.assert_allclose(image, image[::-1], atol=1e-7)
    np.testing.assert_allclose(image, image.T, atol=1e-7)


def test_rest_pure_y_and_a_path_longer_than_the_grid():
    time = np.linspace(-1, 1, 3)
    rest = density(time, np.zeros((3, 2)), 5, 3)
    assert rest[1, 2] == 1
    assert rest.sum() == 1
    down = density(time, np.column_stack([np.zeros(3), 4 * time]), 3, 9)
    np.testing.assert_allclose(down[:, 1], [1 / 16] + 7 * [1 / 8] + [1 / 16], rtol=1e-12)
    assert not down[:, [0, 2]].any()
    long = density(time, np.column_stack([500 * time, 0.25 * time]), 11, 3)
    assert long.sum() == pytest.approx(11 / 1000, rel=1e-12)
    np.testing.assert_allclose(long[1], 1 / 1000, rtol=1e-9)


def test_density_and_transfer_function_are_one_thing():
    """The sum of waves over the histogram is the transfer function times the cell's sinc."""
    cell = 0.05
    time = np.linspace(-0.05, 0.05, 20001)
    motion = Motion(rate_y=100 * PIXEL, tones=(Tone(25.0, rms_x=2 * PIXEL, phase=0.2),))
    path, offset = seen(motion)
    dense = realise_motion(motion, 0.1).at(time)[:, [1, 0]] * [1, -1] / PIXEL
    image = density(time, dense, 801, 801, cell)
    assert image.sum() == pytest.approx(1, rel=1e-9)
    at = (np.arange(801) - 400) * cell
    for fx, fy in FREQUENCY[:3]:
        waves = np.exp(-2j * np.pi * fy * at) @ image @ np.exp(-2j * np.pi * fx * at)
        # Cells smooth by their sinc and sample it: second order in the cell.
        assert abs(waves - transfer(offset, path.weight, np.array([fx, fy]))) < 2e-3


def test_what_is_no_path_is_refused():
    with pytest.raises(ValueError, match="time must hold two or more increasing"):
        density(np.zeros(2), np.zeros((2, 2)), 3, 3)
    with pytest.raises(ValueError, match="increasing, finite"):
        density(np.array([0.0, np.inf]), np.zeros((2, 2)), 3, 3)
    with pytest.raises(ValueError, match="offset must hold finite"):
        density(np.arange(2.0), np.full((2, 2), np.nan), 3, 3)
    with pytest.raises(ValueError, match="cell must be positive, got 0"):
        density(np.arange(2.0), np.zeros((2, 2)), 3, 3, 0.0)
