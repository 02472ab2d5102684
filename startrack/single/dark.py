"""Detector -> the dark electrons of its pixels: their mean, and how far pixels differ."""

from __future__ import annotations

import math

from scipy.special import ndtr

from startrack.detector import Detector


def dark_currents(detector: Detector) -> tuple[float, float]:
    """Mean and rms about it over single pixels, electron / second at the reference temperature.

        d = max(N(m, s), 0) + hot,   mean d = m Phi(m/s) + s phi(m/s) + p h
        var d = (m^2 + s^2) Phi + m s phi - (m Phi + s phi)^2 + (2 p - p^2) h^2

    of normal currents that are nowhere below zero, and hot pixels with the chance p and an
    exponential law of mean h.
    """
    m, defects = detector.dark_current, detector.defects
    if not defects:
        return m, 0.0
    mean, square, s = m, m * m, defects.dsnu
    if s:
        share, density = float(ndtr(m / s)), math.exp(-((m / s) ** 2) / 2) / math.sqrt(2 * math.pi)
        mean, square = m * share + s * density, (m * m + s * s) * share + m * s * density
    p, h = defects.hot, defects.hot_current
    return mean + p * h, math.sqrt(max(square - mean**2, 0.0) + (2 * p - p * p) * h * h)


def dark(detector: Detector) -> tuple[float, float]:
    """The same in an exposure, electron in a pixel of the image."""
    growth = detector.thermal.growth if detector.thermal else 1.0
    mean, spread = (growth * detector.exposure * one for one in dark_currents(detector))
    return mean * detector.binning**2, spread * detector.binning
