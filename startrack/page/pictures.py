"""Images of a trial -> bytes of levels, ends of their scales, and marks, for a browser."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from startrack.core import Floats
from startrack.problem import TrialImage, TrialView

MOST = 512  # rows and columns of a drawn image; larger ones are drawn at a constant step
NOTHING, TOP = 255, 254  # level without a value, and highest level
BRIGHTEST = 0.998  # of the values are within the range of colours


def encoded(view: TrialView) -> dict[str, Any]:
    """Images and words of a trial."""
    scales = dict[str, list[Floats]]()
    for image in view.images:
        scales.setdefault(image.scale or image.name, []).append(image.values)
    ends = {name: _ends(np.concatenate([v.ravel() for v in same])) for name, same in scales.items()}
    images = [_image(image, *ends[image.scale or image.name]) for image in view.images]
    return {"text": view.text, "images": images}


def _ends(values: Floats) -> tuple[float, float]:
    """Range of colours. A few bright pixels do not make the others dark."""
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    low, high = np.quantile(values, (1 - BRIGHTEST, BRIGHTEST))
    return float(low), float(high)


def _image(image: TrialImage, low: float, high: float) -> dict[str, Any]:
    step = -(-max(image.values.shape) // MOST)
    values = image.values[::step, ::step]
    part = values if image.classes else TOP * (values - low) / ((high - low) or 1.0)
    level = np.where(np.isfinite(values), np.clip(np.rint(part), 0, TOP), NOTHING)
    shown = picture(image.name, image.values.shape, np.nan_to_num(level, nan=NOTHING), image.marks)
    return shown | {"unit": image.unit, "low": low, "high": high, "classes": image.classes}


def picture(
    name: str, size: tuple[int, ...], level: Floats, marks: dict[str, Floats] | Any, block: int = 1
) -> dict[str, Any]:
    """An image for a browser.

    size   pixel, rows and columns
    level  (m, n) from 0 to 254, of blocks of pixels; 255: nothing
    marks  (n, 2) pixel, columns first, by what they mark
    """
    return {
        "name": name,
        "size": size,
        "shape": level.shape,
        "levels": base64.b64encode(level.astype(np.uint8).tobytes()).decode(),
        "marks": [
            {"name": mark, "x": places[:, 0].round(2).tolist(), "y": places[:, 1].round(2).tolist()}
            for mark, places in marks.items()
        ],
    }
