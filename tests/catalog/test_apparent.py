"""Parallax and aberration, against ERFA and astropy's GCRS."""

import erfa
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, SkyCoord, get_sun
from astropy.time import Time

from startrack.catalog import Observer, apparent, earth_observer
from startrack.catalog.apparent import aberrate
from startrack.core.units import LIGHT_SPEED, arcsec

from .test_catalog import MAS, STARS, catalog

FAR_FROM_THE_SUN = 1e12  # au, so that ERFA's term of the Sun's gravity vanishes


def sphere(n: int, seed: int = 1) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("speed", [30e3, 0.5 * LIGHT_SPEED])
def test_aberration_is_erfas(speed):
    stars, velocity = sphere(500), speed * sphere(1, 2)[0]
    beta = velocity / LIGHT_SPEED
    expected = erfa.ab(stars, beta, FAR_FROM_THE_SUN, np.sqrt(1 - beta @ beta))
    np.testing.assert_allclose(aberrate(stars, velocity), expected, atol=1e-15)


def test_aberration_of_the_year_is_20_5_arcsec():
    largest = 0.0
    for epoch in np.arange(2026, 2027, 0.05):
        stars = sphere(2000)
        seen = aberrate(stars, earth_observer(epoch).velocity)
        largest = max(largest, np.linalg.norm(seen - stars, axis=1).max() / arcsec)
    assert largest == pytest.approx(20.5, abs=0.35)  # 20.49552 and the orbit's 1.7 %


def test_aberration_of_a_low_orbit_is_5_2_arcsec():
    # 7.6 km/s across the line of sight: references, README of the published values.
    seen = aberrate(np.array([[1.0, 0, 0]]), np.array([0, 7.6e3, 0]))
    assert seen[0, 1] / arcsec == pytest.approx(5.2, abs=0.05)
    assert seen[0, 1] > 0  # towards where the observer moves


@pytest.mark.parametrize("epoch", [2026.1, 2026.4, 2026.7, 1975.3])
def test_all_together_is_astropys_gcrs(epoch):
    date = Time(epoch, format="jyear", scale="tdb")
    observer = earth_observer(epoch)
    seen = apparent(catalog(), epoch, observer.position, observer.velocity).direction
    ra, dec, pm_ra, pm_dec, parallax = STARS.T
    stars = SkyCoord(
        ra * u.deg,
        dec * u.deg,
        distance=1000 / parallax * u.pc,
        pm_ra_cosdec=pm_ra * u.mas / u.yr,
        pm_dec=pm_dec * u.mas / u.yr,
        radial_velocity=np.zeros(len(ra)) * u.km / u.s,
        obstime=Time(2016.0, format="jyear", scale="tdb"),
    ).apply_space_motion(date)
    position = SkyCoord(stars.ra, stars.dec, distance=stars.distance)
    expected = position.transform_to(GCRS(obstime=date)).cartesian.xyz.value.T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    from_sun = get_sun(date).separation(position.transform_to(GCRS(obstime=date))).rad
    deflection = 4.07 * MAS / np.tan(from_sun / 2)  # left out in startrack
    slack = 0.2 * MAS * (1 + abs(epoch - 2016))
    apart = np.linalg.norm(seen - expected, axis=1)
    assert (apart < 1.1 * deflection + slack).all()


def test_parallax_draws_an_ellipse_of_the_parallax():
    star = catalog(np.array([[270.0, 66.56, 0, 0, 300.0]]))  # the pole of the ecliptic
    epochs = 2016 + np.arange(0, 1, 0.02)
    seen = np.array([apparent(star, e, earth_observer(e).position).direction[0] for e in epochs])
    radius = np.linalg.norm(seen - star.place(2016.0)[0], axis=1) / MAS
    assert radius.min() == pytest.approx(300 * 0.983, abs=4)
    assert radius.max() == pytest.approx(300 * 1.017, abs=4)
    # In January the Earth stands towards (-x, +y) of the Sun, so the star leans to (+x, -y).
    assert np.sign(seen[0] - star.place(2016.0)[0])[0] > 0


def test_negative_parallax_is_none():
    star = catalog(np.array([[10.0, 20.0, 0, 0, -5.0]]))
    np.testing.assert_array_equal(
        apparent(star, 2016.0, np.array([1.0, 0, 0])).direction, apparent(star, 2016.0).direction
    )


def test_orbital_velocity_is_added():
    orbit = np.array([0.0, 7600.0, 0.0])
    with_it, without = earth_observer(2026.0, orbit), earth_observer(2026.0)
    assert isinstance(with_it, Observer)
    np.testing.assert_allclose(with_it.velocity - without.velocity, orbit, atol=1e-9)
    assert np.linalg.norm(without.velocity) == pytest.approx(29.8e3, rel=0.02)
    assert np.linalg.norm(without.position) == pytest.approx(1.0, abs=0.03)


def test_refusals():
    with pytest.raises(ValueError, match=r"epoch must lie in \[1900, 2100\], got 2150"):
        earth_observer(2150.0)
    with pytest.raises(ValueError, match="orbital_velocity must be three finite numbers"):
        earth_observer(2026.0, np.array([1.0, 2.0]))
    with pytest.raises(ValueError, match="must be below the speed of light"):
        aberrate(np.array([[1.0, 0, 0]]), np.array([LIGHT_SPEED, 0, 0]))
