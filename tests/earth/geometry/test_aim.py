"""An orbit is shifted until its camera looks at a place."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from startrack.core import deg
from startrack.earth.geometry import (
    Aircraft,
    EarthScene,
    Fractal,
    Orbit,
    Pointing,
    Sensor,
    Terrain,
    TwoLines,
    aimed,
    observe_earth,
)

PLACE = 10 * deg, 47 * deg
ORBIT = Orbit("2026-06-21T10:00:00", altitude=572e3, inclination=97.8 * deg)


def seen(carrier: Orbit | Aircraft, pointing: Pointing) -> tuple[float, float]:
    """Longitude and latitude of the middle pixel of an image of level ground."""
    terrain = Terrain(fractal=Fractal(*PLACE, relief=1e-3), highest=10.0)
    sensor = Sensor(
        detector="line", columns=3, lines=3, focal_length=0.05, pixel_pitch=10e-6, rays=1
    )
    flies = {"aircraft" if isinstance(carrier, Aircraft) else "orbit": carrier}
    scene = EarthScene(terrain, sensor, pointing=pointing, **flies)
    (strip,) = observe_earth(scene, Path())
    ground = strip.ground
    places = [part.reshape(3, 3)[1, 1] for part in (ground.longitude, ground.latitude)]
    return float(places[0]), float(places[1])


@pytest.mark.parametrize(
    ("carrier", "pointing", "ascending"),
    [
        (ORBIT, Pointing(), False),
        (ORBIT, Pointing(roll=20 * deg, pitch=-15 * deg), True),
        (replace(ORBIT, eccentricity=0.01, perigee=1.0), Pointing(), False),
        (replace(ORBIT, local_time=22.5 * 3600), Pointing(roll=10 * deg), False),
        (Aircraft("2026-06-21T10:00:00", 0.0, 0.0, heading=1.0), Pointing(pitch=0.2), False),
    ],
)
def test_the_middle_of_the_image_is_at_the_place(carrier, pointing, ascending):
    """Within a tenth of a metre on the ground, whose height is within a millimetre."""
    found = aimed(carrier, pointing, *PLACE, ascending=ascending)
    longitude, latitude = seen(found, pointing)
    assert longitude == pytest.approx(PLACE[0], abs=1.6e-8)
    assert latitude == pytest.approx(PLACE[1], abs=1.6e-8)


def test_a_local_time_is_kept():
    orbit = replace(ORBIT, local_time=22.5 * 3600)
    found = aimed(orbit, Pointing(), *PLACE)
    assert found.local_time == orbit.local_time
    assert found.epoch != orbit.epoch


def test_what_no_orbit_can_reach_is_refused():
    with pytest.raises(ValueError, match="ascending must be left out for an aircraft"):
        aimed(Aircraft("2026-06-21T10:00:00", 0.0, 0.0), Pointing(), *PLACE, ascending=True)
    with pytest.raises(ValueError, match="misses"):
        aimed(ORBIT, Pointing(roll=80 * deg), *PLACE)
    with pytest.raises(ValueError, match="latitude must lie within 90 deg"):
        aimed(ORBIT, Pointing(), 0.0, math.pi)
    with pytest.raises(ValueError, match=r"longitude must lie in \[-180, 360\] deg, got 400 deg"):
        aimed(ORBIT, Pointing(), 400 * deg, 0.0)
    lines = (
        "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
        "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    )
    with pytest.raises(ValueError, match="two-line elements fix place and time"):
        aimed(TwoLines(*lines), Pointing(), *PLACE)


def test_the_least_distance_is_that_of_the_highest_latitude():
    """Below an inclination of 97.8 degrees the axis goes up to a geodetic latitude of 82.25 deg.

    By hand: the point of the ellipsoid on the radius at a geocentric latitude of 82.2 deg has
    tan(geodetic) = tan(82.2 deg) / (1 - f)^2; an axis that is normal to the ellipsoid meets it
    within 3 km of there.
    """
    top = math.degrees(math.atan(math.tan(82.2 * deg) / (1 - 1 / 298.257223563) ** 2))
    expected = (88 - top) * 111.7
    with pytest.raises(ValueError, match=r"comes no nearer than \d+ km") as refused:
        aimed(ORBIT, Pointing(), 10 * deg, 88 * deg)
    found = float(str(refused.value).split("than ")[1].split(" km")[0])
    assert found == pytest.approx(expected, abs=5)
