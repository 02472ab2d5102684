"""A whole frame against the exact integrals of its stars, and its noise against the exact law."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats
from scipy.spatial.transform import Rotation

from startrack.benchmark.detection import paint
from startrack.benchmark.optics import SIGMA, lens
from startrack.benchmark.stage import BenchmarkStage
from startrack.core import Camera, Floats, Light, LineOfSight, Streams
from startrack.detector import Detector, Exposure, expose, read_out
from startrack.optics import pixel_psf

SIZE, BACKGROUND, DARK, READ_NOISE = 1024, 20.0, 3.0, 8.0  # pixel; electron
EXPOSURE = 0.1  # second
STARRY = 30.0  # electron from stars, in the pixels that are judged
CAMERA = Detector(
    SIZE,
    SIZE,
    5e-6,
    EXPOSURE,
    full_well=80_000.0,
    read_noise=READ_NOISE,
    bits=16,
    offset=64,
    dark_current=DARK / EXPOSURE,
)


class Scenery(NamedTuple):
    """Positions of stars (n, 2), pixel, and the electrons of each."""

    pixel: Floats
    flux: Floats


def scenery() -> Scenery:
    """100 stars of a thousand to fifty thousand electrons."""
    rng = np.random.default_rng(1)
    return Scenery(rng.uniform(12, SIZE - 13, (100, 2)), 10 ** rng.uniform(3, 4.7, 100))


def frame() -> BenchmarkStage:
    """The error of the noise about the exact image, in the pixels that stars light."""
    stars, camera = scenery(), Camera(SIZE, SIZE, 4000.0)
    optics, pitch, wavelength, response = lens("gauss", SIGMA)
    rate = stars.flux / EXPOSURE
    background = np.array([BACKGROUND / EXPOSURE * camera.focal_length_px**2])
    light = Light(camera.unproject(stars.pixel), wavelength, rate[:, None], background)
    psf = pixel_psf(optics, pitch, wavelength, response)
    rest = LineOfSight(np.zeros(1), np.ones(1), np.zeros((1, 3)))

    def ours() -> NDArray[Any]:
        exposure = Exposure(
            light=light,
            psf=psf,
            line_of_sight=rest,
            icrs_to_camera=Rotation.identity(),
            camera=camera,
            detector=CAMERA,
            throughput=np.ones(1),
        )
        return expose(exposure, Streams(1, 0)).image

    starlight = np.zeros((SIZE, SIZE))
    paint(starlight, stars.pixel[:, 0], stars.pixel[:, 1], stars.flux, SIGMA)
    lit = starlight > STARRY
    mean = starlight[lit] + BACKGROUND + DARK

    def judge(image: NDArray[Any]) -> float:
        electrons = (image[lit].astype(float) - CAMERA.offset) * CAMERA.electrons_per_dn
        variance = mean + READ_NOISE**2 + CAMERA.electrons_per_dn**2 / 12
        return float(abs(np.sqrt(np.mean((electrons - mean) ** 2 / variance)) - 1))

    return BenchmarkStage(
        name="frame",
        work=f"{SIZE} x {SIZE} pixels, 100 stars, sky, dark current and noise to 16-bit numbers",
        error="rms of (image - exact) over the noise there is, less one",
        ways={"startrack": ours},
        judge=judge,
        limit=1 / math.sqrt(2 * lit.sum()),
        limit_of="standard error for these pixels",
    )


FRAMES = 8
# A number is one electron, so that the histogram has many cells.
EVEN_CAMERA = Detector(SIZE, SIZE, 5e-6, 0.1, full_well=4_095.0, read_noise=READ_NOISE)


def noise() -> BenchmarkStage:
    """Even frames; the error is Kolmogorov's distance between histogram and exact distribution."""
    even = np.full((SIZE, SIZE), BACKGROUND)
    step = EVEN_CAMERA.electrons_per_dn
    distributions = [np.cumsum(law(BACKGROUND, step, half)) for half in (0.5, 0.0)]

    def judge(frames: Sequence[NDArray[Any]]) -> float:
        count = sum(np.bincount(f.ravel().astype(np.int64), minlength=4096) for f in frames)
        fraction = np.cumsum(count) / np.sum(count)
        # A converter may round or truncate; the better of both distributions judges it.
        return min(float(np.abs(fraction - distribution).max()) for distribution in distributions)

    return BenchmarkStage(
        name="noise",
        work=f"a megapixel of {BACKGROUND:g} expected electrons, read noise {READ_NOISE:g}, "
        "to 12-bit numbers",
        error=f"distance of the distribution of {FRAMES} Mpx from the exact law",
        ways={
            "startrack": lambda: [read_out(even, EVEN_CAMERA, Streams(1, n)) for n in range(FRAMES)]
        },
        judge=judge,
        limit=0.83 / math.sqrt(FRAMES * even.size),
        limit_of="median of Kolmogorov's law for these pixels",
        pieces=FRAMES,
    )


def law(mean: float, step: float, half: float) -> Floats:
    """Probability of each number: Poisson and normal, quantised by a converter of this step.

    half  0.5 where the converter rounds, 0 where it truncates
    """
    electrons = np.arange(math.ceil(mean + 12 * math.sqrt(mean) + 40))
    weight = stats.poisson.pmf(electrons, mean)
    edge = (np.arange(2**EVEN_CAMERA.bits) + 1 - half) * step
    edge[-1] = np.inf
    z = (edge - electrons[:, None]) / READ_NOISE
    return np.diff(weight @ special.ndtr(z), prepend=0)
