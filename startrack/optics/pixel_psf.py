"""Optics enter; a Psf leaves: the fraction of light in each pixel, for any sub-pixel place."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy
from scipy import fft, special
from scipy.linalg import eigh_tridiagonal

from startrack.core import Floats, Psf, non_negative, positive, within
from startrack.optics.choose import AIRY_SIGMA, choose
from startrack.optics.fraunhofer import intensity, pupil_samples
from startrack.optics.parameters import Optics
from startrack.optics.transfer import blur_transfer, pixel_transfer, pupil_transfer
from startrack.optics.wavefront import steepest, wavefront


def gauss_band(wavelength: Floats, weight: Floats, count: int) -> tuple[Floats, Floats]:
    """The Gaussian quadrature of a discrete band.

    `count` nodes and weights give the same sum as the whole band for every polynomial of degree
    up to 2 count - 1 in the wavelength.

    Source: Golub and Welsch (1969), Math. Comp. 23, 221; the recurrence by Lanczos.

    wavelength  (k,) metre
    weight      (k,) not negative
    count       wanted nodes; fewer come back where the band has fewer wavelengths
    Returns     (n,) metre; (n,) 1, that sum to one
    Raises      ValueError where no weight is above zero.
    Accuracy    numerical: 1e-14 of the moments.
    """
    used = weight > 0
    if not used.any():
        raise ValueError("weight must be above zero at one wavelength at least")
    nodes, fraction = wavelength[used], weight[used] / weight[used].sum()
    if len(nodes) <= count:
        return nodes, fraction
    middle, half = nodes.mean(), np.ptp(nodes) / 2
    x = (nodes - middle) / half
    basis = [np.sqrt(fraction)]
    diagonal, beside = [], []
    for _ in range(count):
        new = x * basis[-1]
        diagonal.append(float(new @ basis[-1]))
        # Against all before, twice: three-term recurrences alone lose orthogonality.
        for _ in range(2):
            for old in basis:
                new = new - (new @ old) * old
        beside.append(float(np.linalg.norm(new)))
        basis.append(new / beside[-1])
    value, vector = eigh_tridiagonal(diagonal, beside[:-1])
    return middle + half * value, vector[0] ** 2


GAUSSIAN_BOX = 6.0  # sigma, half width of the table: 2e-9 of the energy lies outside
AIRY_BOX = 6.0  # wavelength * f-number, half width of the table beyond the blur
BAND_NODES = 12  # wavelengths that stand for a band
FINEST, COARSEST = 64, 12  # samples per pixel
PER_SIGMA = 8.0  # samples per sigma of the image's core
MOST_SAMPLES = 1024  # across a pupil
MOST_POINTS = 3072  # across the field of an irradiance


def pixel_psf(
    optics: Optics,
    pitch: float,
    wavelength: Floats,
    weight: Floats,
    fill_factor: float = 1.0,
    diffusion: float = 0.0,
) -> Psf:
    """The pixel-integrated PSF, tabulated.

        Psf = sum_k weight_k diffraction(wavelength_k) * blur * seeing * diffusion * pixel

    where * is a convolution: of transfer functions where these are known in closed form, of an
    irradiance computed point by point otherwise.

    Source: Krutz et al. (2011), eqs. (17)-(20).

    pitch        metre, side of a pixel
    wavelength   (k,) metre
    weight       (k,) fractions of the detected photons; need not sum to one
    fill_factor  1, area of the active square in the middle of a pixel over that of the pixel. The
                 table is divided by it, because whoever counts photons has counted it already
    diffusion    metre, sigma of the Gaussian that charge diffusion adds per axis
    Raises       ValueError where the wavefront needs more samples than MOST_SAMPLES.
    Accuracy     model: see `choose`; the fraction outside the table is 1 - Psf.energy. numerical:
                 1e-5 of the peak; see `pixel_response`, `pixel_average`, `stamp`. What is finer
                 than a sigma of 1/64 pixel is blurred to that, lest shares become negative between
                 the samples. So, where a pixel holds more than ten wavelength * f-number, a star
                 within 1/32 pixel of its edge is divided wrongly by some of its light: 7e-4 at
                 twenty, 0.01 at thirty, 0.08 at forty, 0.26 at 122.
    """
    positive(pitch=pitch, fill_factor=fill_factor)
    within(0, 1, fill_factor=fill_factor)
    non_negative(diffusion=diffusion)
    wavelength, weight = gauss_band(wavelength, weight, BAND_NODES)
    mean_wavelength = float(weight @ wavelength)
    side = pitch * math.sqrt(fill_factor)
    blur = math.hypot(optics.total_blur, diffusion)
    disk = mean_wavelength * optics.working_f_number
    core = math.hypot(AIRY_SIGMA * disk, blur)
    least = pitch / FINEST
    if core < least:  # what is finer than the samples would ring between them
        blur, core = math.sqrt(blur**2 + least**2 - core**2), least
    model = optics.psf
    if model == "auto":
        model = choose(optics, pitch, mean_wavelength, side).model
    if model == "gaussian":
        return _gaussian(core / pitch, side / pitch)
    reach = AIRY_BOX * disk + 5 * blur
    if model == "airy":
        return _airy(optics.working_f_number, pitch, side, wavelength, weight, blur, core, reach)
    return _diffraction(optics, model, pitch, side, wavelength, weight, blur, core, reach)


def _gaussian(sigma: float, side: float) -> Psf:
    """A Gaussian of `sigma` pixel: the table is a product of differences of error functions."""
    oversampling = _oversampling(sigma)
    half = _half(GAUSSIAN_BOX * sigma, oversampling)
    x = np.arange(-half, half + 1) / oversampling
    line = special.ndtr((x + side / 2) / sigma) - special.ndtr((x - side / 2) / sigma)
    line /= side
    inside = 1 - 2 * special.ndtr(-(half / oversampling) / sigma)
    return Psf(np.outer(line, line), oversampling, inside**2)


def _airy(
    f_number: float, pitch: float, side: float, wavelength: Floats, weight: Floats,
    blur: float, core: float, reach: float,
) -> Psf:  # fmt: skip
    def transfer(frequency: Floats) -> Floats:
        pupil = np.zeros_like(frequency)
        for fraction, each in zip(weight, wavelength, strict=True):
            pupil += fraction * pupil_transfer(frequency, each, f_number)
        return pupil * blur_transfer(frequency, blur)

    cusp = 4 / math.pi * float(weight @ wavelength) * f_number
    return pixel_response(transfer, pitch, reach / pitch, core / pitch, cusp, side)


def pixel_response(
    transfer: Callable[[Floats], Floats],
    pitch: float,
    half_width: float,
    finest: float,
    cusp: float = 0.0,
    side: float | None = None,
) -> Psf:
    """Turn a transfer function that depends on |f| alone into a table of pixel responses.

    The wings of diffraction fall with r^-3 and would fold back in a discrete transform. They come
    from the cusp 1 - cusp |f| of the transfer function; (cusp / a) exp(-a |f|) has the same cusp
    and wings, and its integral over a pixel is known in closed form. Only the difference is
    transformed; a is the core's width, so that it ends where the samples do.

    transfer    function of (...) cycle / metre that returns (...) 1
    pitch       metre
    half_width  pixel, wanted reach of the table
    finest      pixel, the scale on which the image varies; sets the sampling
    cusp        metre, minus the slope of the transfer function at zero
    side        metre, of a pixel's active square; the pitch if None
    Accuracy    numerical: 2e-6 of the peak, 1e-6 in energy.
    """
    side = side or pitch
    oversampling = _oversampling(finest)
    half = _half(half_width, oversampling)
    # What varies within one and a half samples has frequencies beyond theirs.
    fine = 2 if finest * oversampling < 1.5 else 1
    samples = fft.next_fast_len(8 * half * fine, real=True)
    spacing = pitch / oversampling / fine
    fx, fy = fft.rfftfreq(samples, spacing), fft.fftfreq(samples, spacing)
    radius = np.hypot(fx, fy[:, None])
    # A transfer function of one variable is costly to evaluate on the plane, cheap on a line.
    line = np.linspace(0, radius.max(), 4 * samples)
    decay = max(cusp, 2 * math.pi * finest * pitch)
    wings = cusp / decay * np.exp(-decay * line)
    spectrum = scipy.interpolate.CubicSpline(line, transfer(line) - wings)(radius)
    spectrum *= pixel_transfer(fx, side) * pixel_transfer(fy, side)[:, None]
    plane = fft.irfft2(spectrum, s=(samples, samples)) * (pitch / spacing) ** 2
    around = np.r_[-half : half + 1]
    table = plane[np.ix_(around * fine, around * fine)]
    if cusp > 0:
        shape = _wings(around / oversampling, decay / (2 * math.pi * pitch), side / pitch)
        table = table + cusp / decay * shape
    return Psf(np.ascontiguousarray(table), oversampling, _energy(table, oversampling))


def _wings(x: Floats, c: float, side: float) -> Floats:
    """The mean over a pixel of c / (2 pi (c^2 + r^2)^(3/2)), the transform of exp(-2 pi c |f|)."""
    edges = np.stack([x - side / 2, x + side / 2])
    u, v = edges[:, None, None, :], edges[None, :, :, None]
    corner = np.arctan(u * v / (c * np.sqrt(c * c + u * u + v * v))) / (2 * math.pi)
    return (corner[1, 1] - corner[1, 0] - corner[0, 1] + corner[0, 0]) / side**2


def _diffraction(
    optics: Optics, model: str, pitch: float, side: float, wavelength: Floats, weight: Floats,
    blur: float, core: float, reach: float,
) -> Psf:  # fmt: skip
    slope = steepest(optics, model)
    # A ray of slope s meets the detector 2 N s from the axis.
    reach += 2 * optics.working_f_number * slope
    oversampling = _oversampling(core / pitch)
    half = _half(reach / pitch, oversampling)
    # The irradiance has no frequency above 1 / (wavelength N): a third finer than Nyquist.
    fine = math.ceil(pitch / oversampling / (wavelength.min() * optics.working_f_number / 2.6))
    spacing = pitch / oversampling / fine
    margin = math.ceil((side / 2 + 6 * blur) / spacing) + 24
    count = 2 * (half * fine + margin) + 1
    if count > MOST_POINTS:
        raise ValueError(
            f"the diffraction pattern must fit {MOST_POINTS} points a side, got {count}: the "
            "defocus, the aberrations or the blur are too many wavelengths * f-number; let `blur` "
            "stand for them"
        )
    plane = irradiance(optics, model, wavelength, weight, spacing, count, slope)
    table = pixel_average(plane, spacing, side, blur)[margin:-margin:fine, margin:-margin:fine]
    table = table * pitch**2
    return Psf(np.ascontiguousarray(table), oversampling, _energy(table, oversampling))


def irradiance(
    optics: Optics,
    model: str,
    wavelength: Floats,
    weight: Floats,
    spacing: float,
    count: int,
    slope: float | None = None,
) -> Floats:
    """The irradiance of diffraction alone, summed over the band, at points of a grid.

    wavelength, weight  (k,) metre; (k,) 1
    spacing, count      metre; points along a side, odd, the axis in the middle
    slope               metre per radius, of the wavefront, if known
    Returns             (count, count) 1 / metre^2, of all light that passes the pupil
    Raises              ValueError beyond MOST_SAMPLES.
    Accuracy            numerical: 1e-5 of the peak.
    """
    slope = steepest(optics, model) if slope is None else slope
    shortest = float(wavelength.min())
    half_width = count // 2 * spacing / (shortest * optics.working_f_number)
    samples = pupil_samples(half_width, slope / shortest)
    if samples > MOST_SAMPLES:
        raise ValueError(
            f"the pupil must need at most {MOST_SAMPLES} samples, got {samples} for a field of "
            f"{2 * half_width:.0f} wavelength * f-number and a wavefront as steep as "
            f"{slope / shortest:.0f} waves per radius: let `blur` stand for it or, where the pupil "
            "is clear, take the model airy"
        )
    wave = wavefront(optics, model, samples)
    cell = wave.place[1] - wave.place[0]
    grid = (np.arange(count) - count // 2) * spacing
    total = np.zeros((count, count))
    for fraction, each in zip(weight, wavelength, strict=True):
        disk = each * wave.f_number
        # By Parseval the integral over the whole plane is one.
        unit = fraction * cell**2 / (4 * wave.energy * disk**2)
        total += unit * intensity(
            wave.weight, 2 * math.pi / each * wave.path, wave.place, grid / disk
        )
    return total


def pixel_average(plane: Floats, spacing: float, side: float, blur: float) -> Floats:
    """The mean of a sampled irradiance over a square around each sample, after a Gaussian blur.

    plane    (m, m), without frequencies above its Nyquist's
    spacing  metre
    Returns  (m, m); what lies within side / 2 + 6 blur + 24 samples of an edge has lost light
    Accuracy  numerical: exact to 1e-6 of the peak, because the plane has no more frequencies.
    """
    size = fft.next_fast_len(plane.shape[0] + math.ceil((side / 2 + 6 * blur) / spacing), real=True)
    fx, fy = fft.rfftfreq(size, spacing), fft.fftfreq(size, spacing)
    along = pixel_transfer(fx, side) * blur_transfer(fx, blur)
    down = pixel_transfer(fy, side) * blur_transfer(fy, blur)
    spectrum = fft.rfft2(plane, s=(size, size)) * along * down[:, None]
    return fft.irfft2(spectrum, s=(size, size))[: plane.shape[0], : plane.shape[1]]


def _energy(table: Floats, oversampling: int) -> float:
    """All light is counted once by the pixels of any sub-pixel phase; their mean is the energy."""
    edge = np.ones(len(table))
    # Gregory's ends, of fourth order: the table does not vanish at its edge.
    edge[:3] = edge[:-4:-1] = (3 / 8, 7 / 6, 23 / 24)
    return min(float(edge @ table @ edge) / oversampling**2, 1.0)


def _oversampling(finest: float) -> int:
    """Samples per pixel that let six-point interpolation reach 1e-6 of the peak."""
    return int(np.clip(math.ceil(PER_SIGMA / max(finest, 1e-3)), COARSEST, FINEST))


def _half(width: float, oversampling: int) -> int:
    """Samples from the centre to the edge of the table: the reach, half a pixel, and the taps."""
    # Whole pixels, so that a star anywhere in its pixel keeps as many on its left as on its right.
    return math.ceil((math.ceil(max(width, 1.0)) + 0.5) * oversampling) + 3
