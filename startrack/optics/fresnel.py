"""Fresnel diffraction of any pupil in any plane near the image, by a fast chirp transform.

    U(x) = Int P(xi) exp(i pi/lambda (1/z - 1/b) |xi|^2) exp(-2 pi i xi x / (lambda z)) d^2xi

Source: Krutz et al. (2011), eqs. (8) and (10): the lens cancels the quadratic phase of the image
plane z = b, and a clear circle gives 2 J1(v) / v. The transform onto a small field at any spacing
is a chirp convolution, Rabiner, Schafer and Rader (1969), Bell Syst. Tech. J. 48, 1249.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from startrack.core import Floats, positive

Complex = NDArray[np.complex128]


def fresnel(
    pupil: Complex,
    place: Floats,
    radius: float,
    wavelength: float,
    image: float,
    plane: float,
    spacing: float,
    count: int,
) -> Complex:
    """The amplitude on a square grid, relative to that of the open circle on the axis in focus.

    pupil    (n, n) 1, open area and aberrations, rows along y
    place    (n,) 1, of its samples in radii, evenly spaced and symmetric about zero
    radius   metre, of the aperture
    image    metre from the lens to the image, b
    plane    metre from the lens to the plane, z
    spacing  metre between the points of the grid
    count    points along a side, odd; the axis is in the middle
    Returns  (count, count), rows along y
    Raises    ValueError where the pupil is too coarse for the phase of the plane.
    Accuracy  model: paraxial.  numerical: 1e-13 beyond the sampling of the pupil; its cost grows as
              n log n a row, whatever the spacing.
    """
    positive(radius=radius, wavelength=wavelength, image=image, plane=plane, spacing=spacing)
    cell = (place[1] - place[0]) * radius
    bend = (1 / plane - 1 / image) / wavelength
    per_cell = abs(bend) * radius * cell + (count // 2) * spacing * cell / (wavelength * plane)
    if per_cell > 0.5:
        raise ValueError(
            f"the pupil must hold two samples a wave, got {1 / per_cell:.2f}: take at least "
            f"{math.ceil(2 * per_cell * len(place))} samples"
        )
    xi = place * radius
    wave = pupil * np.exp(1j * math.pi * bend * (xi**2 + xi[:, None] ** 2))
    step = cell * spacing / (wavelength * plane)  # cycles from sample to sample and point to point
    first = -(count // 2)
    transform = scipy.signal.CZT(
        len(place), count, w=np.exp(-2j * np.pi * step), a=np.exp(2j * np.pi * step * first)
    )
    # The transform counts samples from zero; the pupil starts at place[0].
    start = np.exp(-2j * np.pi * step * (first + np.arange(count)) * (xi[0] / cell))
    rows = transform(wave, axis=1) * start
    plane_wave = transform(rows, axis=0) * start[:, None]
    # |U| in focus is the area over lambda b; elsewhere the wave spreads over lambda z.
    return plane_wave * (cell**2 / (math.pi * radius**2) * image / plane)
