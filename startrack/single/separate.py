"""Selection and camera -> the stars that the camera sees as separate spots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from startrack.camera import Camera
from startrack.catalog import Selection, Sky, open_sky
from startrack.identification.index import POINTS, indexed_field
from startrack.identification.merge import merged
from startrack.values import Ints


@dataclass(frozen=True, eq=False)
class Separate:
    """Stars, those too close for the tracker's index as one.

    sky   brightest first
    name  (n,) which star of the catalogue each is; of several, the brightest
    """

    sky: Sky
    name: Ints


def separate(selection: Selection, camera: Camera) -> Separate:
    """The stars of a catalogue as the tracker's index takes them."""
    return _separate(selection, indexed_field(camera) / POINTS)


@lru_cache(maxsize=8)
def _separate(selection: Selection, resolution: float) -> Separate:
    stars, name = merged(open_sky(selection).stars, resolution)
    order = np.argsort(stars.magnitude_g, kind="stable")
    return Separate(Sky(stars[order]), name[order])
