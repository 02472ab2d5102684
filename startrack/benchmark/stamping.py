"""Stars integrated over pixels at sub-pixel positions, against the closed form."""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from startrack.benchmark.psf import F_NUMBER, WAVELENGTH
from startrack.benchmark.stage import Stage
from startrack.core import Floats
from startrack.detector import stamp
from startrack.optics import Optics, airy, pixel_psf

SIGMA = 0.7  # pixel
BOX = 15  # pixels a side
STARS = 400


def stamping() -> Stage:
    """Gaussian stars, each in a box of its own."""
    psf = pixel_psf(*lens("gauss", SIGMA))
    places = star_positions()
    wanted = np.array([centroid(exact("gauss", x, y, SIGMA, BOX)) for x, y in places])
    corner = np.arange(STARS) * BOX + BOX // 2

    def ours() -> Floats:
        image = np.zeros((BOX, BOX * STARS))
        stamp(image, psf, corner + places[:, 0], BOX // 2 + places[:, 1], np.ones(STARS))
        return image.reshape(BOX, STARS, BOX).swapaxes(0, 1)

    def judge(images: Floats) -> float:
        found = np.array([centroid(image) for image in images])
        return float(np.sqrt(np.mean((found - wanted) ** 2)))

    return Stage(
        "stamping",
        f"a Gaussian star of sigma {SIGMA} pixel on {BOX} x {BOX} pixels, any place",
        "rms of the centroid, pixel",
        {"startrack": ours},
        judge,
        np.finfo(float).eps * BOX,
        "rounding",
        STARS,
    )


def star_positions() -> Floats:
    """Position of each star in its pixel, (n, 2)."""
    return np.random.default_rng(9).uniform(-0.5, 0.5, (STARS, 2))


def lens(kind: str, size: float) -> tuple[Optics, float, Floats, Floats]:
    """Optics, pixel and band whose disk or sigma is `size` pixels."""
    band = np.array([WAVELENGTH]), np.ones(1)
    if kind == "airy":
        return Optics(0.05, F_NUMBER, psf="airy"), WAVELENGTH * F_NUMBER / size, *band
    # A negligible wavelength: only the blur.
    return Optics(0.05, F_NUMBER, 5e-6 * size, "gaussian"), 5e-6, band[0] * 1e-6, band[1]


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
    values = math.pi / 4 / size**2 * airy(np.hypot(fx, fy[:, None]), size, 1.0)
    return np.einsum("ajbi,j,i->ab", values.reshape(box, 48, box, 48), weight / 2, weight / 2)


def centroid(image: Floats) -> Floats:
    """The centre of gravity from the middle of a box, (x, y)."""
    at = np.arange(image.shape[0]) - image.shape[0] // 2
    return np.array([image.sum(axis=0) @ at, image.sum(axis=1) @ at]) / image.sum()
