"""Requirements: what a design must meet before its accuracy counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from startrack.core import Unit, non_negative, positive, whole, within
from startrack.design.case import Case


@dataclass(frozen=True)
class Requirements:
    """Limits, and the coefficients of the cost models behind them.

        mass   = mass_fixed + mass_per_volume * aperture^3
        volume = volume_fixed + pi / 4 aperture^2 * length_ratio * focal length
        power  = power_fixed + energy_per_bit * data rate
        cost   = cost_fixed + cost_of_metre * aperture^cost_power

    The models are proxies: a lens of one shape grows in all directions with its aperture, a tube
    is as long as its focal length asks, and the electronics pay for each bit. Their coefficients
    are inputs, not results, and those of mass, volume and power are assumptions of the usual size.
    Source of the cost: NASA Marshall's model of 47 telescopes, whose cost grows as aperture^1.7
    and is 20 million dollars for one metre on the ground (NTRS 20205010427); a star tracker's lens
    is far below the telescopes that it rests on, so that only ratios mean something.

    max_volume, max_data_rate, max_cost  None where there is no such limit
    min_stars         stars above the detection threshold that `sky_fraction` of the sky must show
    min_availability  fraction of trials with a right attitude; `optimize` shows it by a lower bound
    """

    OLD_KEYS: ClassVar[Mapping[str, str]] = {"sky_share": "sky_fraction"}

    max_mass: Annotated[float, Unit("kg")] = 1.0
    mass_fixed: Annotated[float, Unit("kg")] = 0.15
    mass_per_volume: Annotated[float, Unit("kg / m3")] = 6000.0
    max_power: Annotated[float, Unit("W")] = 2.0
    power_fixed: Annotated[float, Unit("W")] = 0.4
    energy_per_bit: Annotated[float, Unit("J / bit", "nJ / bit")] = 20e-9
    max_volume: Annotated[float | None, Unit("m3", "cm3")] = None
    volume_fixed: Annotated[float, Unit("m3", "cm3")] = 100e-6
    length_ratio: float = 2.0
    max_data_rate: Annotated[float | None, Unit("bit / s", "Mbit / s")] = None
    max_cost: float | None = None
    cost_fixed: float = 0.0
    cost_of_metre: float = 20e6
    cost_power: float = 1.7
    min_update_rate: Annotated[float, Unit("Hz")] = 1.0
    min_stars: int = 5
    sky_fraction: float = 0.99
    min_availability: float = 0.99

    def __post_init__(self) -> None:
        positive(max_mass=self.max_mass, max_power=self.max_power)
        for name in ("max_volume", "max_data_rate", "max_cost"):
            if getattr(self, name) is not None:
                positive(**{name: getattr(self, name)})
        positive(length_ratio=self.length_ratio, cost_power=self.cost_power)
        non_negative(
            volume_fixed=self.volume_fixed,
            cost_fixed=self.cost_fixed,
            cost_of_metre=self.cost_of_metre,
            mass_fixed=self.mass_fixed,
            mass_per_volume=self.mass_per_volume,
            power_fixed=self.power_fixed,
            energy_per_bit=self.energy_per_bit,
            min_update_rate=self.min_update_rate,
        )
        whole(1, 100, min_stars=self.min_stars)
        within(0, 1, sky_fraction=self.sky_fraction, min_availability=self.min_availability)

    def mass(self, case: Case) -> float:
        """Kilogram."""
        return self.mass_fixed + self.mass_per_volume * case.instrument.optics.aperture**3

    def power(self, case: Case) -> float:
        """Watt."""
        return self.power_fixed + self.energy_per_bit * case.instrument.detector.data_rate

    def volume(self, case: Case) -> float:
        """Cubic metre."""
        optics = case.instrument.optics
        tube = math.pi / 4 * optics.aperture**2 * self.length_ratio * optics.focal_length
        return self.volume_fixed + tube

    def data_rate(self, case: Case) -> float:
        """Bit per second."""
        return case.instrument.detector.data_rate

    def cost(self, case: Case) -> float:
        """In the unit of `cost_of_metre`."""
        return (
            self.cost_fixed + self.cost_of_metre * case.instrument.optics.aperture**self.cost_power
        )
