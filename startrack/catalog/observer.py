"""A date enters; where the observer is and how fast it moves, seen from the barycentre, leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from startrack.checks import within
from startrack.dates import installed_tables
from startrack.values import Floats

# The span in which ERFA's epv00 states its error (Moisson & Bretagnon 2001, refitted to DE405).
FIRST_YEAR, LAST_YEAR = 1900.0, 2100.0


@dataclass(frozen=True, eq=False)
class Observer:
    """Who looks at the stars.

    position  (3,) astronomical unit from the solar system's barycentre, ICRS axes
    velocity  (3,) m/s against the barycentre, ICRS axes
    """

    position: Floats
    velocity: Floats


def earth(epoch: float, orbital_velocity: Floats | None = None) -> Observer:
    """The Earth's centre, or a satellite near it.

    Source: astropy's built-in ephemeris (ERFA's epv00), nothing is downloaded.

    epoch             Julian year (TDB), in [1900, 2100]
    orbital_velocity  (3,) m/s of a satellite against the Earth's centre, ICRS axes
    Returns           the observer
    Errors            ValueError outside these years. 14 km and 5 mm/s: 1e-7 and 2e-7 of what
                      parallax and aberration need. A satellite's place is taken as the centre's.
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
        raise ValueError(f"orbital_velocity must be three finite numbers, got {orbital_velocity}")
    return Observer(
        position=position.xyz.to_value(units.au),
        velocity=velocity.xyz.to_value(units.m / units.s) + orbital,
    )
