"""A bounded number of tiles in memory, those used last; it counts its hits and misses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from startrack.checks import whole
from startrack.scene.earth.tile import BLOCKS, PATCHES, VERTICES, fill

Singles = NDArray[np.float32]
Key = tuple[int, int, int]  # level, row and column of a tile


@dataclass(eq=False)
class Cache:
    """Tiles with the maxima and steepness of their blocks; the least recently used makes room.

    read      gives the (513, 513) heights of a tile
    capacity  tiles
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
    _slots: dict[Key, int] = field(default_factory=dict, init=False)  # the last used is the last

    def __post_init__(self) -> None:
        whole(2, 2**16, capacity=self.capacity)
        self.heights = np.empty((self.capacity, VERTICES, VERTICES), np.float32)
        self.maxima = np.empty((self.capacity, BLOCKS), np.float32)
        self.steepness = np.empty((self.capacity, PATCHES, 2), np.float32)
        self.used = np.zeros(self.capacity, np.uint8)

    @property
    def memory(self) -> int:
        """Bytes of all tiles."""
        return self.heights.nbytes + self.maxima.nbytes + self.steepness.nbytes

    def refresh(self) -> None:
        """Count the tiles that were used since the last call, and remember that they were."""
        for key in [key for key, slot in self._slots.items() if self.used[slot]]:
            self._slots[key] = self._slots.pop(key)
            self.hits += 1
        self.used[:] = 0

    def load(self, key: Key) -> tuple[int, Key | None, float, float]:
        """Read a tile that is not there.

        Returns  its slot, the tile that made room, and the tile's lowest and highest height
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
