"""Air: what lies between the ground and the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.checks import non_negative, one_of, within
from startrack.units import Unit

AEROSOLS = ("none", "rural", "urban")


@dataclass(frozen=True)
class Air:
    """One state of the atmosphere; the defaults are a clear day in mid-latitude summer.

    aerosol     type of Shettle and Fenn (1979) below 100 km, or "none" for molecules alone
    visibility  metre, meteorological range at the ground: where contrast falls to 2 %
    water       kilogram / square metre of water vapour above the sea
    ozone       metre of pure ozone at standard conditions; 1e-5 m is a Dobson unit
    """

    aerosol: str = "rural"
    visibility: Annotated[float, Unit("m", "km")] = 23e3
    water: Annotated[float, Unit("kg / m2")] = 29.2
    ozone: Annotated[float, Unit("m", "mm")] = 3.32e-3

    def __post_init__(self) -> None:
        one_of(AEROSOLS, aerosol=self.aerosol)
        within(2e3, 150e3, visibility=self.visibility)
        non_negative(water=self.water, ozone=self.ozone)
