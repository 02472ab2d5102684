"""DaySky: line of sight of a camera within or below the air, and place of the Sun."""

from __future__ import annotations

import math
from dataclasses import field
from typing import NamedTuple

import numpy as np

from startrack.core import Floats, Parameters, Range, Refused, Unit, deg, parameter
from startrack.space import horizon_axes, refraction, sun_direction

HIGHEST_SITE = 40e3  # metre
LOWEST_LINE = 10 * deg  # of a line of sight above the horizontal
MOST_AEROSOL = 2.0
DARKEST_CITY, DARKEST = 12.0, 26.0  # V magnitude per square arcsecond
ROUNDING = 1e-9  # radian


class SunPlace(NamedTuple):
    """Place of the Sun or the Moon.

    elevation  radian, above the horizontal
    distance   radian, from the line of sight
    """

    elevation: float
    distance: float


class DaySky(Parameters):
    """The sky for a camera within or below the air, with a fixed line of sight relative to the Sun.

    By day, in twilight and at night. The Sun's place is given by its elevation and distance from
    the line of sight. Or it follows from the scene's date, the place on the Earth and the azimuth
    of the line of sight; only then is there a Moon.
    """

    height: float = parameter(
        "of the camera above the sea; it is in an orbit where the scene has no sky",
        unit=Unit("m", "km"),
        limit=Range(0, HIGHEST_SITE),
    )
    elevation: float = parameter(
        "of the line of sight above the horizontal",
        unit=Unit("rad", "deg"),
        limit=Range(LOWEST_LINE, math.pi / 2),
    )
    sun_elevation: float | None = parameter(
        "of the Sun's centre above the horizontal; negative in twilight and at night. None: from "
        "date and place",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi / 2, math.pi / 2),
        default=None,
    )
    sun_distance: float | None = parameter(
        "of the Sun from the line of sight; None: from date and place",
        unit=Unit("rad", "deg"),
        limit=Range(0, math.pi),
        default=None,
    )
    latitude: float | None = parameter(
        "of the place, geodetic",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi / 2, math.pi / 2),
        default=None,
    )
    longitude: float | None = parameter(
        "of the place, to the east",
        unit=Unit("rad", "deg"),
        limit=Range(-math.pi, 2 * math.pi),
        default=None,
    )
    azimuth: float | None = parameter(
        "of the line of sight, from north over east",
        unit=Unit("rad", "deg"),
        limit=Range(-2 * math.pi, 2 * math.pi),
        default=None,
    )
    aerosol: float = parameter(
        "times the rural aerosol of Shettle and Fenn (1979) with 23 km of visibility at the ground "
        "and a background stratosphere; 0: molecules alone",
        limit=Range(0, MOST_AEROSOL),
        default=1.0,
    )
    albedo: float = parameter(
        "of the ground, or of clouds upon it, which lights the air from below",
        limit=Range(0, 1),
        default=0.3,
    )
    night_v: float | None = parameter(
        "V magnitude per square arcsecond of the night sky overhead without Moon and twilight, as "
        "a sky quality meter shows it: 21.6 far from cities, 18 in one. None: the natural sky",
        limit=Range(DARKEST_CITY, DARKEST),
        default=None,
    )
    stray_g: float | None = field(default=None, metadata={"computed": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        place = self.latitude, self.longitude, self.azimuth
        sun = self.sun_elevation, self.sun_distance
        if None not in sun and place == (None, None, None):
            self._check(SunPlace(self.sun_elevation or 0.0, self.sun_distance or 0.0))
        elif None in place or sun != (None, None):
            raise Refused(
                "sun_elevation and sun_distance must be given, or latitude, longitude and azimuth, "
                "and not some of both"
            )

    @property
    def dated(self) -> bool:
        """Whether the Sun's place follows from the date."""
        return self.latitude is not None

    def sun(self, date: str | None = None) -> SunPlace:
        """The Sun's place.

        date      UTC, where the sky is `dated`
        Accuracy  model: 10 arcsec
        """
        if self.latitude is None or self.longitude is None or self.azimuth is None:
            return SunPlace(self.sun_elevation or 0.0, self.sun_distance or 0.0)
        towards = sun_direction(str(date)) @ horizon_axes(self.latitude, self.longitude)
        return SunPlace(math.asin(float(towards[2])), self.distance_of(towards))

    def distance_of(self, towards: Floats) -> float:
        """Radian between the line of sight and a direction (3,) to east, north and up."""
        level, azimuth = math.cos(self.elevation), self.azimuth or 0.0
        line = np.array(
            [level * math.sin(azimuth), level * math.cos(azimuth), math.sin(self.elevation)]
        )
        return 2 * math.asin(min(float(np.linalg.norm(line - towards)) / 2, 1.0))

    def _check(self, sun: SunPlace) -> None:
        least = abs(sun.elevation - self.elevation)
        most = math.pi - abs(sun.elevation + self.elevation)
        if not least - ROUNDING <= sun.distance <= most + ROUNDING:
            raise Refused(
                f"sun_distance must lie in [{least / deg:.4g}, {most / deg:.4g}] deg between a "
                f"Sun at {sun.elevation / deg:.4g} deg and a line of sight at "
                f"{self.elevation / deg:.4g} deg, got {sun.distance / deg:.4g} deg"
            )

    def refraction(self, elevation: float | None = None) -> float:
        """Radian: apparent lift of a star by the air; by default of the line of sight.

        elevation  radian, without air
        Accuracy   that of `startrack.space.refraction`
        """
        given = self.elevation if elevation is None else elevation
        return float(refraction(np.array(given), self.height))
