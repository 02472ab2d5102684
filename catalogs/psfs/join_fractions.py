"""Writes chandra-aca.fits from the table of pixel fractions of Chandra's aspect camera.

    python catalogs/psfs/join_fractions.py psf.csv

The table has the fractions of a star's light in 8 x 8 pixels for 144 places of the star, a tenth of
a pixel apart; its columns are in README.md.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from startrack.core import Floats
from startrack.optics import PsfFile, save_psf_file

STEP, SIDE = 10, 8  # samples per pixel, pixels along a side
PITCH = 24e-6  # metre
SOURCE = "Chandra aspect camera, sot/chandra_aca aca_psf_lib"


class Fractions(NamedTuple):
    """Contents of the table.

    x, y      (n,) pixel, of the star from the middle of the box
    fraction  (n, 8, 8) of its light in each pixel; zero where the source has none
    """

    x: Floats
    y: Floats
    fraction: Floats


def read(path: Path) -> Fractions:
    table = np.genfromtxt(path, delimiter=",", names=True)
    y, x = ((table[f"{one}_from"] + table[f"{one}_to"]) / 2 for one in ("row", "column"))
    names: tuple[str, ...] = table.dtype.names or ()
    fraction = np.column_stack([table[name] for name in names[4:]])
    return Fractions(x, y, fraction.reshape(-1, SIDE, SIDE))


def image_of(found: Fractions) -> Floats:
    """The fraction in a pixel, over its place from the star; the mean of what is given twice."""
    middle = (SIDE - 1) / 2
    total, count = np.zeros((2, (SIDE + 1) * STEP, (SIDE + 1) * STEP))
    first = -middle - 0.55  # of the places
    for x, y, box in zip(found.x, found.y, found.fraction, strict=True):
        column, row = (
            np.rint((np.arange(SIDE) - middle - at - first) * STEP).astype(int) for at in (x, y)
        )
        known = box > 0
        total[np.ix_(row, column)] += box
        count[np.ix_(row, column)] += known
    size = round(2 * -first * STEP) + 1
    total, count = total[:size, :size], count[:size, :size]
    mean = total / np.maximum(count, 1)
    # Where the source has none, in a corner or at the rim: as the nearest that it has.
    nearest = ndimage.distance_transform_edt(
        count == 0, return_distances=False, return_indices=True
    )
    mean = mean[tuple(nearest)]
    # The samples lie half a step beside the star.
    at = np.arange(size - 1) + 0.5
    return np.asarray(ndimage.map_coordinates(mean, np.meshgrid(at, at, indexing="ij"), order=3))


def main() -> None:
    image = image_of(read(Path(sys.argv[1])))
    found = PsfFile(
        SOURCE, image[None, None], PITCH / STEP, True, PITCH, min(image.sum() / STEP**2, 1.0)
    )
    save_psf_file(Path(__file__).with_name("chandra-aca.fits"), found)


if __name__ == "__main__":
    main()
