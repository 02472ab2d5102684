"""Frame and flat field -> Frame of even response; known hot pixels -> marked dead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from startrack.values import Frame, Ints

LEAST_RESPONSE = 0.1  # of the mean; a pixel that sees less is dead


def divide_flat(frame: Frame, flat: Frame) -> Frame:
    """Divide the light by the response of each pixel; what hardly responds becomes NaN.

    frame    less its dark frame, or with the right offset
    flat     image of an even surface, best a mean of many
    Returns  Frame of float32 with the same offset
    Errors   ValueError where the shapes differ or the flat holds no light.
    """
    if frame.image.shape != flat.image.shape:
        raise ValueError(
            f"flat must have the frame's shape {frame.image.shape}, got {flat.image.shape}"
        )
    response = np.asarray(flat.image, np.float32) - np.float32(flat.offset)
    mean = float(np.nanmean(response)) if np.isfinite(response).any() else 0.0
    if not mean > 0:
        raise ValueError(f"flat must hold light above its offset, got a mean of {mean:g}")
    response /= np.float32(mean)
    light = np.asarray(frame.image, np.float32) - np.float32(frame.offset)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = np.where(response >= LEAST_RESPONSE, light / response, np.float32(np.nan))
    return replace(frame, image=(even + np.float32(frame.offset)).astype(np.float32))


def without_pixels(frame: Frame, x: Ints, y: Ints) -> Frame:
    """Mark known hot or dead pixels, columns x and rows y (n,), as NaN, which `detect` fills.

    Errors  ValueError where a pixel lies outside the frame.
    """
    rows, columns = frame.image.shape
    x, y = np.asarray(x), np.asarray(y)
    outside = (x < 0) | (x >= columns) | (y < 0) | (y >= rows)
    if outside.any():
        first = int(np.argmax(outside))
        raise ValueError(
            f"pixels must lie within {columns} columns and {rows} rows, got column {x[first]}, "
            f"row {y[first]}"
        )
    image: NDArray[np.floating] = np.array(
        frame.image, np.float32 if frame.image.dtype.itemsize <= 2 else np.float64
    )
    image[y, x] = np.nan
    return replace(frame, image=image)
