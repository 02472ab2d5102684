"""Frames of Gaussian stars by scipy's normal law, made without the code that they test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from scipy.special import ndtr

from startrack.core import Floats, Frame, Spots, Streams

SIDE, BACKGROUND, READ_NOISE, OFFSET = 1024, 50.0, 5.0, 100.0
NEAR = 1.5  # pixel


def paint(image: Floats, x: Floats, y: Floats, flux: Floats | float, sigma: float) -> None:
    """Add stars to an image of electrons."""
    reach = int(np.ceil(6 * sigma)) + 1
    for cx, cy, light in np.broadcast(x, y, flux):
        u = np.arange(max(round(cx) - reach, 0), min(round(cx) + reach + 1, image.shape[1]))
        v = np.arange(max(round(cy) - reach, 0), min(round(cy) + reach + 1, image.shape[0]))
        along = ndtr((u + 0.5 - cx) / sigma) - ndtr((u - 0.5 - cx) / sigma)
        down = ndtr((v + 0.5 - cy) / sigma) - ndtr((v - 0.5 - cy) / sigma)
        image[v[0] : v[-1] + 1, u[0] : u[-1] + 1] += light * np.outer(down, along)


def expose(light: Floats, streams: Streams, read_noise: float = READ_NOISE) -> Frame:
    """Photons, read noise and whole numbers."""
    image = streams("shot noise").poisson(light) + OFFSET
    image = image + read_noise * streams("read noise").standard_normal(light.shape)
    whole = np.clip(np.round(image), 0, 65535).astype(np.uint16)
    return Frame(whole, np.nan, 1.0, OFFSET, read_noise)


def field(streams: Streams, spacing: int) -> tuple[Floats, Floats]:
    """Stars on a grid, at random sub-pixel positions."""
    grid = np.arange(spacing, SIDE - spacing / 2, spacing)
    x, y = (a.ravel() for a in np.meshgrid(grid, grid))
    x = x + streams("x").uniform(-0.5, 0.5, x.size)
    return x, y + streams("y").uniform(-0.5, 0.5, y.size)


def stars_at(sigma: float, phases: int) -> Floats:
    """Fractions (n, 441) of a star's light, at positions all over a pixel."""
    phase, fractions = (np.arange(phases) + 0.5) / phases - 0.5, []
    for a in phase:
        for b in phase:
            image = np.zeros((21, 21))
            paint(image, np.array([10 + a]), np.array([10 + b]), 1.0, sigma)
            fractions.append(image.ravel())
    return np.array(fractions)


def snr_of(flux: float, sigma: float, star_noise: bool = True) -> float:
    """SNR of the best filter for a star of known position; its own shot noise is optional."""
    light = flux * stars_at(sigma, 8)
    noise = BACKGROUND + READ_NOISE**2 + 1 / 12 + star_noise * light
    return float(np.sqrt((light**2 / noise).sum(axis=1)).mean())


def flux_of(snr: float, sigma: float) -> float:
    """Electron."""
    return float(brentq(lambda flux: snr_of(flux, sigma) - snr, 1.0, 1e6))


def paired(spots: Floats, x: Floats, y: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Which stars have a spot near them, and its error, (m, 2)."""
    if not len(spots):
        return np.zeros(len(x), bool), np.empty((0, 2))
    star = np.column_stack([x, y])
    distance, index = cKDTree(spots).query(star)
    found = distance < NEAR
    return found, (spots[index] - star)[found]


def spot_positions(spots: Spots) -> Floats:
    """(n, 2) pixel."""
    return np.column_stack([spots.x, spots.y])
