"""Psf and a motion -> the PSF of a star that moves evenly while the shutter is open."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy import fft

from startrack.core import Psf, finite
from startrack.detection.parameters import Detection
from startrack.detection.psf_table import TAPS, gaussian_psf

MARGIN = 2  # pixel, so that what wraps around is nothing


def star_image(settings: Detection, psf: Psf | None) -> Psf:
    """What the tracker believes a star to look like: the PSF or else a Gaussian, drawn out."""
    point = gaussian_psf(settings.kernel_sigma) if psf is None else psf
    return smeared(point, settings.smear_x, settings.smear_y)


@lru_cache(maxsize=64)
def smeared(psf: Psf, x: float, y: float) -> Psf:
    """Draw a PSF out along a line, its middle at the middle of the motion.

        P(f) -> P(f) sinc(f . l),   l = (x, y)

    A tracker that knows its rate finds streaks with its matched filter and measures them with
    its likelihood.

    Source: transform of the uniform law on a segment.

    x, y     pixel, by which the star's image moves in the exposure
    Raises    ValueError where the motion is not finite.
    Accuracy  numerical: 1e-6 of the peak where the table holds all of the star.
    """
    finite(x=x, y=y)
    if x == 0 and y == 0:
        return psf
    more = math.ceil((max(abs(x), abs(y)) / 2 + MARGIN) * psf.oversampling) + TAPS
    wide = np.pad(psf.table, more)
    side = fft.next_fast_len(wide.shape[0], real=True)
    frequency_x = fft.rfftfreq(side) * psf.oversampling
    frequency_y = fft.fftfreq(side)[:, None] * psf.oversampling
    drawn = fft.rfft2(wide, s=(side, side)) * np.sinc(frequency_x * x + frequency_y * y)
    table = fft.irfft2(drawn, s=(side, side))[: wide.shape[0], : wide.shape[1]]
    return Psf(np.ascontiguousarray(table), psf.oversampling, psf.energy)
