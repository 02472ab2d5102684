"""A sea of wind waves -> the power spectrum of its elevation, and realisations of its slopes.

Waves are linear and in deep water: a sum of waves of random phases. Sharp crests, currents, shallow
water and swell of a second direction are left out.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy import special

from startrack.core import Floats

GRAVITY = 9.80665  # metre / second^2
STEEP_BELOW, STEEP_ABOVE = 0.07, 0.09  # widths of the JONSWAP peak below and above its frequency
PM_PEAK = 0.877  # U omega / g at the peak; U is the wind at 19.5 m
PM_LEVEL = 8.1e-3  # Phillips' constant


class Sea(NamedTuple):
    """A state of the sea.

    height      metre, significant height: four standard deviations of the elevation
    wavelength  metre, at the peak of the spectrum over temporal frequency
    direction   radian, of the waves from the first axis
    peakedness  1: Pierson and Moskowitz; 3.3: JONSWAP
    spreading   1, power of the cosine of the angle from the direction
    """

    height: float
    wavelength: float
    direction: float
    peakedness: float
    spreading: float


def developed_sea(wind: float) -> tuple[float, float]:
    """Significant height and peak wavelength (metre) of a sea that a wind has fully developed.

        S(w) = a g^2 w^-5 exp(-5 / 4 (w_p / w)^4),   w_p = 0.877 g / U,   H^2 / 16 = Int S dw

    Source: Pierson and Moskowitz (1964), J. Geophys. Res. 69, 5181, eq. (13).

    wind  metre / second, at 19.5 m
    """
    peak = PM_PEAK * GRAVITY / wind
    height = 4 * math.sqrt(PM_LEVEL * GRAVITY**2 / 5 / peak**4)
    return height, 2 * math.pi * GRAVITY / peak**2


def elevation_power(sea: Sea, frequency: Floats, shortest: float = 0.0) -> Floats:
    """Power spectral density of the elevation; opposite waves have the same density.

        S(k) = H^2 / 16 f(k / k_p) / (k_p k) D,   f(x) ~ x^-3 exp(-5 / 4 x^-2) G^r
        r = exp(-(sqrt(x) - 1)^2 / (2 s^2)),   D ~ |cos(angle)|^n

    f and D have integrals of one. An image does not show the sense of the waves.

    Source: Hasselmann et al. (1973), JONSWAP, Deutsche Hydrographische Zeitschrift A8 (12), by
    w^2 = g k; spreading by the square of the cosine, Pierson, Neumann and James (1955).

    frequency  (..., 2) cycle / metre, along both axes
    shortest   metre, of the waves that are not left out
    Returns    (...) metre^4; its integral over the plane is H^2 / 16
    """
    first, second = frequency[..., 0], frequency[..., 1]
    size = np.hypot(first, second)
    x = np.maximum(size * sea.wavelength, 1e-9)
    cosine = (first * math.cos(sea.direction) + second * math.sin(sea.direction)) * (
        sea.wavelength / x
    )
    spread = np.abs(cosine) ** sea.spreading / _spread_integral(sea.spreading)
    shape = _shape(x, sea.peakedness) / _shape_integral(sea.peakedness)
    level = sea.height**2 / 16 * sea.wavelength**2
    power = np.where(size * shortest < 1, level * spread * shape / x, 0.0)
    return np.asarray(power, np.float64)


def _shape(x: Floats, peakedness: float) -> Floats:
    """f(x), not normalised; x is the wave number over the wave number of the peak."""
    with np.errstate(over="ignore"):
        base = x**-3 * np.exp(-1.25 / x**2)
    if peakedness == 1:
        return base
    width = np.where(x < 1, STEEP_BELOW, STEEP_ABOVE)
    return base * peakedness ** np.exp(-((np.sqrt(x) - 1) ** 2) / (2 * width**2))


@cache
def _shape_integral(peakedness: float) -> float:
    x = np.geomspace(0.05, 1e4, 20001)
    return float(np.trapezoid(_shape(x, peakedness) * x, np.log(x)))


def _spread_integral(power: float) -> float:
    """Integral of |cos|^n over a turn."""
    return float(
        2 * math.sqrt(math.pi) * special.gamma((power + 1) / 2) / special.gamma(power / 2 + 1)
    )


def slope_variance(sea: Sea, shortest: float) -> float:
    """Mean square slope, summed over both axes, of waves longer than a length in metre."""
    x = np.geomspace(0.05, sea.wavelength / shortest, 4001)
    part = _shape(x, sea.peakedness) / _shape_integral(sea.peakedness) * x**2
    wave = 2 * math.pi / sea.wavelength
    return float(sea.height**2 / 16 * wave**2 * np.trapezoid(part * x, np.log(x)))


def draw_sea(
    sea: Sea, stream: np.random.Generator, count: int, step: tuple[float, float], shortest: float
) -> tuple[Floats, Floats, Floats]:
    """A realisation: elevation (metre) and slopes along lines and columns at points of a grid.

    It is periodic over the grid.

    count     points along a side
    step      metre between points, along a column and along a line
    shortest  metre, shortest wavelength: two steps or more
    Returns   (count, count) each
    """
    down, right = np.fft.fftfreq(count, step[0]), np.fft.rfftfreq(count, step[1])
    frequency = np.stack(np.meshgrid(down, right, indexing="ij"), -1).astype(np.float64)
    power = elevation_power(sea, frequency, shortest)
    power[0, 0] = 0.0
    white = np.fft.rfft2(stream.standard_normal((count, count)))
    waves = white * np.sqrt(power / math.prod(step))
    phase = 2j * math.pi * waves
    level, along, across = (
        np.fft.irfft2(part, s=(count, count))
        for part in (waves, phase * frequency[..., 0], phase * frequency[..., 1])
    )
    return level, along, across
