"""Waves of random slopes -> the brightness of their glint, and the variance of its power spectrum.

Brightness is the probability density of the small waves' slopes at the slope that mirrors the Sun.
These slopes are normally distributed about the slope of the long wave. So brightness is not linear
in the waves. Its moments over normal slopes are derived without a series.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy import fft

from startrack.core import Floats
from startrack.earth.retrieval.sea import Sea, elevation_power


class Glint(NamedTuple):
    """Statistics of the glint over the waves of a sea.

    spectrum  (n, n) mean square of the relative brightness by each wave of a grid
    gain      (2,) g, change of the relative brightness with the slopes
    mean      1, mean brightness over the brightness on level long waves
    slopes    (2, 2) M, covariance of all slopes
    """

    spectrum: Floats
    gain: Floats
    mean: float
    slopes: Floats


class Scatter(NamedTuple):
    """Derivatives of a weighted sum of squares of an image with its waves.

    follows  (n, n) derivative of the mean sum with ln of the mean square of a wave and its opposite
    pairs    variance by products of three waves, minus the variance of independent waves
    """

    follows: Floats
    pairs: float


class _SlopeSpectrum(NamedTuple):
    """Waves of a half plane, (n, m): cycle / metre (2, n, m), metre^2 of their slopes.

    slopes  (2, 2, n, n) R, covariance of slopes between two places
    """

    frequency: Floats
    power: Floats
    slopes: Floats


def _waves(sea: Sea, size: int, steps: tuple[float, float], shortest: float) -> _SlopeSpectrum:
    down, right = fft.fftfreq(size, steps[0])[:, None], fft.rfftfreq(size, steps[1])[None]
    frequency = np.stack(np.broadcast_arrays(down, right))
    power = elevation_power(sea, np.moveaxis(frequency, 0, -1), shortest)
    power[0, 0] = 0.0
    power *= (2 * math.pi) ** 2 / math.prod(steps)
    slopes = fft.irfft2(power * frequency[:, None] * frequency, (size, size))
    return _SlopeSpectrum(frequency, power, np.asarray(slopes))


def glint_over(
    rough: float, towards: Floats, sea: Sea, size: int, steps: tuple[float, float], shortest: float
) -> Glint:
    """Statistics of the glint over waves whose slopes are normal.

    <B> ~ N(Z; M),   <B B'> ~ N((Z, Z); (M, R; R, M)),   b = g . z + rest,   g = Z / M

    M is the covariance of all slopes, R the covariance of the long waves' slopes at two places. The
    rest does not correlate with the waves.

    Source: Bussgang (1952), MIT Research Laboratory of Electronics, report 216; g is the transfer
    of Kudryavtsev et al. (2017), the relative change of the mean glint with Z.

    rough, towards         those of the waves' `Mirror`: mean square of small slopes, Z (2,)
    size, steps, shortest  points of a side of a grid, metre between them, metre of the waves
    """
    r = _waves(sea, size, steps, shortest).slopes
    slopes = r[:, :, 0, 0] + rough / 2 * np.eye(2)
    square = _product(slopes, r, towards) - 1
    gain = np.asarray(np.linalg.solve(slopes, towards), np.float64)
    level = float(towards @ towards) / rough - float(towards @ gain) / 2
    mean = rough / 2 / math.sqrt(float(np.linalg.det(slopes))) * math.exp(level)
    return Glint(fft.fft2(square).real / size**2, gain, mean, slopes)


def _product(slopes: Floats, r: Floats, towards: Floats) -> Floats:
    """<B B'> / <B>^2 (n, n) at two places."""
    plus, minus = (_inverse(slopes[:, :, None, None] + sign * r) for sign in (1, -1))
    own = np.linalg.det(slopes)
    level = towards @ np.linalg.solve(slopes, towards)
    exponent = level - np.einsum("a,abxy,b->xy", towards, plus[0], towards)
    return np.asarray(own / np.sqrt(plus[1] * minus[1]) * np.exp(exponent))


def _inverse(m: Any) -> tuple[Floats, Floats]:
    """Inverses (2, 2, ...) of symmetric matrices, and their determinants (...)."""
    det = m[0, 0] * m[1, 1] - m[0, 1] ** 2
    return np.array([[m[1, 1], -m[0, 1]], [-m[0, 1], m[0, 0]]]) / det, det


def scatter_of(
    glint: Glint,
    towards: Floats,
    sea: Sea,
    weight: Floats,
    steps: tuple[float, float],
    shortest: float,
) -> Scatter:
    """Derivatives and variance of the sum F = sum w |b_k|^2 of the squares of an image.

        Cov(F, |z_k|^2) = S_k^2 d<F> / dS_k,   d ln<b b'> / dR = p p - (P - N) / 2,   p = P Z
        d ln<b b'> / dM = M^-1 - g g + p p - (P + N) / 2,   P, N = (M +- R)^-1

    The slopes z are normal with mean squares S; b is the brightness. Pairs of waves add z H z / 2
    to b, H = g g - M^-1, and u z H z to F, where u is the image g z weighted by w. Of

        <u z H z, u' z' H z'> = 2 <u u'> tr(H R H R) + 4 <u z'> H R H <u' z>

    the second term, summed over all places, is `pairs`.

    Source: Price (1958), IRE Trans. Information Theory 4, 69; Isserlis (1918), Biometrika 12, 134.

    towards   (2,) Z, the slope that mirrors the Sun
    weight    (n, n) w at the points of an image, equal for a wave and its opposite
    steps     metre between these points, along lines and columns
    shortest  metre, of the waves
    Accuracy  model: `follows` is exact except for waves shorter than two points;
              `pairs` is of second order of b in the slopes.
    """
    size, g, own = len(weight), glint.gain, np.linalg.inv(glint.slopes)
    wave = _waves(sea, size, steps, shortest)
    apart, everywhere = _growth(glint.slopes, wave.slopes, towards)
    light = fft.fft2(weight).real / size**2
    slope = fft.rfft2(light * apart).real
    slope += (light * everywhere).sum((2, 3))[:, :, None, None]
    k = wave.frequency
    follows = np.einsum("axy,bxy,abxy->xy", k, k, slope) * (2 / size**2 * wave.power)
    opposite = np.roll(follows[::-1], 1, 0)[:, (size - 1) // 2 : 0 : -1]
    linear = weight[:, : size // 2 + 1] * wave.power * np.einsum("a,axy->xy", g, k)
    bent = np.einsum("ab,bxy->axy", np.outer(g, g) - own, fft.irfft2(linear * k, (size, size)))
    pairs = 4 / size**2 * np.einsum("axy,abxy,bxy->", bent, wave.slopes, bent)
    return Scatter(np.hstack([follows, opposite]), float(pairs))


def _growth(slopes: Floats, r: Floats, z: Floats) -> tuple[Floats, Floats]:
    """Derivatives (2, 2, n, n) of <b b'> at two places with R between them, and with M."""
    plus, minus = (_inverse(slopes[:, :, None, None] + sign * r)[0] for sign in (1, -1))
    p, g = np.einsum("abxy,b->axy", plus, z), np.linalg.solve(slopes, z)
    pair, both = p[:, None] * p, _product(slopes, r, z)
    beside = (np.linalg.inv(slopes) - np.outer(g, g))[:, :, None, None]
    return both * (pair - (plus - minus) / 2), both * (beside + pair - (plus + minus) / 2)
