"""Thermal: growth of the dark current with temperature, reset noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from startrack.core import BOLTZMANN, Unit, non_negative, positive, within

ELEMENTARY_CHARGE = 1.602176634e-19  # coulomb, exact in the SI of 2019


@dataclass(frozen=True)
class Thermal:
    """Temperature of the detector, growth of its dark current, reset noise.

    Where `activation` is zero, the dark current doubles in steps of temperature:

        I(T) = I(reference) 2^((T - reference) / doubling)

    Otherwise it has an activation energy (diffusion: the band gap, 1.12 eV; generation: half):

        I(T) = I(reference) (T / reference)^(3/2) exp(-E / k (1 / T - 1 / reference))

    The reset noise is sqrt(k T C) / q, unless correlated double sampling removes it.

    Source: EMVA 1288 release 4.0, on the dark current, for the doubling; Widenhorn et al. (2002),
    Proc. SPIE 4669, 193, for the activation energy.

    temperature  kelvin, of the pixels
    reference    kelvin, of the dark_current of the detector
    doubling     kelvin, in which the dark current doubles
    activation   joule, activation energy of the dark current; 0: it doubles in steps
    capacitance  farad, of the sense node; 0 with correlated double sampling
    """

    temperature: Annotated[float, Unit("K", absolute=True)]
    reference: Annotated[float, Unit("K", absolute=True)] = 293.15
    doubling: Annotated[float, Unit("K")] = 8.0
    activation: Annotated[float, Unit("J", "eV")] = 0.0
    capacitance: Annotated[float, Unit("F", "fF")] = 0.0

    def __post_init__(self) -> None:
        within(0, 500, temperature=self.temperature)
        positive(reference=self.reference, doubling=self.doubling)
        non_negative(activation=self.activation, capacitance=self.capacitance)

    @property
    def growth(self) -> float:
        """Dark current over that at the reference; zero at 0 K."""
        if self.temperature == 0:
            return 0.0
        if self.activation:
            cold = 1 / self.temperature - 1 / self.reference
            power = (self.temperature / self.reference) ** 1.5
            return power * math.exp(-self.activation / BOLTZMANN * cold)
        return float(2 ** ((self.temperature - self.reference) / self.doubling))

    @property
    def reset_noise(self) -> float:
        """Electron rms."""
        return math.sqrt(BOLTZMANN * self.temperature * self.capacitance) / ELEMENTARY_CHARGE
