"""Cover, temperature and fires of ground of known height."""

import numpy as np
import pytest

from startrack.core import Curve
from startrack.core.units import deg, um
from startrack.earth.imager.land import (
    Cover,
    HotSpot,
    Land,
    burning_fraction,
    reflectance,
    temperature,
)
from startrack.earth.terrain import ConstantHeight, Ground, Rays, cartesian, survey, up

PLACE = np.array(10 * deg), np.array(47 * deg)
BAND = np.array([0.5 * um]), np.ones(1)


def below(height: float, sun: float = 0.0, aside: float = 0.0) -> Ground:
    """The view of one vertical ray, `aside` metre to the north, with an oblique Sun."""
    rise = up(*PLACE)
    east = np.array([-np.sin(PLACE[0]), np.cos(PLACE[0]), 0.0])
    origin = cartesian(*PLACE, np.array(9e3)) + aside * np.cross(rise, east)
    ray = Rays(origin[None], -rise[None], np.full(1, 1e-6))
    return survey(ConstantHeight(height), ray, np.cos(sun) * rise + np.sin(sun) * east)


@pytest.mark.parametrize("height", [0.0, 1500.0, 5000.0])
def test_a_fire_burns_on_the_ground_whatever_its_height(height):
    """A fire of a square metre straight below fills the ray, and none is seen five metres away."""
    fire = HotSpot(float(PLACE[0]), float(PLACE[1]), 1.0)
    assert burning_fraction(fire, below(height), 1e-6)[0] == pytest.approx(1.0, abs=1e-6)
    assert burning_fraction(fire, below(height, aside=5.0), 1e-6)[0] < 1e-6


def test_the_highest_cover_that_begins_below_counts():
    grey = [Cover(Curve((), (value,)), above=above) for value, above in ((0.1, -1e3), (0.6, 2e3))]
    land = Land(tuple(grey))
    seen = [reflectance(land, below(height), *BAND)[0] for height in (0.0, 1999.0, 2001.0)]
    assert seen == pytest.approx([0.1, 0.1, 0.6])


def test_ground_is_colder_above_and_warmer_in_the_sun():
    land = Land((Cover(temperature=290.0),), lapse=6.5e-3, warming=10.0)
    assert temperature(land, below(1000.0))[0] == pytest.approx(290 - 6.5 + 10)
    assert temperature(land, below(0.0, sun=60 * deg))[0] == pytest.approx(295.0, abs=0.01)
    assert temperature(land, below(0.0, sun=120 * deg))[0] == pytest.approx(290.0)  # night
