"""Arrays that last: a large one made anew costs more than the few windows written to it."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import DTypeLike, NDArray

from startrack.core.arrays import Ints

Image = NDArray[np.float32]


class _Lasting(threading.local):
    def __init__(self) -> None:
        self.arrays = dict[str, NDArray[Any]]()
        self.canvases = dict[str, tuple[Image, float, Ints]]()


_lasting = _Lasting()


def scratch(name: str, shape: tuple[int, ...], kind: DTypeLike) -> NDArray[Any]:
    """The array of that name, with whatever was left in it; zeros at first.

    A thread has its own. A new one costs a page fault for each row that is touched, which is
    milliseconds where windows are strewn over a frame.
    """
    array = _lasting.arrays.get(name)
    if array is None or array.shape != shape or array.dtype != kind:
        array = _lasting.arrays[name] = np.zeros(shape, kind)
    return array


def canvas(name: str, shape: tuple[int, int], level: float, windows: Ints) -> Image:
    """The float32 image of that name, one level everywhere but in the windows of this call.

    What the last call's windows hold is painted over: that is less than the whole image.

    windows  (w, 4) left, top, right, bottom, the last two not in it; anything stands in them
    """
    image = scratch(name, shape, np.float32)
    last = _lasting.canvases.get(name)
    if last and last[0] is image and last[1] == level:
        _paint(image, last[2], level)
    else:
        image.fill(level)
    _lasting.canvases[name] = image, level, windows
    return image


@njit(cache=True, error_model="numpy")
def _paint(image, windows, level):  # type: ignore[no-untyped-def]
    for k in range(len(windows)):
        left, top, right, bottom = windows[k]
        image[top:bottom, left:right] = level
