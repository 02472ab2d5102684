from datetime import datetime

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.core.units import deg, installed_tables
from startrack.scene.ephemeris import observer_of, on_orbit
from startrack.scene.parameters import ObserverOrbit, Scene
from startrack.scene.planets import magnitude_v
from startrack.space import AU, EARTH_RADIUS


def at(date: str, **changes):
    return observer_of(Scene(lights=("sun",), date=date, **changes), None)


@pytest.mark.parametrize("name", ["sun", "moon", "venus", "mars", "saturn"])
@pytest.mark.parametrize("date", ["1969-07-20T20:17:00", "2026-03-20T12:00:00", "2004-11-05T06:00"])
def test_places_are_those_of_astropy(name, date):
    """Against get_body, which includes 20.5 arcsec of aberration, and less than 1 of deflection."""
    from astropy import units
    from astropy.coordinates import get_body
    from astropy.time import Time

    with installed_tables():
        body = get_body(name, Time(date, scale="utc"), ephemeris="builtin")
    wanted = body.cartesian.xyz.to_value(units.m)
    seen = at(date).see(name)
    assert seen.distance == pytest.approx(np.linalg.norm(wanted), rel=1e-6)
    angle = np.linalg.norm(np.cross(seen.direction, wanted / np.linalg.norm(wanted)))
    assert angle / deg * 3600 < 21.5


def test_the_sun_crosses_the_equator_when_the_almanac_says():
    """2026 March 20, 14:46 UTC; the equator of that date is 26.2 years of precession away."""
    sun = at("2026-03-20T14:46:00").see("sun").direction
    longitude = np.degrees(
        np.arctan2(sun[1] * np.cos(23.4393 * deg) + sun[2] * np.sin(23.4393 * deg), sun[0])
    )
    aberration = 20.5 / 3600
    assert longitude + 26.217 * 50.29 / 3600 - aberration == pytest.approx(0, abs=0.003)


def test_the_moon_is_full_and_new_when_the_almanac_says():
    """New 2026 February 17, 12:01 UTC, an eclipse; full 2026 April 2, 02:12 UTC."""
    new, full = at("2026-02-17T12:01:00"), at("2026-04-02T02:12:00")
    angle = [
        np.degrees(np.arccos(one.see("moon").direction @ one.see("sun").direction))
        for one in (new, full)
    ]
    assert angle[0] < 1.5
    assert angle[1] > 174
    assert full.see("moon").phase_angle / deg < 6


def test_magnitudes_of_planets(oracle):
    """Against Skyfield's code of the same paper; Jupiter's -2.73 is also in its manual."""
    for date, name, wanted in oracle("planets.json"):
        observer = at(date)
        assert magnitude_v(name, observer.see(name), observer.year) == pytest.approx(
            wanted, abs=2e-3
        )


def test_the_earth_from_far_away():
    """From Mars: V near -2.5 at its brightest (Mallama and Hilton 2018), and less at other
    phases."""
    mars = at("2026-03-20T00:00:00").see("mars")
    place = tuple(at("2026-03-20T00:00:00").position + mars.direction * mars.distance)
    scene = Scene(lights=("planets",), date="2026-03-20T00:00:00", place=place)
    earth = observer_of(scene, None).see("earth")
    assert earth.distance == pytest.approx(mars.distance, rel=1e-4)
    assert -2.5 < magnitude_v("earth", earth, 2026.2) < 2


def test_an_orbit_is_a_circle_around_the_earth():
    orbit = ObserverOrbit(550e3, 97.6 * deg, 40 * deg)
    places = np.array([on_orbit(orbit, phase) for phase in np.linspace(0, 2 * np.pi, 13)])
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), EARTH_RADIUS + 550e3)
    normal = np.cross(places[0], places[3])
    assert np.arccos(normal[2] / np.linalg.norm(normal)) == pytest.approx(97.6 * deg)
    # It crosses the equator northwards at the node.
    assert np.arctan2(places[0][1], places[0][0]) == pytest.approx(40 * deg)
    assert places[1][2] > 0


def test_what_is_drawn_belongs_to_the_trial():
    scene = Scene(lights=("sun",), date="2026-01-01", days=365.0, orbit=ObserverOrbit(600e3, 1.0))
    first, again, other = (observer_of(scene, Streams(1, number)) for number in (4, 4, 5))
    assert first.day == again.day
    np.testing.assert_array_equal(first.position, again.position)
    assert first.day != other.day
    assert 0 <= first.day - at("2026-01-01").day < 365
    assert np.linalg.norm(first.earth) == pytest.approx(EARTH_RADIUS + 600e3)


def test_a_date_of_another_zone_is_the_same_instant():
    assert at("2026-03-20T14:00:00+02:00").day == at("2026-03-20T12:00:00").day
    assert at("2026-03-20").day == pytest.approx(2461119.5 + 69.2 / 86400, abs=1e-6)
    assert isinstance(Scene(date="2026-03-20").start, datetime)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"date": "yesterday"}, "date must be written as 2026-03-20T12:00:00, got 'yesterday'"),
        ({"date": "0001-01-01T00:00+05:00"}, "date must be written as 2026-03-20T12:00:00"),
        ({"date": "1812-01-01"}, "year of date must lie in"),
        ({"lights": ("stars",)}, "lights must be one of zodiacal, "),
        ({"lights": ("planets",)}, "date must be given for planets, got none"),
        ({"lights": ("earth",), "date": "2026-01-01"}, "orbit must be given where lights has"),
        ({"lights": ("zodiacal",), "date": "2026-01-01", "background_g": 22.0}, "must be left out"),
        ({"place": (AU, 0.0)}, "place must have three coordinates, got 2"),
        (
            {"place": (AU, 0.0, 0.0), "orbit": ObserverOrbit(5e5)},
            "orbit and place must not both be given",
        ),
        ({"days": -1.0}, "days must not be negative"),
    ],
)
def test_what_contradicts_itself_is_refused(changes, words):
    with pytest.raises(ValueError) as error:
        Scene(**changes)
    assert words in str(error.value)


def test_drawing_needs_the_trial():
    with pytest.raises(TypeError, match="streams must be given where the date is drawn"):
        observer_of(Scene(lights=("sun",), date="2026-01-01", days=10.0), None)
