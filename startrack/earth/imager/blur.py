"""Weights of the rays around a pixel, from optics, motion and pixel."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

from startrack.core import FieldPsf, Floats, Psf
from startrack.earth.geometry import inside_pixel

Singles = NDArray[np.float32]

FAINT = 1e-3  # of the light beyond the weights, at most; less costs time; chosen by hand
SMEARED = 16  # instants of an exposure over which smear is averaged; chosen by hand
LATTICE = 17  # places along a side of the field whose weights are computed; a spline between them
LEFT = 2e-3  # of the light of a point that the left-out kernels may have; chosen by hand


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
    reach = _reach(psf, across, along, smear)
    at = (np.arange(psf.table.shape[0]) - psf.table.shape[0] // 2) / psf.oversampling
    psf_at = RegularGridInterpolator((at, at), psf.table, bounds_error=False, fill_value=0.0)
    return _even(_samples(psf_at, side, across, along, smear, reach))


def _reach(psf: Psf, across: float, along: float, smear: float) -> int:
    """Pixels of the image from the middle of the weights to their edge."""
    last = psf.table.shape[0] // 2 / psf.oversampling
    return int(np.ceil(min(_radius(psf) + smear / 2, last) / min(across, along, 1.0)))


def _spline(table: Floats, oversampling: int) -> Callable[[Floats], Floats]:
    """A table at places (..., 2) pixel, rows first; tables of lenses may be coarse."""
    half = table.shape[0] // 2 / oversampling
    at = np.linspace(-half, half, table.shape[0])
    spline = RectBivariateSpline(at, at, table)

    def psf_at(place: Floats) -> Floats:
        inside = (np.abs(place) <= half).all(-1)
        return np.where(inside, spline.ev(place[..., 0], place[..., 1]), 0.0)

    return psf_at


def _samples(
    psf_at: Callable[[Floats], Floats], side: int, across: float, along: float, smear: float,
    reach: int,
) -> Floats:  # fmt: skip
    """A table at the places of rays, (side^2, k, k)."""
    late = ((np.arange(SMEARED) + 0.5) / SMEARED - 0.5) * smear
    step = np.arange(-reach, reach + 1)
    out = np.empty((side**2, len(step), len(step)))
    for n, (x, y) in enumerate(inside_pixel(side)):
        down, right = np.meshgrid(step * along + y, step * across + x, indexing="ij")
        # The table goes from the point's image to the pixel, the weights from the pixel to the ray.
        out[n] = sum(psf_at(np.stack([-down - each, -right], -1)) for each in late)
    return out


def _even(samples: Floats) -> Floats:
    """Samples (..., side^2, k, k) as weights of the same sum over each lattice."""
    out = np.maximum(samples, 0)
    return out / out.sum((-2, -1), keepdims=True) / out.shape[-3]


class FieldBlur(NamedTuple):
    """Weights of rays that change over the field.

        image = weights_0 * scene + sum_k weights_k * (part_k scene),   * a convolution

    The first are the mean over the field; the others have the sum zero over each lattice, so that
    an even scene is not changed by them.

    weights  (1 + k, side^2, s, s)
    parts    of each k, over lines and columns of the image
    lines    whether the parts change from line to line: of a matrix
    left     1, bound of the light of a point that is put into wrong pixels, since only so many
             kernels are used
    """

    weights: Floats
    parts: tuple[RectBivariateSpline, ...]
    lines: bool
    left: float

    def strips(self, strips: Iterator[Singles]) -> Iterator[Singles]:
        """Strips (lines, columns, rays) with their parts behind each other as further rays."""
        first = 0
        for strip in strips:
            lines, columns, _ = strip.shape
            down = np.arange(first, first + lines) if self.lines else np.zeros(1)
            parts = [one(down, np.arange(columns))[..., None] for one in self.parts]
            yield np.concatenate([strip, *(strip * one.astype(np.float32) for one in parts)], 2)
            first += lines

    def blurred(self, strips: Iterator[Singles]) -> Iterator[Singles]:
        """As `blur_strips`."""
        return blur_strips(self.strips(strips), self.weights.reshape(-1, *self.weights.shape[2:]))


def field_blur(
    psf: FieldPsf, columns: Floats, rows: Floats, side: int, across: float, along: float,
    smear: float,
) -> FieldBlur:  # fmt: skip
    """Weights of rays by images that change over the field.

    Those of each place of a lattice, as for `blur_weights`, are written as their mean and principal
    components; as many are kept as the weights of every place need to within 2e-3, summed over
    their sizes: no scene with radiance in [0, 1] then changes by more.

    columns, rows  (n,), (m,) pixel of the camera's grid at which the image has its columns and its
                   lines; one row for a scanner
    """
    many = 1 if len(rows) == 1 else LATTICE
    x, y = np.linspace(columns[0], columns[-1], LATTICE), np.linspace(rows[0], rows[-1], many)
    place = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    colour = float(psf.colour[0])
    found = psf.at(place[:, 0], place[:, 1], np.full(len(place), colour))[:, 3:]
    some = place[:: max(1, len(place) // LATTICE)].tolist()
    images = (psf.image(right, down, colour)[0] for right, down in [*some, place[-1].tolist()])
    reach = max(_reach(one, across, along, smear) for one in images)
    splines = (_spline(one, psf.oversampling) for one in psf.table)
    given = [_samples(one, side, across, along, smear, reach) for one in splines]
    weights = _even(np.tensordot(found, np.array(given), 1))
    mean = weights.mean(0)
    off = (weights - mean).reshape(len(place), -1)
    vector = np.linalg.eigh(off @ off.T)[1][:, ::-1]
    count, left = 0, float(np.abs(off).sum(1).max())
    while left > LEFT:
        count += 1
        rest = off - vector[:, :count] @ (vector[:, :count].T @ off)
        left = float(np.abs(rest).sum(1).max())
    kernels = (vector[:, :count].T @ off).reshape(count, *mean.shape)
    # Over places of the image, whose first column and line are zero.
    right = np.linspace(0, len(columns) - 1, LATTICE)
    down = np.linspace(0, len(rows) - 1, many)
    parts = tuple(_over_image(down, right, one.reshape(many, -1)) for one in vector.T[:count])
    return FieldBlur(np.concatenate([mean[None], kernels]), parts, many > 1, left)


def _over_image(down: Floats, right: Floats, values: Floats) -> RectBivariateSpline:
    """A spline over lines and columns; the same in all lines where there is one."""
    if len(down) == 1:
        down, values = np.arange(2.0), np.repeat(values, 2, 0)
    return RectBivariateSpline(down, right, values, kx=min(3, len(down) - 1))


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
