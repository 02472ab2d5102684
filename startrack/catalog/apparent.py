"""A catalogue and an observer enter; the stars where the observer sees them leave."""

from __future__ import annotations

import numpy as np

from startrack.catalog.catalog import Catalog
from startrack.units import LIGHT_SPEED
from startrack.values import Floats, Stars


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
    observer_velocity  (3,) m/s against the barycentre; None leaves aberration out
    Returns            the stars, in the order of the catalogue
    Errors             model: no light deflection by the Sun (4 mas at 90 deg from it, 41 mas at
                       11 deg), no radial velocity, no orbits of double stars.
    """
    place = catalog.place(epoch)
    if observer_position is not None:
        # A negative parallax is noise around a distant star; it stands for no parallax.
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
    Errors     ValueError from the speed of light on. numerical: 1e-16.
    """
    beta = velocity / LIGHT_SPEED
    if not beta @ beta < 1:
        raise ValueError(f"observer_velocity must be below the speed of light, got {velocity} m/s")
    gamma = 1 / np.sqrt(1 - beta @ beta)
    along = (direction @ beta)[:, None]
    seen = (direction / gamma + beta + along * beta * gamma / (1 + gamma)) / (1 + along)
    return seen / np.linalg.norm(seen, axis=1, keepdims=True)
