"""A seed -> terrain that looks like mountains: a Gaussian field with a power law for a spectrum."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from startrack.checks import finite, positive, whole
from startrack.streams import Streams


def fractal(
    rows: int, columns: int, streams: Streams, relief: float, roughness: float = 2.0
) -> NDArray[np.float32]:
    """Heights with the spectrum of a fractal surface.

        amplitude(k) ~ |k|^-roughness, phases uniform

    Source: Voss (1985), in Fundamental Algorithms for Computer Graphics, 805: an amplitude of
    |k|^-(H + 1) has the Hurst exponent H; mountains have H near 0.8 to 1.

    relief     metre, from the lowest height, which is 0, to the highest
    roughness  1, lower for rougher terrain
    Returns    (rows, columns) metre; it repeats itself beyond its edges
    """
    whole(2, 2**15, rows=rows, columns=columns)
    positive(relief=relief)
    finite(roughness=roughness)
    k = np.hypot(np.fft.fftfreq(rows, 1 / rows)[:, None], np.fft.rfftfreq(columns, 1 / columns))
    k[0, 0] = np.inf
    phase = streams("terrain").random(k.shape) * 2j * np.pi
    heights = np.fft.irfft2(k**-roughness * np.exp(phase), s=(rows, columns))
    heights -= heights.min()
    return (heights * (relief / heights.max())).astype(np.float32)
