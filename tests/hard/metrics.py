"""Statistics of few trials, and of trials that all succeed or all fail."""

from __future__ import annotations

import numpy as np

from startrack.metrics import Star, attitude_bound, centroid_bound
from tests.hard.case import hard, refused


@hard("metrics", "centroid of a bright wide star over sigma / sqrt(flux)", (0.999, 1.001))
def _bright() -> float:
    """With photon noise of the star alone and small pixels: the bound of the continuum."""
    return centroid_bound(Star(1e8, 3.0))[0] / (np.sqrt(3.0**2 + 1 / 12) / 1e4)


@hard("metrics", "centroid in deep noise over sigma^2 sqrt(8 pi) noise / flux", (0.99, 1.01))
def _faint() -> float:
    """Winick's limit if the noise of the background dominates."""
    noise, flux, sigma = 1000.0, 10.0, 2.0
    wanted = np.sqrt(8 * np.pi) * (sigma**2 + 1 / 12) * noise / flux
    return centroid_bound(Star(flux, sigma, 0.0, noise))[0] / wanted


@hard("metrics", "smear of 50 pixels: along over across", (5, 100))
def _smear() -> float:
    along, across = centroid_bound(Star(1e4, 0.8, 20.0, 8.0, 50.0))
    return along / across


@hard("metrics", "two stars make no field", "stars must")
def _two() -> str:
    return refused(lambda: attitude_bound(0.1, 0.1, 2, 1e-5))


@hard("metrics", "a field of half the sky", "fov_x must lie in (0, pi)")
def _half() -> str:
    return refused(lambda: attitude_bound(np.pi, 0.1, 5, 1e-5))
