"""Paths from nothing to thousands of pixels, against closed forms."""

from __future__ import annotations

import numpy as np
from scipy import special

from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.motion import Motion, image_path, sample_jitter, slew
from tests.hard.case import hard, refused

PIXEL = 1e-4


for _length in (0.01, 1.0, 150.0, 2000.0):

    @hard("motion", f"a smear of {_length:g} pixels, error against the closed form", (0, 1e-6))
    def _smear(length=_length) -> float:
        path = slew(Motion(rate_y=length * PIXEL / 0.1), 0.1, PIXEL, 0.1)
        x = np.concatenate([np.linspace(-4, 4, 33), length / 2 + np.linspace(-4, 4, 33)])
        offset = path.rotation[:, 1] / PIXEL
        made = np.exp(-0.5 * ((x[:, None] - offset) / 0.5) ** 2) @ path.weight
        made /= 0.5 * np.sqrt(2 * np.pi)
        up, down = (special.ndtr((x + s * length / 2) / 0.5) for s in (1, -1))
        return float(np.abs(made - (up - down) / length).max())


@hard("motion", "rest, points of the path", (1, 1))
def _rest() -> float:
    return float(len(sample_jitter(Motion(), 0.1, PIXEL, Streams(1, 0)).time))


@hard("motion", "a star that goes behind the camera", "the star must stay in front of the camera")
def _behind() -> str:
    path = slew(Motion(rate_y=1.0), 2.0, 1e-3)
    return refused(lambda: image_path(path, Camera(100, 100, 1000.0), [1.0, 0.0, 1.0]))


@hard("motion", "a hundred thousand pixels of smear", "exposure must be short enough")
def _endless() -> str:
    return refused(lambda: slew(Motion(rate_x=10.0), 1.0, PIXEL))
