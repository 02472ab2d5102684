"""Types of arrays, for annotations and for kernels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view that cannot be written to.

    A kernel is compiled once for arrays that can be written to and once for those that cannot; it
    gets what callers keep and what they have just made alike.
    """
    view = array.view()
    view.flags.writeable = False
    return view
