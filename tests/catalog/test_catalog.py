"""Space motion, against astropy's (ERFA's starpm)."""

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import SkyCoord
from astropy.time import Time

from startrack.catalog import Catalog
from startrack.catalog.catalog import join
from startrack.core.units import arcsec, deg

MAS = arcsec / 1000
# (ra, dec [deg], pm_ra, pm_dec [mas/yr], parallax [mas]): Barnard's star (Gaia DR3), 61 Cygni B
# (Gaia DR3), and stars near the poles that move as fast as Polaris and as fast as anything.
STARS = np.array(
    [
        [269.44850252543836, 4.739420051112412, -801.551, 10362.394, 546.976],
        [316.753662752556, 38.75607277205679, 4105.976428209489, 3155.9416398273515, 286.00535],
        [37.946143, 89.26413778, 44.48, -11.85, 7.54],
        [10.0, 89.9999, 3000.0, 4000.0, 300.0],
        [200.0, -89.9995, -10000.0, 2000.0, 500.0],
        [0.0001, 0.0, -500.0, 0.0, 100.0],
    ]
)


def catalog(rows: np.ndarray = STARS) -> Catalog:
    ra, dec, pm_ra, pm_dec, parallax = rows.T
    n = len(rows)
    return Catalog(
        np.arange(n),
        ra * deg,
        dec * deg,
        2016.0,
        pm_ra * MAS,
        pm_dec * MAS,
        np.ones(n, bool),
        parallax * MAS,
        np.linspace(1, 2, n),
        np.zeros(n),
    )


def astropy_moved(epoch: float, radial_velocity: float = 0.0) -> SkyCoord:
    ra, dec, pm_ra, pm_dec, parallax = STARS.T
    then = SkyCoord(
        ra * u.deg,
        dec * u.deg,
        distance=1000 / parallax * u.pc,
        pm_ra_cosdec=pm_ra * u.mas / u.yr,
        pm_dec=pm_dec * u.mas / u.yr,
        radial_velocity=np.full(len(ra), radial_velocity) * u.km / u.s,
        obstime=Time(2016.0, format="jyear", scale="tdb"),
    )
    return then.apply_space_motion(Time(epoch, format="jyear", scale="tdb"))


@pytest.mark.parametrize("epoch", [1900.0, 2016.0, 2026.0, 2200.0])
def test_place_is_astropys(epoch):
    place = catalog().place(epoch)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    expected = astropy_moved(epoch).cartesian.xyz.value.T
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    # astropy's own definition of proper motion lets the light time change as the star recedes.
    assert np.linalg.norm(place - expected, axis=1).max() < 0.2 * MAS * (1 + abs(epoch - 2016))


def test_propagated_motion_and_parallax_are_astropys():
    moved, expected = catalog().propagate(2116.0), astropy_moved(2116.0)
    np.testing.assert_allclose(moved.right_ascension, expected.ra.rad, atol=1e-7)
    np.testing.assert_allclose(moved.declination, expected.dec.rad, atol=2e-8)
    np.testing.assert_allclose(moved.pm_ra / MAS, expected.pm_ra_cosdec.value, atol=3)
    np.testing.assert_allclose(moved.pm_dec / MAS, expected.pm_dec.value, atol=3)
    np.testing.assert_allclose(moved.parallax / MAS, 1000 / expected.distance.pc, rtol=1e-4)


def test_place_and_propagate_agree():
    moved = catalog().propagate(2100.0)
    place = catalog().place(2100.0)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    assert moved.epoch == 2100.0
    np.testing.assert_allclose(moved.place(2100.0), place, atol=1e-15)


def test_there_and_back():
    # What is lost is the radial velocity that the motion gains on its way: the motion cubed.
    back = catalog().propagate(2116.0).propagate(2016.0)
    error = np.linalg.norm(back.place(2016.0) - catalog().place(2016.0), axis=1)
    motion = np.hypot(STARS[:, 2], STARS[:, 3]) * MAS * 100
    assert (error < 1.05 * motion**3 + 1e-15).all()


def test_radial_velocity_costs_barnards_star_what_the_docstring_says():
    place = catalog().place(2026.0)[0]
    expected = astropy_moved(2026.0, -110.5).cartesian.xyz.value.T[0]
    apart = np.linalg.norm(place / np.linalg.norm(place) - expected / np.linalg.norm(expected))
    assert 50 < apart / MAS < 75


def test_index_and_join():
    stars = catalog()
    assert len(stars[2:4]) == 2
    assert stars[np.array([5, 0])].identifier.tolist() == [5, 0]
    assert stars[stars.magnitude_g > 1.5].magnitude_g.min() > 1.5
    both = join(stars[:2], stars[2:])
    np.testing.assert_array_equal(both.declination, stars.declination)
    with pytest.raises(ValueError, match="epoch must be the same to join, got 2016"):
        join(stars, stars.propagate(2020.0))


def test_columns_must_have_one_length():
    with pytest.raises(ValueError, match=r"colour must have the shape \(6,\), got \(5,\)"):
        Catalog(**{**vars(catalog()), "colour": np.zeros(5)})
