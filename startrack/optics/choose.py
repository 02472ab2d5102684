"""Optics -> the complex pupil of each diffraction model; the cheapest within a tolerance."""

import math
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, is_code
from startrack.optics.diffraction import blur_transfer, pixel_transfer, pupil_transfer
from startrack.optics.parameters import MODELS, Optics
from startrack.optics.pupil import area_weights, nearest_segment, pupil_grid, segment_path, zernike

STEEPEST = 0.999  # largest sine of an angle at the focus; it clips the soft edge beyond the rim


@dataclass(frozen=True, eq=False)
class Wavefront:
    """A sampled pupil.

    coordinate  (n,) 1, coordinates of the samples in units of the rim
    weight      (n, n) 1, open area times amplitude
    path        (n, n) metre, wavefront error
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

    Accuracy  model "kirchhoff": leaves out the phase k x^2 R^2 / b^3 of an image point x, which is
              0.1 radian at x = 0.1 sqrt(lambda b^3) / R, farther out than any table.
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
    for aberration in optics.aberrations:
        if aberration.growth == 0 and aberration.rms:
            path = path + aberration.rms * zernike(aberration.noll, x, y)
    if not optics.pupil.phased:
        path = path + segment_path(optics.pupil, coordinate, coordinate[:, None], radius)
    weight = opened * amplitude
    return Wavefront(coordinate, weight, path, float((weight * amplitude).sum()), scale / (2 * rim))


def steepest_slope(optics: Optics, model: str) -> float:
    """Metre of path per radius of the aperture: the steepest slope of the wavefront."""
    wave = wavefront(optics, model, 96)
    down, across = np.gradient(wave.path, wave.coordinate, wave.coordinate)
    inside = np.hypot(wave.coordinate, wave.coordinate[:, None]) <= 1
    if not optics.pupil.phased:  # steps between segments do not count as slopes
        x, y = wave.coordinate, wave.coordinate[:, None]
        step = np.gradient(nearest_segment(optics.pupil, x, y).astype(float))
        inside &= (step[0] == 0) & (step[1] == 0)
    return float(np.hypot(down, across)[inside].max())


AIRY_SIGMA = math.sqrt(2) / math.pi  # wavelength * f-number: peak and energy of the Airy disk
SAMPLES = 64  # across the pupils that are compared; chosen by hand
STRETCH = 0.81  # maximum of |v dE/dv| of the Airy disk, of its peak: 4 jinc(v) J2(v)


@dataclass(frozen=True)
class PsfChoice:
    """A model, its error and the reason for it.

    model   one of MODELS
    error   1, bound on the difference from the Kirchhoff integral, as a fraction of the PSF's peak
    reason  reason for the model, one sentence
    errors  the bound of each model, cheapest first; infinity if a model does not apply
    """

    model: str
    error: float
    reason: str
    errors: dict[str, float]


def choose(optics: Optics, pitch: float, wavelength: float, side: float | None = None) -> PsfChoice:
    """The cheapest model within `optics.psf_tolerance`, or the model that `optics` names.

    The error of a model is the sum of the differences between successive models up to Kirchhoff.
    For two pupils of unit energy at a distance e, the irradiance differs by at most (2 e + e^2) of
    the peak, and the transfer function by 2 e (Cauchy-Schwarz inequality).

    pitch, side  metre, of a pixel and of its active square (the whole pixel if None)
    wavelength   metre, mean of the band
    Accuracy     model: the bounds are two to ten times the true difference, as a fraction of the
                 unaberrated peak. The Kirchhoff model is scalar: no polarisation.
    """
    if is_code(optics.psf):
        unknown = dict.fromkeys(MODELS, math.nan)
        return PsfChoice(optics.psf, math.nan, "the design names user code", unknown)
    kappa, gaussian = _integrals(optics, side or pitch, wavelength)
    steps = {
        "gaussian": gaussian if optics.plain else math.inf,
        "airy": 0.0 if optics.plain else math.inf,
        "fraunhofer": kappa * _step_bound(optics, "fraunhofer", "fresnel", wavelength),
        "fresnel": kappa * _step_bound(optics, "fresnel", "kirchhoff", wavelength),
        "kirchhoff": 0.0,
    }
    bounds = np.cumsum([steps[model] for model in reversed(MODELS)])[::-1]
    # Each error is the sum of this step and of all steps after it.
    errors = {model: float(bound) for model, bound in zip(MODELS, bounds, strict=True)}
    if optics.psf != "auto":
        model, reason = optics.psf, "the design names it"
    else:
        model = next(candidate for candidate in MODELS if errors[candidate] <= optics.psf_tolerance)
        before = MODELS[MODELS.index(model) - 1] if model != MODELS[0] else None
        reason = f"its error is within {optics.psf_tolerance:.1g} of the peak; no model is cheaper"
        if before and math.isinf(errors[before]):
            reason = f"{before} needs a clear pupil in focus without aberrations"
        elif before:
            reason = f"{before} may err by {errors[before]:.1g} of the peak"
    return PsfChoice(model, errors[model], reason, errors)


def _integrals(optics: Optics, side: float, wavelength: float) -> tuple[float, float]:
    """Factor of blur and pixel on a difference; difference of Gaussian and Airy."""
    f_number = optics.working_f_number
    node, fraction = np.polynomial.legendre.leggauss(200)
    # To the cutoff, or to where the transfer function of the blur is exp(-40).
    last = 1 / (wavelength * f_number)
    if optics.total_blur:
        last = min(last, 9 / (2 * math.pi * optics.total_blur))
    frequency = (node + 1) / 2 * last
    turn = (np.arange(16) + 0.5) * (math.pi / 32)
    fx, fy = np.multiply.outer(frequency, (np.cos(turn), np.sin(turn))).swapaxes(0, 1)
    pixel = pixel_transfer(fx, side) * pixel_transfer(fy, side)
    rest = blur_transfer(frequency, optics.total_blur)
    ring = fraction * frequency * rest
    airy = pupil_transfer(frequency, wavelength, f_number)
    gauss = blur_transfer(frequency, AIRY_SIGMA * wavelength * f_number)
    peak = float(ring * airy @ pixel.mean(axis=1))
    open_peak = float(fraction * frequency @ airy)
    size = np.abs(pixel).mean(axis=1)
    kappa = min(float(ring @ size), open_peak) / peak
    # Beyond the cutoff only the Gaussian is not zero: its integral from the cutoff, in the ring's
    # unit.
    sigma = AIRY_SIGMA * wavelength * f_number
    tail = math.exp(-2 * (math.pi * sigma * last) ** 2) / (2 * math.pi * sigma * last) ** 2
    tail *= 2 * float(rest[-1])
    return max(kappa, 1.0), (float(ring * np.abs(gauss - airy) @ size) + tail) / peak


def _step_bound(optics: Optics, lower: str, upper: str, wavelength: float) -> float:
    """Bound on the difference of the irradiance of two models, as a fraction of the peak."""
    a, b = wavefront(optics, lower, SAMPLES), wavefront(optics, upper, SAMPLES)
    phase = 2 * math.pi / wavelength * (b.path - a.path)
    # Each weight contains the open area: their product over it is the overlap of amplitudes.
    overlap = _overlap(a.weight, b.weight, optics, phase) / math.sqrt(a.energy * b.energy)
    distance = math.sqrt(max(2 - 2 * min(overlap, 1.0), 0.0))
    stretch = abs(math.log(a.f_number / b.f_number))
    return min(2 * distance + distance**2 + STRETCH * stretch, 2.0)


def _overlap(a: Floats, b: Floats, optics: Optics, phase: Floats) -> float:
    opened = area_weights(optics.pupil, *pupil_grid(SAMPLES))
    inside = opened != 0
    product = np.zeros_like(opened)
    product[inside] = a[inside] * b[inside] / opened[inside]
    return float(abs((product * np.exp(1j * phase)).sum()))


def path_defect(square: Floats, image: float, distance: float) -> Floats:
    """Metre: path through a parabolic lens at radius^2 minus the path through its centre.

    sqrt(b^2 + s) - b - s/(2b) = -s^2 / (2 b (sqrt(b^2 + s) + b)^2): no digits are lost.
    """
    path = -(square**2) / (2 * image * (np.sqrt(image**2 + square) + image) ** 2)
    if math.isfinite(distance):
        path = path - square**2 / (2 * distance * (np.sqrt(distance**2 + square) + distance) ** 2)
    return path
