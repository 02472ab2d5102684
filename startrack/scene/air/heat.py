"""Temperature -> radiance of a blackbody in bands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from startrack.units import BOLTZMANN, LIGHT_SPEED, PLANCK

Floats = NDArray[np.float64]

COLDEST, HOTTEST = 50.0, 3000.0  # kelvin, of the spline
NODES = 600


def planck(wavelength: Floats, temperature: Floats | float) -> Floats:
    """Spectral radiance of a blackbody.

        B = 2 h c^2 / wavelength^5 / (exp(h c / (wavelength k T)) - 1)

    wavelength, temperature  metre, kelvin, of shapes that broadcast; temperature above 0
    Returns                  watt / m^2 / sr / m
    """
    with np.errstate(over="ignore"):
        exponent = PLANCK * LIGHT_SPEED / (BOLTZMANN * wavelength * temperature)
        return 2 * PLANCK * LIGHT_SPEED**2 / wavelength**5 / np.expm1(exponent)


@dataclass(frozen=True, eq=False)
class Heat:
    """Radiance of a blackbody in each band, as a spline of its logarithm over 1 / T."""

    spline: CubicSpline

    def __call__(self, temperature: Floats) -> Floats:
        """(n, b) of (n,) kelvin.

        Errors  ValueError where a temperature is no number from 50 to 3000 K.
                numerical: 1e-6.
        """
        temperature = np.asarray(temperature, np.float64)
        good = (temperature >= COLDEST) & (temperature <= HOTTEST)
        if not good.all():
            raise ValueError(
                f"temperature must lie in [{COLDEST:g}, {HOTTEST:g}] K, got {temperature[~good][0]}"
            )
        return np.exp(self.spline(-1 / temperature))


def heat_of(spectrum: Floats, response: Floats) -> Heat:
    """The bands' Heat.

    spectrum  (f,) metre
    response  (b, f), as for `in_bands`
    """
    inverse = np.linspace(-1 / COLDEST, -1 / HOTTEST, NODES)
    weights = response * np.gradient(spectrum)
    bands = planck(spectrum, -1 / inverse[:, None]) @ weights.T
    return Heat(CubicSpline(inverse, np.log(np.maximum(bands, 1e-300))))
