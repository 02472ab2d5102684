"""Scene: date, observer, background and bodies besides the stars; the possible lights."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from startrack import core
from startrack.core import (
    FINITE,
    NON_NEGATIVE,
    POSITIVE,
    YEAR,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    within,
)
from startrack.scene.day_sky import DaySky
from startrack.space import FIRST_YEAR, LAST_YEAR

LIMBS = ("molecules", "rural")  # air of the Earth's bright limb
DARK = 40.0  # magnitude per square arcsecond, below any sky: stands for no background
J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
JULIAN_YEAR = timedelta(seconds=YEAR)


class LightKind(NamedTuple):
    """A light of the sky.

    varies   whether it varies over the field, at all or some attitudes
    stray    whether it also varies as stray light through a baffle
    dated    whether it needs the date, because it moves in time
    diffuse  function of a `LightInput`, for light in front of everything; None: `illuminate` adds
             it at its distance
    """

    varies: bool = False
    stray: bool = False
    dated: bool = True
    diffuse: Callable[[Any], Iterable[core.DiffuseLight]] | None = None


# By their names in the key scene.lights.
LIGHTS = {
    "zodiacal": LightKind(varies=True),
    "starlight": LightKind(varies=True, dated=False),
    "planets": LightKind(),
    "sun": LightKind(stray=True),
    "moon": LightKind(stray=True),
    "earth": LightKind(varies=True, stray=True),
    "airglow": LightKind(varies=True),
    "cities": LightKind(),
}


def added(magnitudes: Sequence[float]) -> float:
    """Magnitude of the sum of several lights."""
    return -2.5 * math.log10(sum(10 ** (-0.4 * magnitude) for magnitude in magnitudes))


class ObserverOrbit(Parameters):
    """A circular orbit around the Earth."""

    altitude: float = parameter("above the equator's radius", unit=Unit("m", "km"), limit=POSITIVE)
    inclination: float = parameter(
        "of the orbit to the equator", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    node: float = parameter(
        "right ascension of the ascending node", unit=Unit("rad", "deg"), limit=FINITE, default=0.0
    )
    phase: float | None = parameter(
        "from the node at the date; None: each trial draws it",
        unit=Unit("rad", "deg"),
        limit=FINITE,
        default=None,
    )


class Scene(Parameters):
    """Background and bodies besides the stars, date and observer.

    Absent lights cost no time and draw no random number.
    """

    background_g: float | None = parameter(
        "magnitude per square arcsecond in Gaia's G of a uniform background, None for none. It "
        "replaces the zodiacal light, which is near V 23.3 at high ecliptic latitude and near "
        "22.1 on the ecliptic at 90 degrees from the Sun.",
        limit=Range(-30, DARK),
        default=None,
    )
    lights: tuple[str, ...] = parameter(
        'which of LIGHTS are present: "zodiacal" light; "starlight" of stars below the '
        'catalogue\'s limit and of the dust that they light; "planets", the "sun" and the '
        '"moon", in the field and through the baffle; the "earth" under an orbit, its "airglow" '
        'and its "cities" at night. Sun, Moon and Earth hide the stars behind them, and each '
        "other's light. Diffuse light by user code, see docs/extensions.md, too; it is "
        "in front of everything",
        limit=Range(choices=LIGHTS, code="lights"),
        default=(),
    )
    date: str | None = parameter('UTC, as "2026-03-20T12:00:00"', default=None)
    days: float = parameter(
        "each trial draws its date within this number of days after `date`",
        limit=NON_NEGATIVE,
        default=0.0,
    )
    orbit: ObserverOrbit | None = parameter(
        "around the Earth; None: the observer is at the Earth's centre, without an Earth",
        default=None,
    )
    place: tuple[float, ...] | None = parameter(
        "from the solar system's barycentre, ICRS axes, instead", unit=Unit("m", "AU"), default=None
    )
    limb: str = parameter(
        "air of the Earth's bright limb: molecules alone, or with the rural aerosol of Shettle "
        "and Fenn, 23 km of visibility and their stratosphere's background",
        limit=Range(choices=LIMBS),
        default="molecules",
    )
    sky: DaySky | None = parameter(
        "The sky above a camera within or below the air, in place of `background_g`; "
        "without it the camera is above the air.",
        default=None,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.date is not None:
            within(FIRST_YEAR, LAST_YEAR - 1 - self.days / 365, **{"year of date": self.start.year})
        self._refuse_contradictions()

    @property
    def sky_g(self) -> float:
        """`background_g`, or DARK without a background."""
        return DARK if self.background_g is None else self.background_g

    def with_stray_light(self, magnitude_g: float) -> Scene:
        """The scene with more light over the whole field.

        magnitude_g  per square arcsecond
        """
        if self.sky is not None:
            return replace(self, sky=replace(self.sky, stray_g=magnitude_g))
        return replace(self, background_g=added((magnitude_g, self.sky_g)))

    def _refuse_contradictions(self) -> None:
        if "zodiacal" in self.lights and self.background_g is not None:
            raise Refused(
                "background_g, a constant zodiacal light, must be left out if lights has zodiacal, "
                f"got {self.background_g:g}"
            )
        if self.sky is not None:
            self._refuse_beside_sky(self.sky)
        if self.dated and self.date is None:
            raise Refused(f"date must be given for {', '.join(self.dated)}, got none")
        if self.orbit and self.place:
            raise Refused("orbit and place must not both be given, as each is the observer's")
        if "earth" in self.lights and not self.orbit:
            raise Refused("orbit must be given where lights has earth, got none")
        for light in {"airglow", "cities"}.intersection(self.lights):
            if "earth" not in self.lights:
                raise Refused(f"lights must have earth where they have {light}")
        if self.place is not None:
            if len(self.place) != 3:
                raise Refused(f"place must have three coordinates, got {len(self.place)}")
            for coordinate in self.place:
                core.finite(place=coordinate)

    def _refuse_beside_sky(self, sky: DaySky) -> None:
        beside = {
            "background_g": self.background_g is not None,
            "lights": bool(self.lights),
            "orbit": self.orbit is not None,
            "place": self.place is not None,
            "days": self.days > 0,
        }
        for name in (key for key, given in beside.items() if given):
            raise Refused(f"{name} must be left out if sky is given, which sets all light")
        if sky.dated:
            if self.date is None:
                raise Refused("date must be given where sky has latitude and longitude, got none")
            try:
                sky.sun(self.date)
            except Refused as refused:
                raise refused.within("sky") from None

    @property
    def dated(self) -> list[str]:
        """The lights that move in time."""
        return [name for name in self.lights if name in LIGHTS and LIGHTS[name].dated]

    @property
    def start(self) -> datetime:
        """The date, UTC.

        Raises  ValueError if it is not one.
        """
        try:
            date = datetime.fromisoformat(self.date or "")
            return date.astimezone(UTC) if date.tzinfo else date.replace(tzinfo=UTC)
        except (ValueError, OverflowError):
            raise Refused(
                f"date must be written as 2026-03-20T12:00:00, got {self.date!r}"
            ) from None

    @property
    def years(self) -> tuple[float, float]:
        """First and last Julian year of the trials, for a scene with a date.

        Raises    ValueError if the date is invalid.
        Accuracy  numerical: 70 s, because UTC is used for TDB.
        """
        first = 2000 + (self.start - J2000) / JULIAN_YEAR
        return first, first + timedelta(days=self.days) / JULIAN_YEAR
