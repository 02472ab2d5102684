"""Airglow and city lights for a tracker in orbit."""

from dataclasses import replace

import numpy as np
import pytest

from startrack.core.units import deg, nm
from startrack.scene import ObserverOrbit, Scene, illuminate
from startrack.scene.bodies import Disc, Earth, earth_of
from startrack.scene.cities import CITIES, cities
from startrack.scene.ephemeris import SkyObserver, observer_of
from startrack.scene.limb import RAYLEIGH, SHELLS, airglow, spectrum
from startrack.scene.photometry import WAVELENGTH
from startrack.space import EARTH_RADIUS, J2000

from .test_illuminate import sight_of, stars_at

HIGH = 600e3
NIGHT = np.array([0.0, 0.0, -1.0])


def below(height=HIGH, sun=NIGHT) -> Earth:
    """The Earth straight down, along -z."""
    centre = np.array([0.0, 0.0, -(EARTH_RADIUS + height)])
    disc = Disc(np.array([0, 0, -1.0]), np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + height)), NIGHT)
    return Earth(disc, np.zeros_like(WAVELENGTH), centre, sun)


def past(height: float) -> np.ndarray:
    """The line of sight whose tangent point has this height."""
    angle = np.arcsin((EARTH_RADIUS + height) / (EARTH_RADIUS + HIGH))
    return np.array([[np.sin(angle), 0.0, -np.cos(angle)]])


def fractions(line):
    return [float(fraction[0]) for _, fraction in airglow(below(), line)]


def test_straight_down_a_shell_has_its_zenith_brightness():
    np.testing.assert_allclose(fractions(np.array([[0, 0, -1.0]])), 1.0, rtol=1e-9)


def test_the_limb_is_brightest_at_the_bottom_of_a_shell():
    """Chords: 2 sqrt(R2^2 - r^2) / thickness at r = R1, closed form."""
    low, high = EARTH_RADIUS + 82e3, EARTH_RADIUS + 98e3
    chord = 2 * np.sqrt(high**2 - low**2) / 16e3
    assert fractions(past(82e3))[0] == pytest.approx(chord, rel=1e-6)
    heights = np.arange(60e3, 110e3, 1e3)
    profile = [fractions(past(height))[0] for height in heights]
    assert heights[np.argmax(profile)] == 82e3
    assert profile[-1] == 0
    assert chord > 50


def test_nothing_glows_above():
    assert fractions(np.array([[0, 0, 1.0]])) == [0, 0]


def test_within_a_shell_what_is_ahead_counts():
    inside = below(250e3)
    up, down = np.array([[0, 0, 1.0]]), np.array([[0, 0, -1.0]])
    halves = [list(airglow(inside, line))[1][1][0] for line in (up, down)]
    np.testing.assert_allclose(halves, 0.5, rtol=1e-9)


def test_lines_and_continuum_have_their_rayleighs():
    low = spectrum(SHELLS[0]) / RAYLEIGH
    green = np.argmin(abs(WAVELENGTH - 557.7 * nm))
    # The line lies between two bins, with 25 of the continuum in each.
    assert low[green : green + 2].sum() == pytest.approx(250 + 2 * 25)
    assert low[green : green + 2] @ WAVELENGTH[green : green + 2] == pytest.approx(
        250 * 557.7 * nm + 25 * WAVELENGTH[green : green + 2].sum()
    )
    assert spectrum(SHELLS[1]).sum() == pytest.approx(60 * RAYLEIGH)
    # The night sky from the ground is V 21.6 (Patat 2003), half of it airglow: 22.4 +- 0.7.
    visual = (505 * nm < WAVELENGTH) & (595 * nm > WAVELENGTH)
    photons = low[visual].mean() / 10 * RAYLEIGH / 4.25e10  # a second, m2, nm, square arcsecond
    assert -2.5 * np.log10(photons / 1e8) == pytest.approx(22.4, abs=0.7)


def over(million, latitude, longitude, day=J2000 + 9600.3):
    """An observer straight over a city at night."""
    from startrack.scene.cities import _earth_to_icrs

    local = np.array(
        [
            np.cos(latitude * deg) * np.cos(longitude * deg),
            np.cos(latitude * deg) * np.sin(longitude * deg),
            np.sin(latitude * deg),
        ]
    )
    zenith = _earth_to_icrs(day) @ local
    centre = -(EARTH_RADIUS + HIGH) * zenith
    disc = Disc(-zenith, np.arcsin(EARTH_RADIUS / (EARTH_RADIUS + HIGH)), NIGHT)
    return Earth(disc, np.zeros_like(WAVELENGTH), centre, -zenith), SkyObserver(day, centre, centre)


def test_a_city_below_is_a_bright_false_star():
    """37.4 million heads of 277 lumen from 600 km: 9.2e-3 lux, V -8.9, in 75 points of V -4.2."""
    city = CITIES[0]
    earth, observer = over(*city)
    direction, rate = cities(earth, observer)
    near = direction @ earth.disc.direction > np.cos(8 * deg)
    at = np.argmin(abs(WAVELENGTH - 550 * nm))
    visual = -2.5 * np.log10(rate[near].sum(0)[at] / 1e9)
    assert visual == pytest.approx(-8.9, abs=0.1)
    assert near.sum() == 75
    assert -2.5 * np.log10(rate[near][:, at].max() / 1e9) == pytest.approx(-4.2, abs=0.2)


def test_by_day_no_lamp_is_lit():
    earth, observer = over(*CITIES[0])
    direction, _ = cities(replace(earth, sun=-earth.sun), observer)
    assert len(direction) == 0


def test_the_earth_turns_under_the_stars():
    """A quarter of a sidereal day rotates a city by 90 degrees; Greenwich's place at J2000 is
    known."""
    from startrack.scene.cities import _earth_to_icrs

    quarter = _earth_to_icrs(J2000 + 0.25 / 1.00273781191135448) @ _earth_to_icrs(J2000).T
    np.testing.assert_allclose(quarter, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-8)
    greenwich = _earth_to_icrs(J2000 + 69 / 86400)[:, 0]
    assert np.degrees(np.arctan2(greenwich[1], greenwich[0])) % 360 == pytest.approx(280.4606, 1e-6)


def test_a_scene_has_them_where_it_names_them():
    """From a place on the night side of an orbit, from which most cities are visible."""

    def scene(phase: float) -> Scene:
        return Scene(
            lights=("earth", "airglow", "cities"),
            date="2026-03-20T12:00:00",
            orbit=ObserverOrbit(600e3, 40 * deg, phase=phase),
        )

    def lamps(phase: float) -> int:
        observer = observer_of(scene(phase), None)
        return len(cities(earth_of(observer), observer)[0])

    lit = max(np.linspace(0, 2 * np.pi, 24), key=lamps)
    nadir = sight_of(observer_of(scene(lit), None).earth)
    plain = illuminate(replace(scene(lit), lights=("earth",)), stars_at([0, 0, 1]), nadir)
    full = illuminate(scene(lit), stars_at([0, 0, 1]), nadir)
    assert len(full.diffuse) == len(plain.diffuse) + 2
    assert lamps(lit) > 20
    assert len(full.direction) == len(plain.direction) + lamps(lit)


def test_they_need_an_earth():
    with pytest.raises(ValueError, match="lights must have earth where they have airglow"):
        Scene(lights=("airglow",), date="2026-03-20", orbit=ObserverOrbit(600e3))
