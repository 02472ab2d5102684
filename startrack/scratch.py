"""Arrays that last: a large one made anew costs more than the few windows written to it."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


class _Lasting(threading.local):
    def __init__(self) -> None:
        self.arrays = dict[str, NDArray[Any]]()


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
