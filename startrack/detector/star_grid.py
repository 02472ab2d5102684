"""Stars and companions -> one noise-free Frame with a cell for each star."""

from __future__ import annotations

import numpy as np

from startrack.core import Floats, Frame, Psf
from startrack.detector.effects import diffuse
from startrack.detector.expose import to_frame
from startrack.detector.law import law_of, mean_numbers
from startrack.detector.maps import device_streams
from startrack.detector.parameters import Detector
from startrack.detector.stamp import stamp


def star_grid(
    stars: Floats,
    companions: Floats,
    across: int,
    side: int,
    smear: Floats,
    psf: Psf,
    detector: Detector,
    sky: float,
    dark: Floats | None = None,
) -> tuple[Frame, Floats]:
    """Expected digital numbers of stars, each in the middle of its cell.

    Cells in the same column have pixels of the same random response and dark signal.

    stars       (n, 3) x and y (pixel) from the middle of the cell, electron
    companions  (n, 3) x and y (pixel) from the star, electron, of another star in the cell
    across      cells in a row; n is a multiple of it
    side        pixel, odd, of a cell
    smear       (m, 3) weight, x and y (pixel) of the points of a star's path
    sky         electron of the uniform background in a pixel of mean response
    dark        (across, side, side) electron above the dark signal of all pixels; None: zero
    Returns     Frame of numbers that are not rounded, and (n, 2) pixel, positions of the stars
    """
    gain = np.ones((side, across * side))
    if detector.prnu:
        draw = device_streams(detector)("response of a grid").standard_normal(gain.shape)
        gain = np.maximum(1 + detector.prnu * draw, 0.0)
    gain = np.tile(gain, (len(stars) // across, 1))
    electrons = sky * gain
    row, column = np.divmod(np.arange(len(stars)), across)
    position = np.column_stack([column, row]) * side + side // 2 + stars[:, :2]
    for weight, dx, dy in smear:
        for each in (stars, companions):
            at = position if each is stars else position + companions[:, :2]
            stamp(electrons, psf, at[:, 0] + dx, at[:, 1] + dy, weight * each[:, 2], gain)
    if detector.crosstalk:
        electrons = diffuse(electrons, detector.crosstalk)
    electrons += detector.dark_rate * detector.exposure
    if dark is not None:
        row_of_cells = dark.transpose(1, 0, 2).reshape(side, across * side)
        electrons += np.tile(row_of_cells, (len(stars) // across, 1))
    return to_frame(mean_numbers(electrons, law_of(detector)), detector), position
