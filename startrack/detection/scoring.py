"""One step of a fit of stars and their background to a window, and what the fit cannot know."""

from __future__ import annotations

import numpy as np
from numba import njit

from startrack.values import Floats


@njit(cache=True, error_model="numpy")
def information(
    data: Floats,
    star: Floats,
    value: Floats,
    noise: float,
    shot: float,
    matrix: Floats,
    right: Floats,
) -> int:
    """Fisher's information of the stars' shapes and fluxes, and of the background.

        mu = sum(flux p) + background,   var = noise^2 + shot sum(flux max(p, 0))
        matrix = sum(dmu dmu^T / var),   right = sum(dmu (data - mu) / var)

    A step `matrix^-1 right` is one of Fisher's scoring. The variance follows from the model
    and not from the data, so that no pixel counts less for being low by chance.

    Source: Kay, Estimation Theory (1993), sections 3.6 and 7.7.

    data    (rows, columns) less the known slopes; NaN in pixels that tell nothing
    star    (m, 1 + k, rows, columns) p of each star and its slopes by the k values of its shape
    value   (m (k + 1) + 1,) of each star its shape and its flux; last the background
    matrix  (n, n), right (n,) for n values: written here
    Returns how many pixels counted
    """
    stars, each, rows, columns = star.shape
    size, shapes = len(value), each - 1
    matrix[:] = 0
    right[:] = 0
    slope = np.empty(size)
    slope[size - 1] = 1.0
    count = 0
    for j in range(rows):
        for i in range(columns):
            if np.isnan(data[j, i]):
                continue
            count += 1
            mean, variance = value[size - 1], noise * noise
            for s in range(stars):
                share, flux = star[s, 0, j, i], value[s * each + shapes]
                mean += flux * share
                variance += shot * flux * max(share, 0.0)
                for k in range(shapes):
                    slope[s * each + k] = flux * star[s, k + 1, j, i]
                slope[s * each + shapes] = share
            weight = 1 / variance
            rest = weight * (data[j, i] - mean)
            for k in range(size):
                right[k] += slope[k] * rest
                for m in range(k + 1):
                    matrix[k, m] += weight * slope[k] * slope[m]
    for k in range(size):
        for m in range(k):
            matrix[m, k] = matrix[k, m]
    return count


@njit(cache=True, error_model="numpy")
def brightness(data: Floats, star: Floats, value: Floats) -> None:
    """Write fluxes and background of stars of known shapes, by least squares, into the values."""
    stars, each, rows, columns = star.shape
    matrix, right = np.zeros((stars + 1, stars + 1)), np.zeros(stars + 1)
    part = np.ones(stars + 1)
    for j in range(rows):
        for i in range(columns):
            if np.isnan(data[j, i]):
                continue
            part[:stars] = star[:, 0, j, i]
            for k in range(stars + 1):
                right[k] += part[k] * data[j, i]
                for m in range(stars + 1):
                    matrix[k, m] += part[k] * part[m]
    if not solved(matrix, right):
        right[:] = 0
    for s in range(stars):
        value[s * each + each - 1] = right[s]
    value[len(value) - 1] = right[stars]


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
