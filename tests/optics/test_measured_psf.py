"""Measured PSFs: from rendered stars, and wavefronts from images of points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from startrack.detector import stamp
from startrack.optics import Aberration, Optics, pixel_psf, reconstruct
from startrack.optics.measured_psf import PsfStars

PITCH, SIDE, ELECTRONS = 5e-6, 15, 20000.0
WAVES = np.array([600e-9]), np.ones(1)


def stars(psf, count, seed=1, ground=100.0):
    random = np.random.default_rng(seed)
    cuts = np.empty((count, SIDE, SIDE))
    x, y = random.uniform(-0.5, 0.5, (2, count))
    for cut, u, v in zip(cuts, x, y, strict=True):
        frame = np.zeros((SIDE, SIDE))
        stamp(
            frame, psf, np.array([u + SIDE // 2]), np.array([v + SIDE // 2]), np.array([ELECTRONS])
        )
        cut[:] = random.poisson(frame + ground) + random.normal(0, 5, frame.shape)
    guess = random.normal(0, 0.05, (2, count))
    return PsfStars(cuts, x + guess[0], y + guess[1], np.ones(len(x))), x, y


def test_stars_give_back_the_psf_that_they_were_rendered_with():
    """An asymmetric image two pixels wide, from 200 stars: within 2 % of the peak."""
    optics = Optics(0.05, 4.0, psf="fraunhofer", blur=3e-6, aberrations=(Aberration(8, 150e-9),))
    true = pixel_psf(optics, PITCH, *WAVES)
    cuts, x, y = stars(true, 200)
    found = reconstruct(cuts, 4)
    axis = np.arange(-5, 5.01, 0.25)
    half = len(found.psf.table) // 2
    inner = found.psf.table[half - 20 : half + 21, half - 20 : half + 21]

    def wanted(shift):
        middle = len(true.table) // 2
        u, v = (middle + (axis + move) * true.oversampling for move in shift)
        return map_coordinates(true.table, np.meshgrid(v, u, indexing="ij"), order=3)

    # Where a PSF has its centre is a convention; the wings decide the centroid.
    best = minimize(
        lambda shift: ((inner / inner.sum() - wanted(shift) / wanted(shift).sum()) ** 2).sum(),
        centroid(true),
        method="Nelder-Mead",
        options={"xatol": 1e-4},
    )
    true_box = wanted(best.x)
    # What lies outside of the box is not seen: the found sums to one inside.
    error = np.abs(inner / inner.sum() - true_box / true_box.sum()).max()
    error /= true_box.max() / true_box.sum()
    assert error < 0.02
    assert np.abs(best.x - centroid(true)).max() < 0.05
    moved = np.array([found.x - x, found.y - y])
    assert (moved - moved.mean(axis=1, keepdims=True)).std() < 0.02
    # Without the light outside of the box.
    assert np.median(found.flux) == pytest.approx(ELECTRONS, rel=0.05)


def centroid(psf):
    axis = (np.arange(len(psf.table)) - len(psf.table) // 2) / psf.oversampling
    near = np.abs(axis) <= 7
    t = psf.table[np.ix_(near, near)]
    axis = axis[near]
    return t.sum(0) @ axis / t.sum(), t.sum(1) @ axis / t.sum()
