"""The texture of a land -> its power spectrum, and realisations of it over an image.

The land's fractal (`texture` and `temperature_texture` of a scene) is one realisation over a period
of 1024 cells. Trials draw other realisations of the same spectrum, as means over the cells of an
image's rays. They have no edges of square cells.
"""

import math
from functools import cache

import numpy as np

from startrack.core import Floats, Singles
from startrack.earth.imager import ROUGHNESS, TEXELS


def power(frequency: Floats, cell: float, roughness: float = ROUGHNESS) -> Floats:
    """Power spectral density of a texture of variance one.

        S(k) ~ k^(-2 roughness)   from one cycle in 1024 cells to one in 2 cells

    frequency  (..., 2) cycle / metre, along two axes
    cell       metre
    roughness  1, smaller for rougher textures
    Returns    (...) square metre
    """
    period = TEXELS * cell
    size = np.hypot(frequency[..., 0], frequency[..., 1]) * period
    inside = (size >= 0.5) & (np.abs(frequency) <= 0.5 / cell).all(-1)
    with np.errstate(divide="ignore"):
        return np.where(inside, size ** (-2 * roughness), 0.0) * (period**2 / _total(roughness))


@cache
def _total(roughness: float) -> float:
    """Sum of k^(-2 roughness) over all waves of a fractal."""
    k = np.fft.fftfreq(TEXELS, 1 / TEXELS)
    size = np.hypot(k[:, None], k)
    size[0, 0] = np.inf
    return float((size ** (-2 * roughness)).sum())


def draw(
    stream: np.random.Generator,
    lines: int,
    columns: int,
    step: tuple[float, float],
    cell: float,
    roughness: float = ROUGHNESS,
) -> Singles:
    """A realisation: the mean over each cell of a grid.

    Waves longer than the grid add one constant.

    step       metre, sides of the cells along lines and along columns
    roughness  1, smaller for rougher textures
    Returns    (lines, columns); mean 0 and rms 1 over many realisations
    Accuracy model: a Gaussian field; the land's fractal has waves of fixed amplitude.
    """
    down, right = np.fft.fftfreq(lines, step[0]), np.fft.rfftfreq(columns, step[1])
    frequency = np.stack(np.meshgrid(down, right, indexing="ij"), -1).astype(np.float64)
    density = power(frequency, cell, roughness)
    density[0, 0] = 0.0
    area = lines * step[0] * columns * step[1]
    mean = np.sinc(down * step[0])[:, None] * np.sinc(right * step[1])
    white = np.fft.rfft2(stream.standard_normal((lines, columns), np.float32))
    amplitude = np.sqrt(density * (lines * columns / area)) * mean
    field = np.fft.irfft2(white * amplitude, s=(lines, columns))
    both = np.where((right > 0) & (right < 0.5 / step[1]), 2.0, 1.0)
    longer = 1 - float((density * both).sum()) / area
    constant = stream.standard_normal() * math.sqrt(min(max(longer, 0.0), 1.0))
    return np.asarray(field + constant, np.float32)
