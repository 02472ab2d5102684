"""StarModel: image of a star that the tracker assumes, and what centroids compute from it once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from startrack.core import Floats, Psf, finite
from startrack.detection.psf_table import TAPS, window_of
from startrack.detection.s_curve import s_curve

MARGIN = 2  # pixel, so that what wraps around is nothing


@dataclass(frozen=True, eq=False)
class StarModel:
    """The image of a star of one plan; what follows from it is computed at first use.

    psf   smeared as the star is in the frames
    half  pixel, half side of the window of the centre of gravity
    """

    psf: Psf
    half: int

    @cached_property
    def fit_window(self) -> tuple[int, int]:
        """Half sides (columns, rows) of the window of a PSF fit, pixel."""
        return window_of(self.psf)

    @cached_property
    def s_curve(self) -> Floats:
        """S-curve of the centre of gravity, as the function `s_curve` gives it."""
        return s_curve(self.psf, self.half)


def smeared(psf: Psf, x: float, y: float) -> Psf:
    """Smear a PSF along a line whose middle is the middle of the motion.

        P(f) -> P(f) sinc(f . l),   l = (x, y)

    With a smeared PSF, a tracker that knows its rate finds streaks by their matched filter and
    measures them by their likelihood.

    Source: transform of the uniform law on a segment.

    x, y      pixel, motion of the star's image in the exposure
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
