"""Types of arrays and of a progress; functions for kernels: order, median and place of values.

NumPy's functions of this kind are compiled again for each type of array, which takes seconds. The
assignment of an array to a part of another array also takes long to compile, because of its message
on shapes.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core.interpret import instead_of
from startrack.core.kernel import kernel

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], None]  # called with the number of completed steps
Rows = NDArray[np.void]  # structured: a table with names and types of columns


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view that cannot be written to.

    A kernel is compiled separately for writable and for read-only arrays; by this view, cached and
    new arrays have the same type.
    """
    view = array.view()
    view.flags.writeable = False
    return view


@kernel
def assign(part: NDArray[Any], values: NDArray[Any]) -> None:
    """Write values (n,) into a part (n,) of an array of any type."""
    for i in range(len(values)):
        part[i] = values[i]


@instead_of(assign)
def _assign_of_arrays(part: NDArray[Any], values: NDArray[Any]) -> None:
    part[:] = values


RUN = 16  # values that are sorted by insertion; chosen by hand for speed


@kernel
def order(values: Floats) -> Ints:
    """Indices (n,) of values (n,) in rising order; equal values keep their order.

    Accuracy  exact, for values without NaN
    """
    n = len(values)
    now, then = np.empty(n, np.int64), np.empty(n, np.int64)
    for i in range(n):  # runs are sorted by insertion, which is faster for few, and then merged
        place, value = i, values[i]
        while place % RUN and values[now[place - 1]] > value:
            now[place] = now[place - 1]
            place -= 1
        now[place] = i
    width = RUN
    while width < n:
        for start in range(0, n, 2 * width):
            left, middle = start, min(start + width, n)
            right, end = middle, min(start + 2 * width, n)
            for k in range(start, end):
                if left < middle and (right == end or values[now[left]] <= values[now[right]]):
                    then[k] = now[left]
                    left += 1
                else:
                    then[k] = now[right]
                    right += 1
        now, then = then, now
        width *= 2
    return now


@kernel
def first_not_below(values: Floats, limit: float) -> int:
    """Index of the first of rising values (n,) that is not below the limit; n if there is none."""
    low, high = 0, len(values)
    while low < high:
        middle = (low + high) // 2
        if values[middle] < limit:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def median(values: Floats) -> float:
    """The median of values (n,); NaN without values.

    Accuracy  exact, for values without NaN
    """
    n = len(values)
    if n == 0:
        return np.nan
    rest, low, high = values.copy(), 0, n - 1
    while low < high:  # Hoare's selection: the value at n // 2 stays between both
        pivot, left, right = rest[(low + high) // 2], low, high
        while left <= right:
            while rest[left] < pivot:
                left += 1
            while rest[right] > pivot:
                right -= 1
            if left <= right:
                rest[left], rest[right] = rest[right], rest[left]
                left += 1
                right -= 1
        if n // 2 <= right:
            high = right
        elif n // 2 >= left:
            low = left
        else:
            break
    below = rest[n // 2]
    if n % 2 == 0:
        below = rest[0]
        for value in rest[1 : n // 2]:
            below = max(below, value)
    return (below + rest[n // 2]) / 2
