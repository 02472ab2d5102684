"""A tabled power spectral density -> narrow bands, each of one power law, and their power."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from startrack.motion.parameters import Broadband

Floats = NDArray[np.float64]

BANDS_PER_OCTAVE = 8


@dataclass(frozen=True, eq=False)
class Bands:
    """A spectrum, cut so finely that a band is one line for an exposure, or nearly so.

    low       (k,) hertz, where each band begins
    octave    (k,) 1, natural logarithm of the ratio of its ends
    exponent  (k,) 1, of the power law frequency * density
    power     (k,) radian^2, integral of the density over the band
    """

    low: Floats
    octave: Floats
    exponent: Floats
    power: Floats

    @property
    def width(self) -> Floats:
        """(k,) hertz."""
        return self.low * np.expm1(self.octave)

    def place(self, share: Floats) -> Floats:
        """Hertz, below which each band has this share (..., k) of its power.

        The inverse of the cumulated power: with a uniform share it draws frequencies in
        proportion to the density.
        """
        flat = np.abs(self.exponent) * self.octave < 1e-9
        slope = np.where(flat, 1.0, self.exponent)
        steep = np.log1p(share * np.expm1(slope * self.octave)) / slope
        return self.low * np.exp(np.where(flat, share * self.octave, steep))


@lru_cache(maxsize=64)
def bands(spectrum: Broadband) -> Bands:
    """Cut a spectrum at the points of its table and at eight frequencies in each octave.

    Errors  numerical: the powers add up to the integral of the table to 1e-13.
    """
    f, s = np.log(spectrum.frequency), np.log(spectrum.density)
    count = np.maximum(np.ceil(np.diff(f) / np.log(2) * BANDS_PER_OCTAVE), 1).astype(int)
    low = np.concatenate(
        [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(f[:-1], f[1:], count, strict=True)]
    )
    octave = np.diff(np.append(low, f[-1]))
    exponent = np.repeat(np.diff(s) / np.diff(f) + 1, count)
    start = np.exp(np.interp(low, f, s) + low)
    growth = exponent * octave
    # (e^u - 1) / u without its hole at 0, where the density falls as 1 / f.
    mean = np.where(np.abs(growth) < 1e-9, 1.0, np.expm1(growth) / np.where(growth, growth, 1.0))
    return Bands(np.exp(low), octave, exponent, start * octave * mean)
