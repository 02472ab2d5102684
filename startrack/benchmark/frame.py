"""A whole frame of stars, background and noise, against the exact integrals of its stars."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.benchmark.stage import Stage
from startrack.benchmark.stamping import SIGMA, lens
from startrack.benchmark.starfield import paint
from startrack.core import Camera, Floats, Light, LineOfSight, Streams
from startrack.detector import Detector, Exposure, expose
from startrack.optics import pixel_psf

SIZE, BACKGROUND, DARK, READ_NOISE = 1024, 20.0, 3.0, 8.0  # pixel; electron
EXPOSURE = 0.1  # second
STARRY = 30.0  # electron from stars, in the pixels that are judged
CAMERA = Detector(
    SIZE, SIZE, 5e-6, EXPOSURE, full_well=80_000.0, read_noise=READ_NOISE, bits=16, offset=64,
    dark_current=DARK / EXPOSURE,
)  # fmt: skip


class Scenery(NamedTuple):
    """Positions of stars (n, 2), pixel, and the electrons of each."""

    pixel: Floats
    flux: Floats


def scenery() -> Scenery:
    """100 stars of a thousand to fifty thousand electrons."""
    rng = np.random.default_rng(1)
    return Scenery(rng.uniform(12, SIZE - 13, (100, 2)), 10 ** rng.uniform(3, 4.7, 100))


def frame() -> Stage:
    """The error is that of the noise about the exact image, in the pixels that stars light."""
    stars, camera = scenery(), Camera(SIZE, SIZE, 4000.0)
    optics, pitch, wavelength, response = lens("gauss", SIGMA)
    rate = stars.flux / EXPOSURE
    background = np.array([BACKGROUND / EXPOSURE * camera.focal_length_px**2])
    light = Light(camera.unproject(stars.pixel), wavelength, rate[:, None], background)
    psf = pixel_psf(optics, pitch, wavelength, response)
    rest = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))

    def ours() -> NDArray[Any]:
        exposure = Exposure(light, psf, rest, Rotation.identity(), camera, CAMERA, np.ones(1))
        return expose(exposure, Streams(1, 0)).image

    starlight = np.zeros((SIZE, SIZE))
    paint(starlight, stars.pixel[:, 0], stars.pixel[:, 1], stars.flux, SIGMA)
    lit = starlight > STARRY
    mean = starlight[lit] + BACKGROUND + DARK

    def judge(image: NDArray[Any]) -> float:
        electrons = (image[lit].astype(float) - CAMERA.offset) * CAMERA.electrons_per_dn
        variance = mean + READ_NOISE**2 + CAMERA.electrons_per_dn**2 / 12
        return float(abs(np.sqrt(np.mean((electrons - mean) ** 2 / variance)) - 1))

    return Stage(
        "frame",
        f"{SIZE} x {SIZE} pixels, 100 stars, sky, dark current and noise to 16-bit numbers",
        "rms of (image - exact) over the noise there is, less one",
        {"startrack": ours},
        judge,
        1 / math.sqrt(2 * lit.sum()),
        "as many pixels with starlight",
    )
