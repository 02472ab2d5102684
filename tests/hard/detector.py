"""Photons from none to a thousand million, converters from one bit, stars on corners."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.benchmark.optics import lens
from startrack.core.camera import Camera
from startrack.core.streams import Streams
from startrack.core.values import Light, LineOfSight
from startrack.core.variates import poisson_quantile
from startrack.detector import Detector, Exposure, expected, read_out
from startrack.optics import pixel_psf
from tests.hard.case import hard, refused

BASE = {"columns": 64, "rows": 48, "pixel_pitch": 5e-6, "exposure": 0.1, "offset": 100}
REST = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))
ROOM = Detector(**BASE, full_well=20_000.0)


def image_of(pixel, electrons: float):
    camera = Camera(64, 48, 1000.0)
    optics, pitch, wavelength, fraction = lens("gauss", 0.7)
    rate = np.full((1, 1), electrons / ROOM.exposure)
    light = Light(camera.unproject(np.atleast_2d(pixel)), wavelength, rate, np.zeros(1))
    psf = pixel_psf(optics, pitch, wavelength, fraction)
    return expected(Exposure(light, psf, REST, Rotation.identity(), camera, ROOM, np.ones(1)))


for _electrons in (1e-3, 1e9):

    @hard("detector", f"flux of a star of {_electrons:g} electrons, relative error", (0, 1e-6))
    def _flux(electrons=_electrons) -> float:
        return float(abs(image_of((31.37, 22.81), electrons).sum() / electrons - 1))


@hard("detector", "a star on the outer corner, fraction that is inside", (0.24999, 0.25001))
def _corner() -> float:
    return float(image_of((-0.5, -0.5), 1e5).sum() / 1e5)


@hard("detector", "no photon and no noise, digital number of every pixel", (100, 100))
def _dark() -> float:
    image = read_out(np.zeros((48, 64)), ROOM, Streams(1, 0))
    return float(image.max() if image.max() == image.min() else np.nan)


@hard("detector", "1e9 electrons in each of 3072 pixels, relative error of the mean", (0, 3e-6))
def _flood() -> float:
    one = Detector(**BASE, full_well=2e9, bits=24)
    image = read_out(np.full((48, 64), 1e9), one, Streams(1, 0)).astype(float)
    return float(abs((image.mean() - 100) * one.electrons_per_dn / 1e9 - 1))


@hard("detector", "above the full well every pixel is the converter's end", (4095, 4095))
def _full() -> float:
    return float(read_out(np.full((48, 64), 1e6), ROOM, Streams(1, 0)).min())


@hard("detector", "Poisson quantile of a mean of 1e-12 at eight sigma, electrons", (1, 1))
def _rare() -> float:
    """P(N >= 1) = 1e-12, which exceeds the 6e-16 beyond eight sigma; P(N >= 2) = 5e-25 does not."""
    return float(poisson_quantile(1e-12, 8.0))


@hard("detector", "a pixel of no size", "pixel_pitch must be positive")
def _pitch() -> str:
    return refused(lambda: Detector(**BASE | {"pixel_pitch": 0.0}, full_well=1e4))
