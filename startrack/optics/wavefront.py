"""Optics -> the complex pupil of each diffraction model.

Every model is a Fourier integral over the pupil, which differs in amplitude, path and scale:

    U(x) = Int A(q) exp(i k path(q)) exp(-i k q x / scale) d^2q,   |q| <= rim

| model | q | amplitude | path, detector at b + d |
|---|---|---|---|
| fraunhofer | in the lens | 1 | -d q^2 / (2 b^2) |
| fresnel | in the lens, scale b + d | 1 | -d q^2 / (2 b (b + d)) |
| kirchhoff, aplanatic | b sin(angle) | cos^(-1/2) | d (cos - 1) |
| kirchhoff, thin lens | b sin(angle) | (1 + r^2/b^2) g^2/(g^2 + r^2) | d (cos - 1) + defect |

The angle is that of the ray at the focus.

Sources: Krutz et al. (2011), eqs. (7) and (8). For a thin lens the image of eq. (7) is written over
the sine of the ray's angle, q = r / sqrt(1 + r^2/b^2), whose Jacobian is (1 + r^2/b^2)^2. For the
aplanatic lens: Richards and Wolf (1959), Proc. R. Soc. A 253, 358: sine condition, cos^(1/2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats
from startrack.optics.kirchhoff import path_defect
from startrack.optics.parameters import Optics
from startrack.optics.pupil import area_weights, pupil_grid
from startrack.optics.zernike import zernike

STEEPEST = 0.999  # largest sine of an angle at the focus; it clips the soft edge beyond the rim


@dataclass(frozen=True, eq=False)
class Wavefront:
    """A sampled pupil.

    coordinate  (n,) 1, of the samples in units of the rim
    weight      (n, n) 1, open area times amplitude
    path        (n, n) metre
    energy      1, the sum of open area times amplitude squared
    f_number    1, scale / (2 rim)
    """

    coordinate: Floats
    weight: Floats
    path: Floats
    energy: float
    f_number: float


def wavefront(optics: Optics, model: str, samples: int) -> Wavefront:
    """The pupil of a model on `samples` by `samples` cells.

    Accuracy  model "kirchhoff": without the phase k x^2 R^2 / b^3 of an image point x, a tenth of a
              radian at x = 0.1 sqrt(lambda b^3) / R, farther out than any table reaches.
    """
    coordinate, cell = pupil_grid(samples)
    opened = area_weights(optics.pupil, coordinate, cell)
    b, radius = optics.image_distance, optics.aperture / 2
    scale, rim = b, radius
    amplitude: Floats | float = 1.0
    square = (coordinate**2 + coordinate[:, None] ** 2) * radius**2
    # From coordinates to those in the lens, the arguments of the Zernike polynomials.
    in_lens: Floats | float = 1.0
    if model == "fraunhofer":
        path = -optics.defocus * square / (2 * b**2)
    elif model == "fresnel":
        scale = b + optics.defocus
        path = -optics.defocus * square / (2 * b * scale)
    else:
        thin = optics.lens != "aplanatic"
        rim = radius / math.hypot(1, radius / b) if thin else radius
        sine2 = np.minimum((rim / radius) ** 2 * square / b**2, STEEPEST**2)
        cosine = np.sqrt(1 - sine2)
        # d (cos - 1) without cancellation
        path = -optics.defocus * sine2 / (1 + cosine)
        if thin:
            lens2 = sine2 / (1 - sine2) * b**2
            g = optics.object_distance or math.inf
            amplitude = 1 + lens2 / b**2
            if math.isfinite(g):
                amplitude = amplitude * g**2 / (g**2 + lens2)
            if optics.lens == "parabolic":
                path = path + path_defect(lens2, b, g)
            in_lens = (rim / radius) / cosine
        else:
            amplitude = 1 / np.sqrt(cosine)
    x, y = coordinate * in_lens, coordinate[:, None] * in_lens
    for each in optics.aberrations:
        if each.growth == 0 and each.rms:
            path = path + each.rms * zernike(each.noll, x, y)
    weight = opened * amplitude
    return Wavefront(coordinate, weight, path, float((weight * amplitude).sum()), scale / (2 * rim))


def steepest_slope(optics: Optics, model: str) -> float:
    """Metre of path per radius of the aperture: the steepest slope of the wavefront."""
    wave = wavefront(optics, model, 96)
    down, across = np.gradient(wave.path, wave.coordinate, wave.coordinate)
    inside = np.hypot(wave.coordinate, wave.coordinate[:, None]) <= 1
    return float(np.hypot(down, across)[inside].max())
