"""Hits: cosmic rays and protons, straight tracks of charge."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from startrack.core import NON_NEGATIVE, POSITIVE, Parameters, Streams, Unit

SAMPLES = 16  # points per pixel along a track; chosen by hand: lengths in 1/16 pixel
LEAST_COSINE = 0.01  # to the normal; only one track in 10 000 has a smaller one


@dataclass(frozen=True)
class Hits(Parameters):
    """Particles through the sensitive layer.

    Their number is a Poisson number. Their flux is isotropic, so that the cosine of the angle to
    the normal of those that cross the layer is the square root of a uniform number.

    Source: the most probable charge of a minimum-ionising particle in silicon is 80 electrons per
    micrometre (Particle Data Group, Passage of particles through matter).
    """

    rate: Annotated[float, Unit("m-2 s-1", "cm-2 s-1"), NON_NEGATIVE,
        "particle / m^2 / s through the surface, from both sides"]  # fmt: skip
    charge: Annotated[float, Unit("electron / m", "electron / um"), POSITIVE,
        "electron / m along the track"] = 80e6  # fmt: skip
    depth: Annotated[float, Unit("m", "um"), POSITIVE, "of the sensitive layer"] = 10e-6


def tracks(
    hits: Hits, shape: tuple[int, int], pitch: float, exposure: float, streams: Streams
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The pixels that particles hit in one exposure, and their charge.

        electrons = charge * length of the track in the pixel

    pitch     metre
    Returns   (k,) row * columns + column, increasing, and (k,) electron
    Accuracy  model: no straggling, no delta rays, no diffusion. numerical: lengths in units of 1/16
              pixel; their sum along a track is exact.
    """
    random = streams("hits")
    rows, columns = shape
    count = random.poisson(hits.rate * exposure * rows * columns * pitch**2)
    pixels, charges = [np.zeros(0, np.int64)], [np.zeros(0)]
    for x, y, square, turn in random.random((count, 4)):
        cosine = max(math.sqrt(square), LEAST_COSINE)
        length = hits.depth / cosine
        across = length * math.sqrt(1 - cosine**2) / pitch
        points = math.ceil(SAMPLES * across) + 1
        along = (np.arange(points) + 0.5) / points * across
        column = np.floor(x * columns + along * math.cos(2 * math.pi * turn)).astype(np.int64)
        row = np.floor(y * rows + along * math.sin(2 * math.pi * turn)).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        pixels.append((row * columns + column)[inside])
        charges.append(np.full(inside.sum(), hits.charge * length / points))
    pixel, index = np.unique(np.concatenate(pixels), return_inverse=True)
    electrons = np.bincount(index, np.concatenate(charges), len(pixel))
    return pixel, electrons.astype(float)
