"""Case -> errors of single stars in trials, over their position in the field and magnitude."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from startrack.catalog import open_sky
from startrack.core import Floats, Ints, Streams
from startrack.design import Case
from startrack.trial import colour_correction, observe, random_attitude


class Residuals(NamedTuple):
    """Matched stars of some trials.

    trial      (n,)
    position   (n, 2) pixel, true
    magnitude  (n,) G of the sunlike star that is as bright
    error      (n, 2) pixel, measured minus true
    """

    trial: Ints
    position: Floats
    magnitude: Floats
    error: Floats


def residuals(case: Case, seed: int, trials: int) -> Residuals:
    """Measured positions of stars minus those by the true attitude and camera."""
    stars, believed = open_sky(case.catalog).stars, open_sky(case.believed_catalog).stars
    true, _ = stars.find(believed.identifier)
    faint = colour_correction(case, stars.colour)
    parts = []
    for number in range(trials):
        streams = Streams(seed, number)
        record = observe(case, random_attitude(streams), streams)
        matches, spots = record.matches, record.spots
        star = true[matches.star]
        # Where the tracker merges two stars, their light has one position.
        pixel = case.instrument.camera.project(record.icrs_to_camera.apply(matches.direction))
        found = np.column_stack([spots.x, spots.y])[matches.spot]
        magnitude = stars.magnitude_g[star] + faint[star]
        parts.append(Residuals(np.full(len(star), number), pixel, magnitude, found - pixel))
    return Residuals(*(np.concatenate(column) for column in zip(*parts, strict=True)))
