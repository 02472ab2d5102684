"""Begin and duration of a mission -> Sun, Moon, planets and Earth's axes, as tables over time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from startrack.core import LIGHT_SPEED, Floats, installed_tables, utc

PLANETS = ("mercury", "venus", "mars", "jupiter", "saturn")
DAY = 86400.0
KNOT = 0.125 * DAY  # second between two entries of the tables
SIDEREAL = math.tau * 1.00273790935 / DAY  # radian / second
PAD = 4  # entries beyond both ends, where a cubic spline is worse


@dataclass(frozen=True, eq=False)
class Bodies:
    """Sun, Moon, planets, velocity and axes of the Earth at SI seconds after a mission's begin.

    `table` has 19 columns: Sun and Moon (metre from the Earth's centre at the time when their
    light was emitted, ICRS axes), the Earth's velocity (m / s, barycentric), the rows of the matrix
    teme_to_icrs, and the part of Greenwich's mean sidereal time (radian, IAU 1982) that is not
    steady. `planets` has unit vectors.

    Accuracy  model: astropy's built-in ephemeris: Sun 1 arcsec, Moon 10 arcsec, planets 40 arcsec
              between 1900 and 2100. numerical: 0.02 arcsec between the entries of the tables.
    """

    table: CubicSpline
    planets: CubicSpline

    def at(self, second: Floats) -> Floats:
        """(19, n) columns of the table."""
        return np.ascontiguousarray(self.table(second).T)

    def planets_at(self, second: Floats) -> Floats:
        """(5, 3, n) unit vectors in the order of PLANETS, from the Earth's centre."""
        return np.ascontiguousarray(self.planets(second).T).reshape(len(PLANETS), 3, -1)


def bodies_of(begin: str, duration: float) -> Bodies:
    """The tables for a mission, with eight entries a day; each takes up to a millisecond."""
    from astropy.coordinates import get_body_barycentric

    count = math.ceil(duration / KNOT) + 1 + 2 * PAD
    second = KNOT * (np.arange(count) - PAD)
    with installed_tables():
        from astropy import units

        date = utc(begin) + second * units.s
        day = date.tdb
        earth = _metre(get_body_barycentric("earth", day, ephemeris="builtin"))
        seen = [
            _seen_from_earth(name, day, earth) for name in ("sun", "moon", *PLANETS)
        ]  # fmt: skip
        axes = _teme_to_icrs(date)
        greenwich = date.sidereal_time("mean", "greenwich", model="IAU1982").rad
    path = CubicSpline(second, earth)
    steady = np.unwrap(greenwich - SIDEREAL * second)
    table = np.concatenate(
        [seen[0], seen[1], path(second, 1), axes.reshape(-1, 9), steady[:, None]], axis=1
    )
    planets = np.concatenate(
        [one / np.linalg.norm(one, axis=1, keepdims=True) for one in seen[2:]], axis=1
    )
    return Bodies(CubicSpline(second, table), CubicSpline(second, planets))


def _seen_from_earth(name: str, day: Any, earth: Floats) -> Floats:
    """(n, 3) metre from the Earth's centre to a body when its light was emitted."""
    from astropy import units
    from astropy.coordinates import get_body_barycentric

    late = np.zeros(len(earth))
    for _ in range(2):  # the second is (v / c)^2 off, 0.002 arcsec
        emitted = day - late * units.s
        line = _metre(get_body_barycentric(name, emitted, ephemeris="builtin")) - earth
        late = np.linalg.norm(line, axis=1) / LIGHT_SPEED
    return line


def _metre(position: Any) -> Floats:
    from astropy import units

    return np.asarray(position.xyz.to_value(units.m)).T


def _teme_to_icrs(date: Any) -> Floats:
    """(n, 3, 3) matrices at dates, by astropy (ERFA); the Earth's rotation cancels in them."""
    from astropy import units
    from astropy.coordinates import GCRS, TEME, CartesianRepresentation

    dates = np.repeat(date, 3)
    count = len(dates) // 3
    unit = CartesianRepresentation(np.tile(np.eye(3), count) * units.m)
    turned = TEME(unit, obstime=dates).transform_to(GCRS(obstime=dates)).cartesian.xyz.value
    # The columns of each matrix are the images of the three axes.
    return np.asarray(turned.reshape(3, count, 3).transpose(1, 0, 2))


SUN_COLUMNS, MOON_COLUMNS, SPEED_COLUMNS = slice(0, 3), slice(3, 6), slice(6, 9)
AXES_COLUMNS, GREENWICH_COLUMN = slice(9, 18), 18
