"""Lens tables of lenses whose images have closed forms."""

from __future__ import annotations

import math

import numpy as np

from startrack.optics import LensTable

FOCAL, F_NUMBER = 0.05, 4.0


def ideal(vignetting: float = 0.0, **changes: object) -> LensTable:
    """A lens without aberrations and distortion, telecentric, of constant transmission.

    vignetting  fraction of the area that is lost at the edge of the field, as its square
    """
    field, wavelength = np.linspace(0, 0.2, 5), np.linspace(400e-9, 1000e-9, 5)
    shape = 1, len(wavelength), len(field)
    half = np.full(shape, 0.5 / F_NUMBER)
    narrow = half * (1 - vignetting * (field / field[-1]) ** 2)
    zero = np.zeros(shape)
    table = {
        "name": "ideal",
        "source": "a closed form",
        "focal_length": FOCAL,
        "f_number": F_NUMBER,
        "temperature": np.array([293.15]),
        "wavelength": wavelength,
        "field": field,
        "noll": np.array([4, 8, 11]),
        "wavefront": np.zeros((*shape, 3)),
        "place": np.broadcast_to(FOCAL * np.tan(field), shape).copy(),
        "pupil": np.stack([zero, half, half, zero, half, narrow], axis=-1),
        "outline": np.zeros((*shape, 0)),
        "area": math.pi / 4 * (FOCAL / F_NUMBER) ** 2 * narrow / half,
        "amplitude": np.zeros((*shape, 0)),
        "curvature": zero,
    }
    return LensTable(**(table | changes))
