"""Where each pixel looks and what is there enter; at-sensor radiance in five terms leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from startrack.core import BOLTZMANN, LIGHT_SPEED, PLANCK, Floats
from startrack.earth.atmosphere.look_up import FineTable, Sight, look_up

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

        Raises    ValueError where a temperature is no number from 50 to 3000 K.
        Accuracy  numerical: 1e-6.
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


Singles = NDArray[np.float32]
Reals = NDArray[np.floating[Any]]

PIXELS = 2**15  # at a time, so that what is computed stays in the cache


class Terms(NamedTuple):
    """The five terms of the radiance at the sensor, (n, b) each, watt / m^2 / sr in each band.

    Source: Krutz et al. (2011), eq. (1).

    direct     sunlight that the ground reflects
    indirect   light of sky, air and slopes around that the ground reflects
    scattered  light that the air scatters, from the Sun and from the ground around
    emitted    heat of the ground
    thermal    heat of the air, straight or reflected
    """

    direct: Singles
    indirect: Singles
    scattered: Singles
    emitted: Singles
    thermal: Singles

    @property
    def total(self) -> Singles:
        """(n, b) watt / m^2 / sr."""
        return self.direct + self.indirect + self.scattered + self.emitted + self.thermal


def radiance(
    table: FineTable,
    sight: Sight,
    reflectance: Reals,
    surroundings: Reals,
    heat: Heat | None = None,
    temperature: Floats | None = None,
    air_temperature: float = 275.0,
) -> Terms:
    """Radiance of n pixels of ground.

        L_em = (1 - rho) B(T) t
        L_th = rise + rho fall

    with t the transmittance between ground and sensor. Where the table knows nothing of the air's
    heat, the air is taken for isothermal: rise = (1 - t) B(T_air), fall = rise t.

    Source: Krutz et al. (2011), eqs. (1) to (3).

    reflectance      (n, b) or (b,) 1
    surroundings     (b,) 1, mean reflectance of the ground around
    heat             of the bands; None where nothing is warm enough to be seen
    temperature      (n,) kelvin, of the ground; needed with `heat`
    air_temperature  kelvin, one for all the air, where the table has no heat of its own
    Raises           ValueError as `look_up` and `Heat`; TypeError where heat has no temperature.
    Accuracy         model: isothermal air over a black ground of its own temperature gives Planck's
                     law exactly; it errs by some per cent of L_th in the windows and more in the
                     bands of gases.
    """
    count, bands = len(sight.height), table.backscatter.shape[1]
    out = Terms(*np.zeros((5, count, bands), np.float32))
    reflectance = np.broadcast_to(reflectance, (count, bands))
    for first in range(0, count, PIXELS):
        some = slice(first, first + PIXELS)
        part = Sight(*(values[some] for values in sight))
        lit = look_up(table, part, reflectance[some], surroundings)
        for term, values in zip(out, lit, strict=False):
            term[some] = values
    if heat is not None:
        if temperature is None:
            raise TypeError("temperature must be given with heat, got None")
        through = table.heat(table.through, sight)
        if table.rise is None or table.fall is None:
            rise = heat(np.array([air_temperature])) * (1 - through)
            fall = rise * through
        else:
            rise, fall = table.heat(table.rise, sight), table.heat(table.fall, sight)
        out.emitted[:] = (1 - reflectance) * heat(temperature) * through
        out.thermal[:] = rise + reflectance * fall
    return out
