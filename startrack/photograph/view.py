"""Mapping of the pixels of a file to those of a camera with square pixels."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from startrack.core import Frame, Spots
from startrack.photograph.spots import chosen


class PhotographView(NamedTuple):
    """Mapping of the pixels of a file to those of a camera with square pixels.

    mirrored  whether left and right are exchanged
    aspect    width of a pixel over its height; the longer side of the pixel keeps its number
    middle    pixel, side of the square in the middle to which the image is cropped; None: no crop
    """

    mirrored: bool = False
    aspect: float = 1.0
    middle: int | None = None

    def size(self, columns: int, rows: int) -> tuple[int, int]:
        """Columns and rows of the view of a file of that size."""
        if self.middle is not None:
            return self.middle, self.middle
        x, y = columns * min(self.aspect, 1.0), rows * min(1 / self.aspect, 1.0)
        return max(round(x), 1), max(round(y), 1)

    def frame(self, frame: Frame) -> Frame:
        """The image as seen by the camera of the solution."""
        rows, columns = frame.image.shape
        image = frame.image[:, ::-1] if self.mirrored else frame.image
        size = self.size(columns, rows)
        if self.middle is not None:
            left, top = (columns - self.middle) // 2, (rows - self.middle) // 2
            image = image[max(top, 0) :, max(left, 0) :][: self.middle, : self.middle]
        elif self.aspect != 1.0:
            image = cv2.resize(np.asarray(image, np.float32), size, interpolation=cv2.INTER_AREA)
        return replace(frame, image=image)

    def spots(self, spots: Spots, columns: int, rows: int) -> Spots:
        """The spots of a file at their places in the camera of the solution."""
        width, height = self.size(columns, rows)
        x = columns - 1 - spots.x if self.mirrored else spots.x
        covariance = spots.covariance.copy()
        if self.mirrored:
            covariance[:, [0, 1], [1, 0]] *= -1
        if self.middle is not None:
            x, y = x - (columns - width) // 2, spots.y - (rows - height) // 2
            inside = (np.minimum(x, y) > -0.5) & (np.maximum(x, y) < width - 0.5)
            return chosen(replace(spots, x=x, y=y, covariance=covariance), inside)
        by = np.array([width / columns, height / rows])
        x, y = (x + 0.5) * by[0] - 0.5, (spots.y + 0.5) * by[1] - 0.5
        return replace(spots, x=x, y=y, covariance=covariance * by * by[:, None])

    def __str__(self) -> str:
        parts = ["mirrored"] if self.mirrored else []
        if self.aspect != 1.0:
            parts.append(f"pixels {self.aspect:.3g} times as wide as high")
        if self.middle is not None:
            parts.append(f"the middle {self.middle} x {self.middle} pixels")
        return ", ".join(parts)
