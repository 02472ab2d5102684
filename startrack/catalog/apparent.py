"""Catalog, date, observer -> Stars at their apparent places (parallax, aberration)."""

from dataclasses import dataclass

import numpy as np

from startrack.catalog.catalog import Catalog
from startrack.core import LIGHT_SPEED, Floats, Refused, Stars, installed_tables, printed, within

# The years for which ERFA states the error of epv00 (Moisson & Bretagnon 2001, refitted to DE405).
FIRST_YEAR, LAST_YEAR = 1900.0, 2100.0


@printed
@dataclass(frozen=True, eq=False)
class Observer:
    """Position and velocity of an observer.

    position  (3,) astronomical unit from the solar system's barycentre, ICRS axes
    velocity  (3,) m/s relative to the barycentre, ICRS axes
    """

    position: Floats
    velocity: Floats


def earth_observer(epoch: float, orbital_velocity: Floats | None = None) -> Observer:
    """An observer at the Earth's centre, or on a satellite near it.

    Source: astropy's built-in ephemeris (ERFA's epv00); nothing is downloaded.

    epoch             Julian year (TDB), in [1900, 2100]
    orbital_velocity  (3,) m/s of a satellite relative to the Earth's centre, ICRS axes
    Returns           the observer
    Raises            ValueError outside these years.
    Accuracy          model: a satellite is placed at the Earth's centre. numerical: 14 km and 5
                      mm/s, which are 1e-7 of the parallax and 2e-7 of the aberration.
    """
    from astropy import units  # costs 0.5 s, and only aberration and parallax need it
    from astropy.coordinates import get_body_barycentric_posvel
    from astropy.time import Time

    within(FIRST_YEAR, LAST_YEAR, epoch=epoch)
    with installed_tables():
        date = Time(epoch, format="jyear", scale="tdb")
        position, velocity = get_body_barycentric_posvel("earth", date, ephemeris="builtin")
    orbital = np.zeros(3) if orbital_velocity is None else np.asarray(orbital_velocity, float)
    if orbital.shape != (3,) or not np.isfinite(orbital).all():
        raise Refused(f"orbital_velocity must be three finite numbers, got {orbital_velocity}")
    speed = velocity.xyz.to_value(units.m / units.s)
    return Observer(position.xyz.to_value(units.au), speed + orbital)


def apparent(
    catalog: Catalog,
    epoch: float,
    observer_position: Floats | None = None,
    observer_velocity: Floats | None = None,
) -> Stars:
    """Directions in which an observer sees the stars, outside any atmosphere.

        u = place(epoch) - parallax * observer_position,   then aberration of u / |u|

    catalog            stars at their own epoch
    epoch              Julian year
    observer_position  (3,) astronomical unit from the barycentre; None leaves parallax out
    observer_velocity  (3,) m/s relative to the barycentre; None leaves aberration out
    Returns            the stars, in the order of the catalogue
    Accuracy           model: no light deflection by the Sun (4 mas at 90 deg from it, 41 mas at 11
                       deg), no radial velocity, no orbits of double stars.
    """
    place = catalog.place(epoch)
    if observer_position is not None:
        # A negative measured parallax is noise of a distant star; it counts as zero.
        place = place - np.maximum(catalog.parallax, 0)[:, None] * np.asarray(observer_position)
    direction = place / np.linalg.norm(place, axis=1, keepdims=True)
    if observer_velocity is not None:
        direction = aberrate(direction, np.asarray(observer_velocity, float))
    return Stars(catalog.identifier, direction, catalog.magnitude_g, catalog.colour)


def aberrate(direction: Floats, velocity: Floats) -> Floats:
    """Stellar aberration, by the Lorentz transformation of the light's direction.

        s' = (s / g + b + (s.b) b g / (1 + g)) / (1 + s.b),   b = velocity / c,
        g = 1 / sqrt(1 - b.b)

    Source: Urban & Seidelmann (2013), Explanatory Supplement to the Astronomical Almanac, 3rd
    ed., eq. (7.40), without its term of light deflection.

    direction  (n, 3) unit vectors towards the stars, for an observer at rest
    velocity   (3,) m/s of the observer
    Returns    (n, 3) unit vectors
    Raises     ValueError if the speed is not below the speed of light.
    Accuracy   numerical: 1e-16.
    """
    beta = velocity / LIGHT_SPEED
    if not beta @ beta < 1:
        raise Refused(f"observer_velocity must be below the speed of light, got {velocity} m/s")
    gamma = 1 / np.sqrt(1 - beta @ beta)
    along = (direction @ beta)[:, None]
    seen = (direction / gamma + beta + along * beta * gamma / (1 + gamma)) / (1 + along)
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)
