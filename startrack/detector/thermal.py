"""Thermal: growth of the dark current with temperature, reset noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from startrack.core import BOLTZMANN, NON_NEGATIVE, POSITIVE, Parameters, Range, Unit

ELEMENTARY_CHARGE = 1.602176634e-19  # coulomb, exact in the SI of 2019


@dataclass(frozen=True)
class Thermal(Parameters):
    """Temperature of the detector, growth of its dark current, reset noise.

    Where `activation` is zero, the dark current doubles in steps of temperature:

        I(T) = I(reference) 2^((T - reference) / doubling)

    Otherwise it has an activation energy (diffusion: the band gap, 1.12 eV; generation: half):

        I(T) = I(reference) (T / reference)^(3/2) exp(-E / k (1 / T - 1 / reference))

    The reset noise is sqrt(k T C) / q, unless correlated double sampling removes it.

    Source: EMVA 1288 release 4.0, on the dark current, for the doubling; Widenhorn et al. (2002),
    Proc. SPIE 4669, 193, for the activation energy.
    """

    temperature: Annotated[float, Unit("K", absolute=True), Range(0, 500), "of the pixels"]
    reference: Annotated[float, Unit("K", absolute=True), POSITIVE,
        "of the dark_current of the detector"] = 293.15  # fmt: skip
    doubling: Annotated[float, Unit("K"), POSITIVE, "in which the dark current doubles"] = 8.0
    activation: Annotated[float, Unit("J", "eV"), NON_NEGATIVE,
        "joule, activation energy of the dark current; 0: it doubles in steps"] = 0.0  # fmt: skip
    capacitance: Annotated[float, Unit("F", "fF"), NON_NEGATIVE,
        "farad, of the sense node; 0 with correlated double sampling"] = 0.0  # fmt: skip

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
