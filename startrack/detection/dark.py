"""Frame and dark frame -> Frame without the fixed pattern, its hot pixels marked dead."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from startrack.detection.robust import clipped
from startrack.values import Frame

HOT = 5.0  # sigma of the frame; from there on a pixel's own shot noise rivals the frame's noise
NEIGHBOURHOOD = 5  # pixel


def subtract_dark(frame: Frame, dark: Frame) -> Frame:
    """Take off a dark frame, and turn into NaN what it shows to be hot.

    A pixel is hot where it exceeds the median of its neighbours in the dark frame by 5 sigma of
    the difference image. The mean of its dark current could be taken off, its shot noise not.
    `detect` takes NaN for dead pixels.

    frame, dark  of the same shape, exposure and temperature; the dark frame best a median of many
    Returns      Frame of float32, whose offset is 0, because the dark frame held it
    Errors       ValueError where the shapes differ.
    """
    if frame.image.shape != dark.image.shape:
        raise ValueError(
            f"dark must have the frame's shape {frame.image.shape}, got {dark.image.shape}"
        )
    difference = np.subtract(frame.image, dark.image, dtype=np.float32)
    level = np.nan_to_num(np.asarray(dark.image, np.float32))
    excess = level - cv2.medianBlur(level, NEIGHBOURHOOD)
    known = difference[np.isfinite(difference)]
    if len(known):
        _, noise = clipped(known, 0.0)
        difference[(excess > HOT * noise) & (excess > 0)] = np.nan
    return replace(frame, image=difference, offset=0.0)
