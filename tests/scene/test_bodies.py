import numpy as np
import pytest
from scipy import integrate

from startrack.core.units import BOLTZMANN, LIGHT_SPEED, PLANCK, deg
from startrack.scene.bodies import (
    EARTH_ALBEDO,
    Disc,
    disc_points,
    earth_of,
    moon_of,
    sun_of,
    sunlight,
)
from startrack.scene.ephemeris import SkyObserver, observer_of
from startrack.scene.parameters import Scene
from startrack.scene.photometry import WAVELENGTH
from startrack.space import AU, EARTH_RADIUS

ENERGY = PLANCK * LIGHT_SPEED / WAVELENGTH  # joule of a photon


def at(date: str) -> SkyObserver:
    return observer_of(Scene(lights=("sun",), date=date), None)


def near_earth(distance: float, phase: float) -> SkyObserver:
    """An observer who sees the Earth at this phase angle, on a day in March."""
    centre = at("2026-03-20")
    sun = centre.see("sun").direction
    side = np.cross(sun, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    away = np.cos(phase) * sun + np.sin(phase) * side
    return SkyObserver(centre.day, centre.position + distance * away, -distance * away)


def test_sunlight_has_the_energy_of_the_solar_constant():
    """1361 W/m^2 (Kopp and Lean 2011), times a blackbody's fraction between 320 and 1100 nm."""

    def planck(x):
        return x**3 / np.expm1(x)

    low, high = (PLANCK * LIGHT_SPEED / (BOLTZMANN * 5772 * end) for end in (1100e-9, 320e-9))
    fraction = integrate.quad(planck, low, high)[0] / (np.pi**4 / 15)
    assert sunlight(AU) @ ENERGY == pytest.approx(1361 * fraction, rel=0.03)


def test_sizes_on_the_sky():
    """The Sun's disc is 31.5 to 32.5 arcmin, the Moon's 29.4 to 33.5."""
    observer = at("2026-07-05")
    assert 2 * sun_of(observer).radius / deg * 60 == pytest.approx(31.46, abs=0.05)  # aphelion
    assert 29.3 < 2 * moon_of(observer).radius / deg * 60 < 33.6


@pytest.mark.parametrize(
    ("date", "magnitude"), [("2026-04-02T02:12:00", -12.6), ("2026-03-25T19:18:00", -10.0)]
)
def test_the_moon_at_full_and_at_its_first_quarter(date, magnitude):
    """-12.7 at a mean full Moon and near -10 at a quarter, whose light is a thirteenth of it."""
    observer = at(date)
    over_sun = moon_of(observer).photon_irradiance.sum() / sunlight(AU).sum()
    assert -26.76 - 2.5 * np.log10(over_sun) == pytest.approx(magnitude, abs=0.3)


def test_a_disc_has_its_size_and_its_light():
    disc = Disc(np.array([0.0, 0.6, 0.8]), 0.25 * deg, np.ones(1))
    place, fraction = disc_points(disc, 0.005 * deg)
    assert fraction.sum() == pytest.approx(1)
    away = np.arccos(np.clip(place @ disc.direction, -1, 1))
    assert away.max() < 0.25 * deg
    # A flat disc's mean square distance from its centre is half its radius squared.
    assert fraction @ away**2 == pytest.approx((0.25 * deg) ** 2 / 2, rel=0.01)


@pytest.mark.parametrize("phase", [0.0, 60.0, 90.0, 150.0])
def test_a_moon_is_lit_from_the_side_of_the_sun(phase):
    direction = np.array([0.0, 0.0, 1.0])
    # The Sun's direction from the body makes the phase angle with the line back to the observer.
    sun = np.array([np.sin(phase * deg), 0.0, -np.cos(phase * deg)])
    place, fraction = disc_points(Disc(direction, 0.25 * deg, np.ones(1), sun), 0.002 * deg)
    x = place[:, 0] / np.tan(0.25 * deg)
    assert x.max() == pytest.approx(1, abs=0.02)
    # The terminator is a half ellipse with the half axis cos(phase), on the dark side of it.
    assert x[np.abs(place[:, 1]) < 3e-5].min() == pytest.approx(-np.cos(phase * deg), abs=0.03)
    if phase == 0:
        np.testing.assert_allclose(fraction * len(fraction), 1)  # even at full phase
    else:
        assert fraction @ x > 0.1


@pytest.mark.parametrize("spacing", [0.1, 0.05, 0.01])
@pytest.mark.parametrize("phase", [150.0, 160.0, 165.0, 170.0])
def test_a_thin_crescent_keeps_its_light(phase, spacing):
    """For pixels of any size: all light, at the limb towards the Sun, on the Sun's side."""
    sun = np.array([np.sin(phase * deg), 0.0, -np.cos(phase * deg)])
    disc = Disc(np.array([0.0, 0.0, 1.0]), 0.25 * deg, np.ones(1), sun)
    place, fraction = disc_points(disc, spacing * deg)
    assert fraction.sum() == pytest.approx(1)
    x, y = place[:, :2].T / np.tan(0.25 * deg)
    assert np.hypot(x, y).min() > -np.cos(phase * deg) - 1e-3
    assert fraction @ x > 0.3


@pytest.mark.parametrize("radius", [0.5, 0.9, 1.0, 1.3, 60.0])
def test_how_much_a_disc_hides(radius):
    """Against counts of points of the hidden disc, from external contact to one inside the
    other."""
    behind = Disc(np.array([0.0, 0.0, 1.0]), 1e-3, np.ones(1))
    place, _ = disc_points(behind, 2e-6)
    for along in np.linspace(abs(radius - 1) - 0.2, radius + 1.2, 9):
        way = np.array([np.sin(along * 1e-3), 0.0, np.cos(along * 1e-3)])
        front = Disc(way, radius * 1e-3, np.ones(1))
        assert front.hides(behind) == pytest.approx(front.covers(place).mean(), abs=2e-3)


def test_a_disc_of_millions_of_points_is_refused():
    """The Moon with pixels of an arc second, two points to a pixel."""
    moon = Disc(np.array([0.0, 0.0, 1.0]), 0.26 * deg, np.ones(1))
    with pytest.raises(ValueError, match="at most 1000 points to its radius, got 187"):
        disc_points(moon, deg / 7200)


def test_discs_that_touch():
    """From outside or inside, by the last digit: none or all, and no value outside [0, 1]."""
    draw = np.random.default_rng(0)
    for outer, inner in draw.uniform((1e-2, 1e-4), (1.1, 5e-3), (2000, 2)):
        behind = Disc(np.array([0.0, 0.0, 1.0]), inner, np.ones(1))
        for apart, wanted in ((outer - inner, 1.0), (outer + inner, 0.0)):
            for close in apart * (1 + np.array([-2e-16, 0.0, 2e-16])):
                way = np.array([np.sin(close), 0.0, np.cos(close)])
                fraction = Disc(way, outer, np.ones(1)).hides(behind)
                assert 0 <= fraction <= 1
                assert fraction == pytest.approx(wanted, abs=1e-5)


def test_a_new_moon_has_no_light():
    dark = Disc(np.array([0.0, 0.0, 1.0]), 0.004, np.ones(1), np.array([0.0, 0.0, 1.0]))
    place, fraction = disc_points(dark, 0.001)
    assert len(place) == len(fraction) == 0


@pytest.mark.parametrize("phase", [0.0, 45.0, 90.0, 135.0])
def test_a_far_earth_shines_as_a_lambert_sphere(phase):
    """E = 2/3 albedo (radius / distance)^2 ((pi - a) cos a + sin a) / pi of sunlight."""
    distance = 3e9
    a = phase * deg
    earth = earth_of(near_earth(distance, a))
    law = 2 / 3 * EARTH_ALBEDO * ((np.pi - a) * np.cos(a) + np.sin(a)) / np.pi
    sun = sunlight(at("2026-03-20").see("sun").distance)
    wanted = law * (EARTH_RADIUS / distance) ** 2 * sun.sum()
    source = earth.stray_source
    assert source.fraction.sum() * source.photon_irradiance.sum() == pytest.approx(wanted, rel=0.01)


def test_under_the_sun_the_near_earth_has_its_radiance():
    """From 500 km above the subsolar point: the disc's solid angle, and its mean cosine."""
    observer = near_earth(EARTH_RADIUS + 500e3, 0.0)
    earth = earth_of(observer)
    solid_angle = 2 * np.pi * (1 - np.cos(earth.disc.radius))
    nadir = earth.shine(earth.disc.direction[None])[0]
    assert nadir == pytest.approx(1, abs=1e-5)
    # The limb is 21.9 degrees of the ground away, where the Sun is as much lower.
    limb = np.arccos(EARTH_RADIUS / (EARTH_RADIUS + 500e3))
    assert np.cos(limb) * solid_angle < earth.stray_source.fraction.sum() < solid_angle


def test_at_night_it_is_dark():
    assert len(earth_of(near_earth(EARTH_RADIUS + 500e3, np.pi)).stray_source.fraction) == 0
