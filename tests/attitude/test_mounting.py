"""The rotation to the spacecraft's axes, and its thermo-elastic swing."""

import numpy as np
import pytest

from startrack.attitude import Mounting
from startrack.core.units import deg


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_swing_about_one_axis_is_a_swing(axis):
    """It is zero at phase 0, largest at pi / 2, and absent from `still`."""
    mounting = Mounting(**{f"swing_{axis}": 2 * deg, axis: 90 * deg})
    assert mounting.swings
    assert not mounting.still.swings
    one = np.array([axis == each for each in "xyz"], float)
    for phase, angle in ((0.0, 90), (np.pi / 2, 92), (np.pi, 90), (-np.pi / 2, 88)):
        turned = mounting.camera_to_body(phase).as_rotvec()
        np.testing.assert_allclose(turned, angle * deg * one, atol=1e-15)
    np.testing.assert_allclose(mounting.still.camera_to_body(1.0).as_rotvec(), 90 * deg * one)


def test_without_angles_the_axes_are_the_cameras():
    assert not Mounting().swings
    assert Mounting().camera_to_body(1.0).magnitude() == 0


@pytest.mark.parametrize("name", ["x", "y", "z", "swing_x", "swing_y", "swing_z"])
def test_values_that_are_no_angles_are_refused(name):
    with pytest.raises(ValueError, match=name):
        Mounting(**{name: float("nan") if len(name) == 1 else -1.0})
