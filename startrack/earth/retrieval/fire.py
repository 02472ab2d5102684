"""Excess radiance of a cluster of pixels -> radiative power, temperature and area of its fire."""

import numpy as np
from scipy.constants import Stefan_Boltzmann

from startrack.core import Floats
from startrack.earth.atmosphere import ThermalRadiance

LOW, HIGH = 650.0, 1350.0  # kelvin, range of temperatures for the fit of the power law
NODES = 141
COOLEST, HOTTEST = 350.0, 2000.0  # kelvin, range of retrieved temperatures
STEPS = 331


def power_coefficient(heat: ThermalRadiance) -> float:
    """The coefficient of the power law of a band's radiance over temperature.

        B(T) ~ a T^4,   fitted to ln B from 650 to 1350 K

    Source: Wooster, Zhukov and Oertel (2003), Remote Sensing of Environment 86, 83.

    Returns   watt / m^2 / sr / m / K^4
    Accuracy  model: at 3.4 to 4.2 um within 20 % of B between these temperatures.
    """
    temperature = np.linspace(LOW, HIGH, NODES)
    return float(np.exp(np.mean(np.log(heat(temperature)[:, 0] / temperature**4))))


def radiated_power(temperature: float, area: float) -> float:
    """Fire radiative power of a blackbody, watt."""
    return float(Stefan_Boltzmann * temperature**4 * area)


def power_of(excess: Floats, heat: ThermalRadiance) -> Floats:
    """Fire radiative power from the radiance of the mid infrared.

        FRP = sigma / a * sum over pixels of A (L - L_background)

    Source: Wooster et al. (2003), eq. (6); (2005), J. Geophys. Res. 110, D24311.

    excess   (n,) watt / sr / m: sum over pixels of excess radiance at the ground times pixel area
    heat     thermal radiance of the band in the mid infrared
    Returns  (n,) watt
    """
    return excess * (Stefan_Boltzmann / power_coefficient(heat))


def temperature_and_area(
    mid: Floats,
    thermal: Floats,
    heats: tuple[ThermalRadiance, ThermalRadiance],
    background: tuple[float, float],
) -> tuple[Floats, Floats]:
    """Temperature and area of fires from two bands.

        E = A (B(T) - L_background)   in each band

    Source: Dozier (1981), Remote Sensing of Environment 11, 221, eqs. (5) and (6), in differences
    from the background.

    mid, thermal  (n,) watt / sr / m, as for `power_of`, in each band
    heats         thermal radiance of both bands
    background    watt / m^2 / sr / m, radiance that leaves the surrounding ground, in each band
    Returns       (n,) kelvin and (n,) square metre; NaN where no temperature between 350 and 2000 K
                  has the ratio of both bands
    Accuracy      numerical: 1e-4 of the temperature.
    """
    nodes = np.geomspace(COOLEST, HOTTEST, STEPS)
    light = [heat(nodes)[:, 0] - own for heat, own in zip(heats, background, strict=True)]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.log(light[0] / light[1])
        wanted = np.log(mid / thermal)
        # A fire is hotter than the blackbody that is as bright as the background.
        good = np.isfinite(ratio)
        inside = (wanted >= ratio[good][0]) & (wanted <= ratio[good][-1])
        temperature = np.exp(np.interp(wanted, ratio[good], np.log(nodes[good])))
        temperature = np.where(inside, temperature, np.nan)
        known = np.where(inside, temperature, COOLEST)
        area = np.where(inside, mid / (heats[0](known)[:, 0] - background[0]), np.nan)
    return temperature, area
