"""Square tiles of heights, with the maxima and steepness of their blocks, cached in memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from startrack.core import Singles, kernel, whole

SIZE = 9  # level of a tile as a block
CELLS = 1 << SIZE  # cells of a tile along each side
VERTICES = CELLS + 1  # neighbouring tiles share their outermost vertices
BLOCKS = (4**SIZE - 1) // 3  # blocks of the levels 1 to 9 in a tile
PATCH = 3  # lowest level with a steepness of blocks
PATCHES = (4 ** (SIZE + 1 - PATCH) - 1) // 3  # blocks of the levels 3 to 9 in a tile


@kernel
def block(level, j, i):  # type: ignore[no-untyped-def]
    """Index of a block in the maxima of its tile: level 1 first, each level row by row."""
    return ((1 << 2 * SIZE) - (1 << 2 * (SIZE + 1 - level))) // 3 + (j << (SIZE - level)) + i


@kernel
def patch(level, j, i):  # type: ignore[no-untyped-def]
    """Index of a block of level 3 or more in the steepness of its tile."""
    return block(level, j, i) - (BLOCKS - PATCHES)


@kernel
def fill(tile: Singles, maxima: Singles, steepness: Singles) -> tuple[float, float]:
    """Fill in the maxima and the steepness of a tile, in place; returns its extreme heights.

    A hole (NaN) counts as lower than all heights, so that blocks of holes are never entered, and as
    infinitely steep.

    tile       (513, 513) metre
    maxima     (87381,) metre, over all vertices of a block's cells
    steepness  (5461, 2) metre, largest difference between neighbouring vertices along columns and
               rows, for the blocks of level 3 and more
    Returns    lowest and highest height
    """
    _fill_steepness(tile, steepness)
    return _fill_maxima(tile, maxima)


@kernel
def _fill_steepness(tile: Singles, steepness: Singles) -> None:
    along, down = np.empty(CELLS, np.float32), np.empty(VERTICES, np.float32)
    side = 1 << PATCH
    for j in range(CELLS >> PATCH):
        along[:], down[:] = 0, 0
        for b in range(j * side, j * side + side + 1):
            _keep_larger(along, tile[b, 1:], tile[b, :-1])
        for b in range(j * side, j * side + side):
            _keep_larger(down, tile[b + 1], tile[b])
        for i in range(CELLS >> PATCH):
            n = patch(PATCH, j, i)
            steepness[n, 0] = along[i * side : i * side + side].max()
            steepness[n, 1] = down[i * side : i * side + side + 1].max()
    for level in range(PATCH + 1, SIZE + 1):
        for j in range(CELLS >> level):
            for i in range(CELLS >> level):
                n, finer = patch(level, j, i), patch(level - 1, 2 * j, 2 * i)
                below = finer + (CELLS >> (level - 1))
                for way in range(2):
                    steepness[n, way] = max(
                        max(steepness[finer, way], steepness[finer + 1, way]),
                        max(steepness[below, way], steepness[below + 1, way]),
                    )


@kernel
def _keep_larger(largest: Singles, first: Singles, second: Singles) -> None:
    for i in range(len(largest)):
        change = abs(first[i] - second[i])
        change = change if change == change else np.float32(np.inf)
        largest[i] = change if change > largest[i] else largest[i]


@kernel
def _fill_maxima(tile, maxima):  # type: ignore[no-untyped-def]
    lowest, highest = math.inf, -math.inf
    for j in range(CELLS // 2):
        for i in range(CELLS // 2):
            largest = np.float32(-np.inf)
            for b in range(2 * j, 2 * j + 3):
                for a in range(2 * i, 2 * i + 3):
                    height = tile[b, a]
                    largest = height if height > largest else largest
                    lowest = height if height < lowest else lowest
            maxima[(j << (SIZE - 1)) + i] = largest
            highest = largest if largest > highest else highest
    for level in range(2, SIZE + 1):
        for j in range(CELLS >> level):
            for i in range(CELLS >> level):
                finer = block(level - 1, 2 * j, 2 * i)
                below = finer + (CELLS >> (level - 1))
                maxima[block(level, j, i)] = max(
                    max(maxima[finer], maxima[finer + 1]), max(maxima[below], maxima[below + 1])
                )
    return lowest, highest


Key = tuple[int, int, int]  # level, row and column of a tile


@dataclass(eq=False)
class Cache:
    """Tiles with the maxima and steepness of their blocks; a new tile replaces the least recently
    used.

    read      returns the (513, 513) heights of a tile
    capacity  largest number of tiles
    """

    read: Callable[[int, int, int], Singles]
    capacity: int
    hits: int = 0
    misses: int = 0
    touched: set[Key] = field(default_factory=set)
    heights: Singles = field(init=False)
    maxima: Singles = field(init=False)
    steepness: Singles = field(init=False)
    used: NDArray[np.uint8] = field(init=False)
    _slots: dict[Key, int] = field(default_factory=dict, init=False)  # in order of last use

    def __post_init__(self) -> None:
        whole(2, 2**16, capacity=self.capacity)
        self.heights = np.empty((self.capacity, VERTICES, VERTICES), np.float32)
        self.maxima = np.empty((self.capacity, BLOCKS), np.float32)
        self.steepness = np.empty((self.capacity, PATCHES, 2), np.float32)
        self.used = np.zeros(self.capacity, np.uint8)

    @property
    def memory(self) -> int:
        """Memory of all tiles, bytes."""
        return self.heights.nbytes + self.maxima.nbytes + self.steepness.nbytes

    def refresh(self) -> None:
        """Count the tiles used since the last call, and move them to the end of the order."""
        for key in [key for key, slot in self._slots.items() if self.used[slot]]:
            self._slots[key] = self._slots.pop(key)
            self.hits += 1
        self.used[:] = 0

    def load(self, key: Key) -> tuple[int, Key | None, float, float]:
        """Read a tile that is not in memory.

        Returns  slot of the tile, the tile that it replaces, and its lowest and highest height
        """
        gone = None
        if len(self._slots) < self.capacity:
            slot = len(self._slots)
        else:
            gone = next(iter(self._slots))
            slot = self._slots.pop(gone)
        self.heights[slot] = self.read(*key)
        lowest, highest = fill(self.heights[slot], self.maxima[slot], self.steepness[slot])
        self._slots[key] = slot
        self.misses += 1
        self.touched.add(key)
        return slot, gone, lowest, highest
