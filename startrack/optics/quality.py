"""Psf -> figures of merit: transfer at Nyquist, energies, widths."""

from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, Psf

RADII = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0)  # pixel, of circles for encircled energies
BLOCKS = (1, 3, 5, 7)  # pixels along a side
POINT = 1e-4  # fill factor of tiny pixels, whose table is the image itself


@dataclass(frozen=True)
class Quality:
    """Figures of merit of a PSF before and after its integration over pixels.

    mtf_x, mtf_y    1, modulation at Nyquist, half a cycle per pixel, the pixel included
    fwhm_x, fwhm_y  pixel, full width at half maximum of the image before the pixels
    encircled       1, fraction of the star's energy within RADII pixel of its image
    ensquared       1, fraction in BLOCKS by BLOCKS pixels, the star in the middle of one of them
    energy          1, fraction within the table
    """

    mtf_x: float
    mtf_y: float
    fwhm_x: float
    fwhm_y: float
    encircled: tuple[float, ...]
    ensquared: tuple[float, ...]
    energy: float


def quality(response: Psf, image: Psf) -> Quality:
    """Figures of merit from two tables of the same optics.

    response  table integrated over pixels
    image     table with `fill_factor=POINT`
    Accuracy  numerical: 2e-3 in modulation, 1e-3 in energy; energies beyond the table are NaN.
    """
    middle = image.table.shape[0] // 2
    nyquist = np.array([0.5])
    return Quality(
        mtf_x=float(modulation(response, nyquist, 0)[0]),
        mtf_y=float(modulation(response, nyquist, np.pi / 2)[0]),
        fwhm_x=full_width(image.table[middle], image.oversampling),
        fwhm_y=full_width(image.table[:, middle], image.oversampling),
        encircled=tuple(encircled(image, radius) for radius in RADII),
        ensquared=tuple(ensquared(response, block) for block in BLOCKS),
        energy=response.energy,
    )


def modulation(psf: Psf, frequency: Floats, angle: float) -> Floats:
    """Modulus of the transfer function of a table.

    frequency  (n,) cycle / pixel
    angle      radian, direction of the wave, from +x towards +y
    Returns    (n,) 1; at zero it is the energy within the table
    Accuracy   the wings outside the table are left out: 2e-3 above two cycles per width of the
               table.
    """
    at = (np.arange(psf.table.shape[0]) - psf.table.shape[0] // 2) / psf.oversampling
    along = np.exp(-2j * np.pi * np.outer(frequency * np.cos(angle), at))
    down = np.exp(-2j * np.pi * np.outer(frequency * np.sin(angle), at))
    value = np.einsum("nj,ji,ni->n", down, psf.table, along, optimize=True)
    return np.abs(value) / psf.oversampling**2


def full_width(line: Floats, oversampling: int) -> float:
    """Pixel between the outermost points where a line falls to half its maximum."""
    half = line.max() / 2
    above = np.flatnonzero(line >= half)
    first, last = int(above[0]), int(above[-1])
    if first == 0 or last == len(line) - 1:
        return float("nan")
    left = first - (line[first] - half) / (line[first] - line[first - 1])
    right = last + (line[last] - half) / (line[last] - line[last + 1])
    return float(right - left) / oversampling


def encircled(image: Psf, radius: float) -> float:
    """Fraction of the energy within a circle of `radius` pixel; NaN beyond the table."""
    if radius > image.half_width:
        return float("nan")
    at = np.arange(image.table.shape[0]) - image.table.shape[0] // 2
    # The rim is one sample wide and soft, so that the area of the circle is right.
    fraction = np.clip(radius * image.oversampling - np.hypot(at, at[:, None]) + 0.5, 0, 1)
    return float((image.table * fraction).sum()) / image.oversampling**2


def ensquared(response: Psf, block: int) -> float:
    """Fraction of the energy in `block` (odd) by `block` pixels; NaN beyond the table."""
    step, middle = response.oversampling, response.table.shape[0] // 2
    half = block // 2 * step
    if half > middle:
        return float("nan")
    inside = slice(middle - half, middle + half + 1, step)
    return float(response.table[inside, inside].sum())
