"""The pattern of an aberrated lens, against a quadrature over its pupil."""

from __future__ import annotations

import numpy as np

from startrack.benchmark.stage import Stage
from startrack.core import Floats
from startrack.optics import Pupil, area_weights, intensity, pupil_grid, pupil_samples, zernike

WAVELENGTH, F_NUMBER = 550e-9, 1.4
FIELD: Floats = (np.arange(155) - 77) / 5  # wavelength * f-number
NOLL = range(4, 38)
COEFFICIENTS: Floats = 0.05 * np.random.default_rng(7).normal(size=len(NOLL))  # radian
PICK = np.random.default_rng(8).integers(0, len(FIELD), (1500, 2))  # points that are judged


def psf() -> Stage:
    """Noll's modes 4 to 37 on 155 x 155 points; errors are fractions of the clear peak."""
    own = Pattern()
    peak = own.clear().max()
    wanted = by_rings(COEFFICIENTS, FIELD[PICK])

    def judge(image: Floats) -> float:
        return float(np.abs(image[PICK[:, 1], PICK[:, 0]] / peak - wanted).max())

    return Stage(
        "psf",
        "155 x 155 points of an f/1.4 lens at 550 nm with 34 Zernike modes",
        "largest error, fraction of the clear peak",
        {"startrack": lambda: own.aberrated(COEFFICIENTS)},
        judge,
        np.finfo(float).eps,
        "rounding",
    )


class Pattern:
    """The pattern of a pupil with soft edges, by a folded matrix transform."""

    def __init__(self) -> None:
        slope = 2.0  # wave per radius, of these wavefronts: measured, with room
        self.place, cell = pupil_grid(pupil_samples(FIELD.max(), slope))
        self.weight = area_weights(Pupil(), self.place, cell) * cell**2 / np.pi
        self.flat = np.zeros_like(self.weight)
        modes = [zernike(noll, self.place, self.place[:, None]) for noll in NOLL]
        self.modes = np.array(modes).reshape(len(NOLL), -1).T.copy()

    def clear(self) -> Floats:
        """Without aberrations."""
        return intensity(self.weight, self.flat, self.place, FIELD)

    def aberrated(self, coefficients: Floats) -> Floats:
        """With one radian times each coefficient of each mode."""
        phase = (self.modes @ coefficients).reshape(self.weight.shape)
        return intensity(self.weight, phase, self.place, FIELD)

    def band(self, ratios: Floats) -> Floats:
        """The sum over wavelengths, each a ratio of the nominal one, with some aberration."""
        phase = self.modes[:, 3].reshape(self.weight.shape) * 0.3
        parts = [
            intensity(self.weight, phase / ratio, self.place, FIELD / ratio) / ratio**2
            for ratio in ratios
        ]
        return np.sum(parts, axis=0)


def by_rings(coefficients: Floats, points: Floats, rings: int = 60, spokes: int = 200) -> Floats:
    """Gauss-Legendre over the radius, trapezoid over the angle, the Fourier sum term by term."""
    node, weight = np.polynomial.legendre.leggauss(rings)
    r = np.sqrt((node + 1) / 2)[:, None]
    angle = np.arange(spokes) * 2 * np.pi / spokes
    x, y = (r * np.cos(angle)).ravel(), (r * np.sin(angle)).ravel()
    phase = sum(c * zernike(noll, x, y) for c, noll in zip(coefficients, NOLL, strict=True))
    wave = np.repeat(weight / 2 / spokes, spokes) * np.exp(1j * phase)
    field = [np.sum(wave * np.exp(-1j * np.pi * (u * x + v * y))) for u, v in points]
    return np.abs(field) ** 2
