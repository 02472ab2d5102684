"""The cheapest model of the PSF within a tolerance, and the reason."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from startrack.core import Floats, is_code
from startrack.optics.closed_forms import blur_transfer, pixel_transfer, pupil_transfer
from startrack.optics.parameters import MODELS, Optics
from startrack.optics.pupil import area_weights, pupil_grid
from startrack.optics.wavefront import wavefront

AIRY_SIGMA = math.sqrt(2) / math.pi  # wavelength * f-number: peak and energy of the Airy disk
SAMPLES = 64  # across the pupils that are compared; chosen by hand
STRETCH = 0.81  # maximum of |v dE/dv| of the Airy disk, of its peak: 4 jinc(v) J2(v)


@dataclass(frozen=True)
class Choice:
    """A model, its error and the reason for it.

    model   one of MODELS
    error   1, bound on the difference from the Kirchhoff integral, of the PSF's peak
    reason  one sentence
    errors  the bound of each model, cheapest first; infinity where a model does not apply
    """

    model: str
    error: float
    reason: str
    errors: dict[str, float]


def choose(optics: Optics, pitch: float, wavelength: float, side: float | None = None) -> Choice:
    """The cheapest model within `optics.psf_tolerance`, or the one that optics names.

    The error of a model is the sum of the differences from model to model up to Kirchhoff. For two
    pupils of unit energy at a distance e, the irradiance differs by at most (2 e + e^2) of the
    peak, and the transfer function by 2 e (Cauchy-Schwarz inequality).

    pitch, side  metre, of a pixel and of its active square (the whole pixel if None)
    wavelength   metre, mean of the band
    Accuracy     model: the bounds are two to ten times the true difference, as a fraction of the
                 unaberrated peak. The Kirchhoff model is scalar: no polarisation.
    """
    if is_code(optics.psf):
        unknown = dict.fromkeys(MODELS, math.nan)
        return Choice(optics.psf, math.nan, "the design names code of its own", unknown)
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
    if not optics.plain:
        errors["gaussian"] = errors["airy"] = math.inf
    if optics.psf != "auto":
        model, reason = optics.psf, "the design names it"
    else:
        model = next(each for each in MODELS if errors[each] <= optics.psf_tolerance)
        before = MODELS[MODELS.index(model) - 1] if model != MODELS[0] else None
        reason = f"it keeps {optics.psf_tolerance:.1g} of the peak and no model is cheaper"
        if before and math.isinf(errors[before]):
            reason = f"{before} needs a clear pupil in focus without aberrations"
        elif before:
            reason = f"{before} may err by {errors[before]:.1g} of the peak"
    return Choice(model, errors[model], reason, errors)


def _integrals(optics: Optics, side: float, wavelength: float) -> tuple[float, float]:
    """Factor by which blur and pixel raise a difference; difference of Gaussian and Airy."""
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
    # Beyond the cutoff only the Gaussian is not zero: its integral from there, in the ring's units.
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
