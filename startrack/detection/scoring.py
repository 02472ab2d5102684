"""One step of a fit of a star and its background to a window, and what the fit cannot know."""

from __future__ import annotations

import numpy as np
from numba import njit

from startrack.detection.sample import Image
from startrack.values import Floats

LEAST_PIXELS = 8


@njit(cache=True, error_model="numpy")
def information(
    data: Floats,
    star: Floats,
    flux: float,
    background: float,
    noise: float,
    shot: float,
    matrix: Floats,
    right: Floats,
) -> int:
    """Fisher's information of the shape's parameters, the flux and the background.

        mu = flux p + background,   var = noise^2 + shot flux max(p, 0)
        matrix = sum(dmu dmu^T / var),   right = sum(dmu (data - mu) / var)

    A step `matrix^-1 right` is one of Fisher's scoring. The variance follows from the model
    and not from the data, so that no pixel counts less for being low by chance.

    Source: Kay, Estimation Theory (1993), sections 3.6 and 7.7.

    data         (rows, columns) less the known slopes; NaN in pixels that tell nothing
    star         (1 + k, rows, columns) p and its slopes by the k parameters of its shape
    matrix       (k + 2, k + 2), right (k + 2,): written here
    Returns      how many pixels counted
    """
    shapes, rows, columns = star.shape
    size = shapes + 1
    matrix[:] = 0
    right[:] = 0
    slope = np.empty(size)
    count = 0
    for j in range(rows):
        for i in range(columns):
            if np.isnan(data[j, i]):
                continue
            count += 1
            share = star[0, j, i]
            weight = 1 / (noise * noise + shot * flux * max(share, 0.0))
            rest = weight * (data[j, i] - flux * share - background)
            for k in range(shapes - 1):
                slope[k] = flux * star[k + 1, j, i]
            slope[size - 2], slope[size - 1] = share, 1.0
            for k in range(size):
                right[k] += slope[k] * rest
                for m in range(k + 1):
                    matrix[k, m] += weight * slope[k] * slope[m]
    for k in range(size):
        for m in range(k):
            matrix[m, k] = matrix[k, m]
    return count


@njit(cache=True, error_model="numpy")
def brightness(data: Floats, share: Floats) -> tuple[float, float]:
    """Flux and background of a star of known shape, by least squares with equal weights."""
    n, p, pp, d, dp = 0, 0.0, 0.0, 0.0, 0.0
    for j in range(data.shape[0]):
        for i in range(data.shape[1]):
            if np.isnan(data[j, i]):
                continue
            n += 1
            p += share[j, i]
            pp += share[j, i] ** 2
            d += data[j, i]
            dp += data[j, i] * share[j, i]
    flux = (n * dp - p * d) / (n * pp - p * p)
    return flux, (d - flux * p) / n


@njit(cache=True, error_model="numpy")
def cut(
    image: Image,
    x: int,
    y: int,
    half_x: int,
    half_y: int,
    slope_x: float,
    slope_y: float,
    saturation: float,
) -> tuple[Floats, int, int]:
    """The window about a pixel as far as the image reaches, less the slopes of its background.

    Returns  (rows, columns), NaN where saturated; its first column and row
    """
    rows, columns = image.shape
    left, top = max(x - half_x, 0), max(y - half_y, 0)
    right, bottom = min(x + half_x + 1, columns), min(y + half_y + 1, rows)
    data = np.empty((bottom - top, right - left))
    for v in range(top, bottom):
        for u in range(left, right):
            value = image[v, u]
            plane = slope_x * (u - x) + slope_y * (v - y)
            data[v - top, u - left] = np.nan if value >= saturation else value - plane
    return data, left, top


@njit(cache=True, error_model="numpy")
def solved(matrix: Floats, right: Floats) -> bool:
    """Overwrite a symmetric positive matrix by its inverse and `right` by the solution.

    By Gauss and Jordan, scaled to a unit diagonal, as fluxes and places differ in size.

    Returns  False where the matrix is singular
    """
    n = len(right)
    scale = np.empty(n)
    for k in range(n):
        if not matrix[k, k] > 0:
            return False
        scale[k] = 1 / np.sqrt(matrix[k, k])
    for k in range(n):
        right[k] *= scale[k]
        for m in range(n):
            matrix[k, m] *= scale[k] * scale[m]
    for k in range(n):
        pivot = matrix[k, k]
        if not pivot > 1e-10:
            return False
        matrix[k, k] = 1.0
        right[k] /= pivot
        matrix[k] /= pivot
        for m in range(n):
            if m != k:
                factor = matrix[m, k]
                matrix[m, k] = 0.0
                matrix[m] -= factor * matrix[k]
                right[m] -= factor * right[k]
    for k in range(n):
        right[k] *= scale[k]
        for m in range(n):
            matrix[k, m] *= scale[k] * scale[m]
    return True
