"""Large arrays that a plan keeps between calls: a new one costs more than a few windows in it."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from startrack.core.arrays import Ints
from startrack.core.kernel import kernel
from startrack.core.memory import require_memory

Image = NDArray[np.float32]


class Workspace(threading.local):
    """Arrays by name, separate for each thread; whoever makes it decides who may share them.

    A new array costs a page fault for each row that is written: milliseconds where windows lie
    all over a frame.
    """

    def __init__(self) -> None:
        self._arrays = dict[str, NDArray[Any]]()
        self._canvases = dict[str, tuple[Image, float, Ints]]()

    def array(self, name: str, shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
        """The array of that name as the last call left it; zeros at first."""
        array = self._arrays.get(name)
        if array is None or array.shape != shape or array.dtype != kind:
            size = math.prod(shape) * np.dtype(kind).itemsize
            require_memory(size, f"an array of {' x '.join(map(str, shape))} numbers")
            array = self._arrays[name] = np.zeros(shape, kind)
        return array

    def canvas(self, name: str, shape: tuple[int, int], level: float, windows: Ints) -> Image:
        """The float32 image of that name, one level everywhere except in the windows of this call.

        Only the windows of the last call are filled with the level again.

        windows  (w, 4) left, top, right, bottom (exclusive); their pixels hold any values
        """
        image = self.array(name, shape, np.float32)
        last = self._canvases.get(name)
        if last and last[0] is image and last[1] == level:
            _paint(image, last[2], level)
        else:
            image.fill(level)
        self._canvases[name] = image, level, windows
        return image


@kernel
def _paint(image, windows, level):  # type: ignore[no-untyped-def]
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        image[top:bottom, left:right] = level
