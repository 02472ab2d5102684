"""An aberrated lens against a quadrature of its pupil; stars on pixels against the closed form."""

import math

import numpy as np
from scipy import special

from startrack import optics
from startrack.benchmark.stage import BenchmarkStage
from startrack.core import Floats
from startrack.detector import stamp

WAVELENGTH, F_NUMBER = 550e-9, 1.4
FIELD: Floats = (np.arange(155) - 77) / 5  # wavelength * f-number
NOLL = range(4, 38)
COEFFICIENTS: Floats = 0.05 * np.random.default_rng(7).normal(size=len(NOLL))  # radian
PICK = np.random.default_rng(8).integers(0, len(FIELD), (1500, 2))  # points that are judged


def psf() -> BenchmarkStage:
    """Noll's modes 4 to 37 on 155 x 155 points; errors are fractions of the clear peak."""
    own = TestPattern()
    peak = own.clear().max()
    wanted = by_rings(COEFFICIENTS, FIELD[PICK])

    def judge(image: Floats) -> float:
        return float(np.abs(image[PICK[:, 1], PICK[:, 0]] / peak - wanted).max())

    return BenchmarkStage(
        name="psf",
        work="155 x 155 points of an f/1.4 lens at 550 nm with 34 Zernike modes",
        error="largest error, fraction of the clear peak",
        ways={"startrack": lambda: own.aberrated(COEFFICIENTS)},
        judge=judge,
        limit=np.finfo(float).eps,
        limit_of="rounding",
    )


class TestPattern:
    """The pattern of a pupil with soft edges, by a folded matrix transform."""

    def __init__(self) -> None:
        slope = 2.0  # wave per radius, of these wavefronts: measured, with room
        self.place, cell = optics.pupil_grid(optics.pupil_samples(FIELD.max(), slope))
        self.weight = optics.area_weights(optics.Pupil(), self.place, cell) * cell**2 / np.pi
        self.flat = np.zeros_like(self.weight)
        modes = [optics.zernike(noll, self.place, self.place[:, None]) for noll in NOLL]
        self.modes = np.array(modes).reshape(len(NOLL), -1).T.copy()

    def clear(self) -> Floats:
        """Without aberrations."""
        return optics.intensity(self.weight, self.flat, self.place, FIELD)

    def aberrated(self, coefficients: Floats) -> Floats:
        """Images with one radian times each coefficient of each mode."""
        phase = (self.modes @ coefficients).reshape(self.weight.shape)
        return optics.intensity(self.weight, phase, self.place, FIELD)

    def band(self, ratios: Floats) -> Floats:
        """The sum over wavelengths, each a ratio of the nominal one, with some aberration."""
        phase = self.modes[:, 3].reshape(self.weight.shape) * 0.3
        parts = [
            optics.intensity(self.weight, phase / ratio, self.place, FIELD / ratio) / ratio**2
            for ratio in ratios
        ]
        return np.sum(parts, axis=0)


RINGS, SPOKES = 60, 200  # nodes over the pupil of the reference


def by_rings(coefficients: Floats, points: Floats) -> Floats:
    """Gauss-Legendre over the radius, trapezoid over the angle, the Fourier sum term by term."""
    node, weight = np.polynomial.legendre.leggauss(RINGS)
    r = np.sqrt((node + 1) / 2)[:, None]
    angle = np.arange(SPOKES) * 2 * np.pi / SPOKES
    x, y = (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()
    phase = sum(c * optics.zernike(noll, x, y) for c, noll in zip(coefficients, NOLL, strict=True))
    wave = np.repeat(weight / 2 / SPOKES, SPOKES) * np.exp(1j * phase)
    field = [np.sum(wave * np.exp(-1j * np.pi * (u * x + v * y))) for u, v in points]
    return np.abs(field) ** 2


SIGMA = 0.7  # pixel
BOX = 15  # pixels a side
STARS = 400


def stamping() -> BenchmarkStage:
    """Gaussian stars, each in a box of its own."""
    psf = optics.pixel_psf(*lens("gauss", SIGMA))
    places = star_positions()
    wanted = np.array([centroid(exact("gauss", x, y, SIGMA, BOX)) for x, y in places])
    corner = np.arange(STARS) * BOX + BOX // 2

    def ours() -> Floats:
        image = np.zeros((BOX, BOX * STARS))
        stamp(image, psf, corner + places[:, 0], BOX // 2 + places[:, 1], np.ones(STARS))
        return image.reshape(BOX, STARS, BOX).swapaxes(0, 1)

    def judge(images: Floats) -> float:
        centres = np.array([centroid(image) for image in images])
        return float(np.sqrt(np.mean((centres - wanted) ** 2)))

    return BenchmarkStage(
        name="stamping",
        work=f"a Gaussian star of sigma {SIGMA} pixel on {BOX} x {BOX} pixels, any place",
        error="rms of the centroid, pixel",
        ways={"startrack": ours},
        judge=judge,
        limit=np.finfo(float).eps * BOX,
        limit_of="rounding",
        pieces=STARS,
    )


def star_positions() -> Floats:
    """Position of each star in its pixel, (n, 2)."""
    return np.random.default_rng(9).uniform(-0.5, 0.5, (STARS, 2))


def lens(kind: str, size: float) -> tuple[optics.Optics, float, Floats, Floats]:
    """Optics, pixel and band with a disk or sigma of `size` pixels."""
    band = np.array([WAVELENGTH]), np.ones(1)
    if kind == "airy":
        return optics.Optics(0.05, F_NUMBER, psf="airy"), WAVELENGTH * F_NUMBER / size, *band
    # A negligible wavelength: only the blur.
    return optics.Optics(0.05, F_NUMBER, 5e-6 * size, "gaussian"), 5e-6, band[0] * 1e-6, band[1]


def exact(kind: str, x: float, y: float, size: float, box: int) -> Floats:
    """The pixels of a star at (x, y) from the middle of a box, by its closed form."""
    at = np.arange(box) - box // 2
    if kind == "gauss":
        lines = [
            special.ndtr((at - c + 0.5) / size) - special.ndtr((at - c - 0.5) / size)
            for c in (x, y)
        ]
        return np.outer(lines[1], lines[0])
    node, weight = np.polynomial.legendre.leggauss(48)
    fine = at[:, None] + node / 2
    fx, fy = (fine - x).ravel(), (fine - y).ravel()
    values = math.pi / 4 / size**2 * optics.airy(np.hypot(fx, fy[:, None]), size, 1.0)
    return np.einsum("ajbi,j,i->ab", values.reshape(box, 48, box, 48), weight / 2, weight / 2)


def centroid(image: Floats) -> Floats:
    """The centre of gravity from the middle of a box, (x, y)."""
    at = np.arange(image.shape[0]) - image.shape[0] // 2
    return np.array([image.sum(axis=0) @ at, image.sum(axis=1) @ at]) / image.sum()
