"""Regions: the sky cut into cells of equal area."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from startrack.checks import whole

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Regions:
    """Bands of equal height in the sine of the declination, cut by hours of right ascension.

    Archimedes: a band of a sphere has the area of its height, so that all cells are equal.
    """

    bands: int = 6
    sectors: int = 12

    def __post_init__(self) -> None:
        whole(1, 1000, bands=self.bands, sectors=self.sectors)

    def __len__(self) -> int:
        return self.bands * self.sectors

    def of(self, direction: Floats) -> Ints:
        """The cell (n,) of each direction (n, 3), ICRS axes."""
        x, y, z = direction.T
        band = np.floor((z + 1) / 2 * self.bands)
        sector = np.floor((np.arctan2(y, x) / (2 * math.pi) % 1.0) * self.sectors)
        return np.asarray(
            np.clip(band, 0, self.bands - 1) * self.sectors + np.clip(sector, 0, self.sectors - 1),
            np.int64,
        )

    def place(self, cell: Ints, share: Floats) -> Floats:
        """Directions (n, 3), uniform in their cells where the shares (n, 2) in [0, 1) are so."""
        band, sector = np.divmod(cell, self.sectors)
        z = 2 * (band + share[:, 0]) / self.bands - 1
        angle = 2 * math.pi * (sector + share[:, 1]) / self.sectors
        radius = np.sqrt(1 - z * z)
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])

    def corners(self) -> tuple[Floats, Floats]:
        """Right ascensions (sectors + 1,) and declinations (bands + 1,) of the borders, radian."""
        return (
            np.linspace(0, 2 * math.pi, self.sectors + 1),
            np.arcsin(np.linspace(-1, 1, self.bands + 1)),
        )
