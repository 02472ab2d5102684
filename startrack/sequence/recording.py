"""Frames of a sequence, and images of its stars -> files."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from startrack import core
from startrack.catalog import open_sky
from startrack.design import Case
from startrack.io import save_arrays
from startrack.trial import Images


@dataclass(frozen=True)
class Recording:
    """Files of the frames and star images of sequences.

    folder  of sequence-0001.csv and so on, and of the frames
    format  of the frames, one of FORMATS of `startrack.io`, with their times and true attitudes;
            None: they are not kept
    stars   whether the images of each matched star over time are kept, in sequence-0001-stars.npz:
            time, number (less the offset), col0 and row0 of its first pixel, and the place x and
            y as measured, each behind gaia or hip and the star's number, as `compare-flight`
            reads them
    """

    folder: Path
    format: str | None
    stars: bool = False


class StarRecording:
    """Images of matched stars, and their places."""

    def __init__(self, case: Case) -> None:
        self._half = case.tracker.box.size // 2
        self._offset = case.instrument.detector.offset
        self._identifier = open_sky(case.believed_catalog).stars.identifier
        self._rows = defaultdict[int, list[tuple[Any, ...]]](list)

    def add(
        self,
        time: float,
        frame: core.Frame,
        spots: core.Spots,
        matches: core.Matches,
        images: Images,
    ) -> None:
        """Images are those of the tracker's boxes, or around the pixel nearest to the spot."""
        rows, columns = frame.image.shape
        for spot, star in zip(matches.spot.tolist(), matches.star.tolist(), strict=True):
            x, y = float(spots.x[spot]), float(spots.y[spot])
            middle = images.get(star, (math.floor(x) + 1, math.floor(y) + 1))
            left, top = (at - self._half for at in middle)
            side = 2 * self._half
            if 0 <= left <= columns - side and 0 <= top <= rows - side:
                pixel = frame.image[top : top + side, left : left + side]
                number = np.asarray(pixel, np.float32) - self._offset
                self._rows[star].append((time, number, left, top, x, y))

    def save(self, path: Path) -> None:
        """Write the images of each star, as `Recording` describes them."""
        names = "time", "number", "col0", "row0", "x", "y"
        tables = {}
        for star, rows in self._rows.items():
            number = int(self._identifier[star])
            name = f"gaia{number}" if number > 0 else f"hip{-number}"
            tables[name] = dict(zip(names, zip(*rows, strict=True), strict=True))
        save_arrays(path, tables)
