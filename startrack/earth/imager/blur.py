"""Weights of the rays around a pixel, from optics, motion and pixel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from startrack.core import Floats, Psf
from startrack.earth.geometry import inside_pixel

Singles = NDArray[np.float32]

FAINT = 1e-3  # of the light beyond the weights, at most; less costs time; chosen by hand
SMEARED = 16  # instants of an exposure over which smear is averaged; chosen by hand


def blur_weights(psf: Psf, side: int, across: float, along: float, smear: float) -> Floats:
    """Weights of the rays of a pixel and of the pixels around it.

    The rays at the same position in all pixels form a lattice; the weights have the same sum over
    each lattice, and the sum one over all, so that an even scene is not changed.

    psf      of the pixels, the pixel's square included
    side     rays along each side of a pixel
    across   pixel between columns of the image: 1, or 1/2 for staggered lines
    along    pixel between its lines
    smear    pixel that the ground moves along the track in an exposure
    Returns  (side^2, k, k) 1, k odd; lines first
    Accuracy  model: light beyond the table of the PSF and beyond the weights is distributed over
              the rest: 1e-3 of the light and haze. numerical: 1 % of the modulation at Nyquist
              with two rays a side, 0.3 % with four.
    """
    at = (np.arange(psf.table.shape[0]) - psf.table.shape[0] // 2) / psf.oversampling
    psf_at = RegularGridInterpolator((at, at), psf.table, bounds_error=False, fill_value=0.0)
    late = ((np.arange(SMEARED) + 0.5) / SMEARED - 0.5) * smear
    reach = int(np.ceil(min(_radius(psf) + smear / 2, at[-1]) / min(across, along, 1.0)))
    step = np.arange(-reach, reach + 1)
    out = np.empty((side**2, len(step), len(step)))
    for n, (x, y) in enumerate(inside_pixel(side)):
        down, right = np.meshgrid(step * along + y, step * across + x, indexing="ij")
        # The table goes from the point's image to the pixel, the weights from the pixel to the ray.
        out[n] = sum(psf_at(np.stack([-down - each, -right], -1)) for each in late)
        out[n] = np.maximum(out[n], 0)
    return out / out.sum((1, 2), keepdims=True) / side**2


def blur_strips(strips: Iterator[Singles], weights: Floats) -> Iterator[Singles]:
    """The blurred image of an unblurred one that arrives in strips.

    strips  (lines, columns, rays of a pixel) each
    Yields  (lines, columns); in all as many lines as arrive. Beyond its edges the scene continues
            with its last line and column.
    """
    reach = weights.shape[1] // 2
    held: Singles | None = None
    for strip in strips:
        ahead = np.repeat(strip[:1], reach, 0) if held is None else held
        held = np.concatenate([ahead, strip])
        if len(held) > 2 * reach:
            yield _sum(held, weights)
            held = held[len(held) - 2 * reach :]
    if held is not None and reach:
        yield _sum(np.concatenate([held, np.repeat(held[-1:], reach, 0)]), weights)


def _sum(held: Singles, weights: Floats) -> Singles:
    reach = weights.shape[1] // 2
    total: Any = 0.0
    for n, each in enumerate(weights):
        rays = np.ascontiguousarray(held[:, :, n])
        total = total + cv2.filter2D(rays, cv2.CV_32F, each, borderType=cv2.BORDER_REPLICATE)
    return total[reach : len(held) - reach]


def _radius(psf: Psf) -> float:
    """Pixel, of the box that holds all of the table's light except FAINT."""
    middle, total = psf.table.shape[0] // 2, psf.table.sum()
    for radius in range(psf.oversampling, middle, psf.oversampling):
        part = slice(middle - radius, middle + radius + 1)
        if psf.table[part, part].sum() > (1 - FAINT) * total:
            return radius / psf.oversampling
    return middle / psf.oversampling
