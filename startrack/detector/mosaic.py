"""ColourMosaic: colour filters of an array, one of three colours before each pixel (Bayer)."""

import numpy as np

from startrack import core
from startrack.core import Floats, Ints, Parameters, Range, parameter

COLOURS = "RGB"
PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")


class ColourMosaic(Parameters):
    """Filters in cells of 2 x 2 pixels of the array: one red, two green, one blue.

    Source: Bayer (1976), US patent 3,971,065.
    """

    pattern: str = parameter(
        "colours of the first cell of the array, row by row",
        limit=Range(choices=PATTERNS),
        default="RGGB",
    )
    red: core.Curve = parameter("fraction of the light that a red filter passes", default=core.ALL)
    green: core.Curve = parameter(
        "fraction of the light that a green filter passes", default=core.ALL
    )
    blue: core.Curve = parameter(
        "fraction of the light that a blue filter passes", default=core.ALL
    )

    @property
    def filters(self) -> tuple[core.Curve, core.Curve, core.Curve]:
        """Transmissions of red, green and blue pixels."""
        return self.red, self.green, self.blue

    def mean(self, of_colours: Floats) -> Floats:
        """Mean over the pixels of a cell, from values (3, ...) of red, green and blue pixels."""
        return np.asarray(np.tensordot(np.array([0.25, 0.5, 0.25]), of_colours, 1))

    def colours(self, rows: int, columns: int, top: int = 0, left: int = 0) -> Ints:
        """Colour of each pixel (rows, columns) of an image: 0 red, 1 green, 2 blue.

        top, left  place of the image in the array
        """
        cell = np.array([COLOURS.index(colour) for colour in self.pattern]).reshape(2, 2)
        row, column = (np.arange(rows) + top) % 2, (np.arange(columns) + left) % 2
        return cell[np.ix_(row, column)]
