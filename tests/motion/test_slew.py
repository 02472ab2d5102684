import numpy as np
import pytest

from startrack.motion import Motion, slew


def test_rest_is_one_point():
    path = slew(Motion(), 0.1, 1e-4)
    assert path.rotation.tolist() == [[0.0, 0.0, 0.0]]
    assert path.weight.tolist() == [1.0]


def test_moments_of_a_straight_path():
    """Uniform over its length: mean 0, variance L^2 / 12, fourth moment L^4 / 80."""
    path = slew(Motion(rate_x=0.01, rate_y=-0.02), 0.5, 1e-3)
    x, y, z = path.rotation.T
    assert path.weight.sum() == pytest.approx(1, rel=1e-14)
    assert path.weight @ x == pytest.approx(0, abs=1e-18)
    assert path.weight @ y**2 == pytest.approx(0.01**2 / 12, rel=1e-12)
    assert path.weight @ x**4 == pytest.approx(0.005**4 / 80, rel=1e-12)
    assert not z.any()


def test_a_slew_over_the_frame_is_refused():
    with pytest.raises(ValueError, match=r"at most 256 pixel .* got 1000"):
        slew(Motion(rate_x=1.0), 1.0, 1e-3)
