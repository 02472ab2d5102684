"""Optics -> Psf: the fraction of the light in each pixel, for any sub-pixel position.

The irradiance is from a diffraction model, a file or user code. Aberrations grow over the field
with the distance from the axis."""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from scipy import fft, special
from scipy.linalg import eigh_tridiagonal

from startrack import core
from startrack.core import POINTS, Floats, Psf, Refused, is_code
from startrack.optics import diffraction
from startrack.optics.choose import AIRY_SIGMA, choose, steepest_slope, wavefront
from startrack.optics.diffraction import blur_transfer, pixel_average, pixel_transfer
from startrack.optics.parameters import Optics
from startrack.optics.psf_file import open_psf_file, psf_of_file
from startrack.optics.pupil import Aberration, nm_to_noll, noll_to_nm

GROUP = "psfs"


@dataclass(frozen=True, eq=False)
class PsfInput:
    """Points and light for which the irradiance of a star is computed.

    x, y        (m, m) metre on the detector, along columns and rows, from the star's place
    wavelength  (k,) metre, of the detected light
    weight      (k,) 1, of its photons; the sum is 1
    optics      optics of the design: focal length, f-number, defocus, ...

    The function returns the irradiance (m, m) on any scale, without the design's blur, diffusion
    and pixels.
    """

    x: Floats
    y: Floats
    wavelength: Floats
    weight: Floats
    optics: Optics


def irradiance_by_code(
    optics: Optics, wavelength: Floats, weight: Floats, spacing: float, count: int
) -> Floats:
    """The irradiance (count, count) by user code that a design names; its integral is one.

    Raises  ValueError if the function raises an error, or returns an invalid result.
    """
    name, line = optics.psf, (np.arange(count, dtype=float) - count // 2) * spacing
    x, y = np.meshgrid(line, line)
    answer = core.call_code(GROUP, name, PsfInput(x, y, wavelength, weight, optics))
    plane = core.returned(GROUP, name, answer, (count, count))
    if (plane < 0).any() or not plane.any():
        raise ValueError(f"{POINTS[GROUP]} {name} must return irradiances that are not negative")
    return np.asarray(plane / (plane.sum() * spacing**2))


def gauss_band(wavelength: Floats, weight: Floats, count: int) -> tuple[Floats, Floats]:
    """Gaussian quadrature of a discrete band.

    For each polynomial in the wavelength of degree up to 2 count - 1, `count` nodes and weights
    give the same sum as the whole band.

    Source: Golub and Welsch (1969), Math. Comp. 23, 221; the recurrence by Lanczos.

    wavelength  (k,) metre
    weight      (k,) 1, not negative
    count       largest number of nodes
    Returns     (n,) metre; (n,) 1, of sum one; n is less than count for a band of fewer wavelengths
    Raises      ValueError if no weight is above zero.
    Accuracy    numerical: 1e-14 of the moments.
    """
    used = weight > 0
    if not used.any():
        raise Refused("weight must be above zero at one wavelength at least")
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
        # Orthogonalise against all earlier vectors, twice: three-term recurrences lose
        # orthogonality.
        for _ in range(2):
            for old in basis:
                new = new - (new @ old) * old
        beside.append(float(np.linalg.norm(new)))
        basis.append(new / beside[-1])
    value, vector = eigh_tridiagonal(diagonal, beside[:-1])
    return middle + half * value, vector[0] ** 2


GAUSSIAN_BOX = 6.0  # sigma, half width of the table: 2e-9 of the energy lies outside
AIRY_BOX = 6.0  # wavelength * f-number, half width of the table beyond the blur
BAND_NODES = 12  # wavelengths of a band; chosen by hand: each costs one diffraction integral
FINEST, COARSEST = 64, 12  # samples per pixel; chosen by hand: memory against the finest PSF
PER_SIGMA = 8.0  # samples per sigma of the core: six-point interpolation errs by 1e-6 of the peak
MOST_SAMPLES = 1024  # across a pupil; chosen by hand: seconds of computing time
BYTES = 72  # memory of a sample of a transfer function; measured
EXTENSION_BOX = 8.0  # pixel, least half width of the table of a user's PSF; by hand
OWN_SAMPLES = 12  # least samples per pixel of a user's PSF; chosen by hand
MOST_POINTS = 3072  # across the field of an irradiance; chosen by hand: 75 MB


def pixel_psf(
    optics: Optics,
    pitch: float,
    wavelength: Floats,
    weight: Floats,
    fill_factor: float = 1.0,
    diffusion: float = 0.0,
) -> Psf:
    """Table of the pixel-integrated PSF.

        Psf = sum_k weight_k diffraction(wavelength_k) * blur * seeing * diffusion * pixel

    * is a convolution. Models with a closed form multiply transfer functions. The other models
    average an irradiance that is computed point by point.

    Source: Krutz et al. (2011), eqs. (17)-(20).

    pitch        metre, side of a pixel
    wavelength   (k,) metre
    weight       (k,) 1, in proportion to the detected photons
    fill_factor  1, area of the active square in the middle of a pixel over the pixel's area. The
                 table is divided by it, because the number of detected photons contains it
    diffusion    metre, sigma of the Gaussian that charge diffusion adds per axis
    Raises       ValueError if the wavefront needs more than 1024 samples across the pupil or
                 its image more than 3072 points.
    Accuracy     model: see `choose`; the fraction outside the table is 1 - Psf.energy. numerical:
                 1e-5 of the peak; see `pixel_response`, `pixel_average`, `stamp`. A core with a
                 sigma below 1/64 pixel is blurred to this sigma, so that interpolation does not
                 make fractions negative. If a pixel is wider than 10 wavelength * f-number, this
                 makes the fractions of a star within 1/32 pixel of an edge wrong: by 7e-4 at a
                 width of 20 wavelength * f-number, 0.01 at 30, 0.08 at 40, 0.26 at 122.
    """
    core.positive(pitch=pitch, fill_factor=fill_factor)
    core.within(0, 1, fill_factor=fill_factor)
    core.non_negative(diffusion=diffusion)
    if optics.tabulated:
        raise Refused("lens_file must be left out if one image represents the whole field")
    if optics.psf_file:
        return psf_of_file(
            open_psf_file(optics.psf_file), pitch, optics.total_blur, fill_factor, diffusion
        )
    wavelength, weight = gauss_band(wavelength, weight, BAND_NODES)
    mean_wavelength = float(weight @ wavelength)
    side = pitch * math.sqrt(fill_factor)
    blur = math.hypot(optics.total_blur, diffusion)
    disk = mean_wavelength * optics.working_f_number
    finest = math.hypot(AIRY_SIGMA * disk, blur)
    least = pitch / FINEST
    if finest < least:  # interpolation of a finer core would oscillate
        blur, finest = math.sqrt(blur**2 + least**2 - finest**2), least
    model = optics.psf
    if is_code(model):
        extent = max(EXTENSION_BOX * pitch, AIRY_BOX * disk + 5 * blur)
        on_grid = partial(irradiance_by_code, optics, wavelength, weight)
        return _sampled(on_grid, pitch, side, blur, extent, OWN_SAMPLES, 1)
    if model == "auto":
        model = choose(optics, pitch, mean_wavelength, side).model
    if model == "gaussian":
        return _gaussian(finest / pitch, side / pitch)
    extent = AIRY_BOX * disk + 5 * blur
    if model == "airy":
        return _airy(optics.working_f_number, pitch, side, wavelength, weight, blur, finest, extent)
    return _diffraction(optics, model, pitch, side, wavelength, weight, blur, finest, extent)


def _sampled(
    irradiance_on: Callable[[float, int], Floats],
    pitch: float,
    side: float,
    blur: float,
    extent: float,
    oversampling: int,
    fine: int,
) -> Psf:
    """Pixel response of an irradiance; light beyond the table is left out.

    The irradiance is a function of spacing (metre) and number of points along a side.
    """
    half = _half_samples(extent / pitch, oversampling)
    spacing = pitch / oversampling / fine
    room = math.ceil((side / 2 + 6 * blur) / spacing)
    margin = room + 24
    plane = irradiance_on(spacing, 2 * (half * fine + margin) + 1)
    inside = slice(margin, -margin, fine)
    table = pixel_average(plane, spacing, side, blur, room)[inside, inside]
    return _as_psf(table * pitch**2, oversampling)


def _gaussian(sigma: float, side: float) -> Psf:
    """A Gaussian of `sigma` pixel: its table is a product of differences of error functions."""
    oversampling = _oversampling(sigma)
    half = _half_samples(GAUSSIAN_BOX * sigma, oversampling)
    x = np.arange(-half, half + 1) / oversampling
    line = special.ndtr((x + side / 2) / sigma) - special.ndtr((x - side / 2) / sigma)
    line /= side
    inside = 1 - 2 * special.ndtr(-(half / oversampling) / sigma)
    return Psf(np.outer(line, line), oversampling, inside**2)


def _airy(
    f_number: float,
    pitch: float,
    side: float,
    wavelength: Floats,
    weight: Floats,
    blur: float,
    finest: float,
    extent: float,
) -> Psf:
    def transfer(frequency: Floats) -> Floats:
        pupil = np.zeros_like(frequency)
        for fraction, metre in zip(weight, wavelength, strict=True):
            pupil += fraction * diffraction.pupil_transfer(frequency, metre, f_number)
        return pupil * blur_transfer(frequency, blur)

    cusp = 4 / math.pi * float(weight @ wavelength) * f_number
    return pixel_response(transfer, pitch, extent / pitch, finest / pitch, cusp, side)


def pixel_response(
    transfer: Callable[[Floats], Floats],
    pitch: float,
    half_width: float,
    finest: float,
    cusp: float = 0.0,
    side: float | None = None,
) -> Psf:
    """Table of pixel responses from a transfer function that depends on |f| alone.

    The wings of diffraction decrease with r^-3, and a discrete transform would alias them. They
    come from the cusp 1 - cusp |f| of the transfer function. The function (cusp / a) exp(-a |f|)
    has the same cusp and wings, and its integral over a pixel has a closed form. Only the
    difference from this function is transformed. The length a is proportional to the width of the
    core, so that the exponential is well sampled.

    transfer    function of (...) cycle / metre that returns (...) 1
    pitch       metre
    half_width  pixel, least half width of the table
    finest      pixel, sigma of the core of the image; sets the sampling
    cusp        metre, minus the slope of the transfer function at zero
    side        metre, of the active square of a pixel; the pitch if None
    Accuracy    numerical: 2e-6 of the peak, 1e-6 in energy.
    """
    side = side or pitch
    oversampling = _oversampling(finest)
    half = _half_samples(half_width, oversampling)
    # A core of less than 1.5 samples has frequencies above the Nyquist frequency of the samples.
    fine = 2 if finest * oversampling < 1.5 else 1
    core.require_memory(BYTES * (8 * half * fine) ** 2, "the table of so wide a PSF")
    samples = fft.next_fast_len(8 * half * fine, real=True)
    core.require_memory(BYTES * samples**2, f"a transfer function of {samples} x {samples} samples")
    spacing = pitch / oversampling / fine
    # Negative frequencies along the rows have the values of the positive ones.
    order = np.arange(samples)
    along = np.minimum(order, samples - order)
    fx = fft.rfftfreq(samples, spacing)
    # A transfer function of one variable costs less on a line than on half of a symmetric plane.
    half_plane = np.tri(len(fx), dtype=bool)
    radius = np.hypot(fx, fx[:, None])[half_plane]
    line = np.linspace(0, radius.max(), 4 * samples)
    decay = max(cusp, 2 * math.pi * finest * pitch)
    wings = cusp / decay * np.exp(-decay * line)
    spectrum = np.empty((len(fx), len(fx)))
    spectrum[half_plane] = spectrum.T[half_plane] = scipy.interpolate.CubicSpline(
        line, transfer(line) - wings
    )(radius)
    pixel = pixel_transfer(fx, side)
    spectrum *= pixel * pixel[:, None]
    around = np.r_[-half : half + 1]
    # Rows beyond the table are not transformed; both transforms share the factor of irfft2.
    rows = fft.ifft(spectrum[along] + 0j, axis=0, norm="forward", overwrite_x=True)[around * fine]
    plane = fft.irfft(rows, samples, norm="forward") * (1 / samples**2) * (pitch / spacing) ** 2
    table = plane[:, around * fine]
    if cusp > 0:
        shape = _wings(around / oversampling, decay / (2 * math.pi * pitch), side / pitch)
        table = table + cusp / decay * shape
    return _as_psf(table, oversampling)


def _wings(x: Floats, c: float, side: float) -> Floats:
    """The mean over a pixel of c / (2 pi (c^2 + r^2)^(3/2)), the transform of exp(-2 pi c |f|)."""
    edges = np.stack([x - side / 2, x + side / 2])
    u, v = edges[:, None, None, :], edges[None, :, :, None]
    corner = np.arctan(u * v / (c * np.sqrt(c * c + u * u + v * v))) / (2 * math.pi)
    return (corner[1, 1] - corner[1, 0] - corner[0, 1] + corner[0, 0]) / side**2


def _diffraction(
    optics: Optics,
    model: str,
    pitch: float,
    side: float,
    wavelength: Floats,
    weight: Floats,
    blur: float,
    finest: float,
    extent: float,
) -> Psf:
    slope = steepest_slope(optics, model)
    # A ray of slope s meets the detector 2 N s from the axis.
    extent += 2 * optics.working_f_number * slope
    oversampling = _oversampling(finest / pitch)
    # The irradiance has no frequency above 1 / (wavelength N): a third finer than Nyquist.
    fine = math.ceil(pitch / oversampling / (wavelength.min() * optics.working_f_number / 2.6))
    on_grid = partial(irradiance, optics, model, wavelength, weight, slope=slope)
    return _sampled(on_grid, pitch, side, blur, extent, oversampling, fine)


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
    slope               metre per radius, steepest of the wavefront; None: computed here
    Returns             (count, count) 1 / metre^2; over the whole plane its integral is one
    Raises              ValueError for more than 3072 points, or if the wavefront needs more than
                        1024 samples.
    Accuracy            numerical: 1e-5 of the peak.
    """
    if count > MOST_POINTS:
        raise Refused(
            f"the diffraction pattern must fit {MOST_POINTS} points a side, got {count}: the "
            "defocus, the aberrations or the blur are too many wavelengths * f-number; use `blur` "
            "instead"
        )
    slope = steepest_slope(optics, model) if slope is None else slope
    shortest = float(wavelength.min())
    half_width = count // 2 * spacing / (shortest * optics.working_f_number)
    samples = diffraction.pupil_samples(half_width, slope / shortest)
    if samples > MOST_SAMPLES:
        raise Refused(
            f"the pupil must need at most {MOST_SAMPLES} samples, got {samples} for a field of "
            f"{2 * half_width:.0f} wavelength * f-number and a wavefront as steep as "
            f"{slope / shortest:.0f} waves per radius: use `blur` instead or, if the pupil is "
            "clear, the model airy"
        )
    wave = wavefront(optics, model, samples)
    cell = wave.coordinate[1] - wave.coordinate[0]
    grid = (np.arange(count) - count // 2) * spacing
    total = np.zeros((count, count))
    for fraction, metre in zip(weight, wavelength, strict=True):
        disk = metre * wave.f_number
        # By Parseval the integral over the whole plane is one.
        unit = fraction * cell**2 / (4 * wave.energy * disk**2)
        total += unit * diffraction.intensity(
            wave.weight, 2 * math.pi / metre * wave.path, wave.coordinate, grid / disk
        )
    return total


def _as_psf(table: Floats, oversampling: int) -> Psf:
    """A table and its energy: the mean over sub-pixel positions of the sum over pixels."""
    edge = np.ones(len(table))
    # Gregory's end weights, of fourth order: the table is not zero at its edge.
    edge[:3] = edge[:-4:-1] = (3 / 8, 7 / 6, 23 / 24)
    energy = min(float(edge @ table @ edge) / oversampling**2, 1.0)
    return Psf(np.ascontiguousarray(table), oversampling, energy)


def _oversampling(finest: float) -> int:
    """Samples per pixel for which six-point interpolation has an error of 1e-6 of the peak."""
    return int(np.clip(math.ceil(PER_SIGMA / max(finest, 1e-3)), COARSEST, FINEST))


def _half_samples(width: float, oversampling: int) -> int:
    """Samples from the centre to the edge of a table of `width` pixels on each side.

    Half a pixel and the reach of the interpolation are added.
    """
    # Whole pixels, so that a star has the same number of pixels on both sides.
    return math.ceil((math.ceil(max(width, 1.0)) + 0.5) * oversampling) + 3


def at_field(optics: Optics, x: float, y: float) -> Optics:
    """The optics for a star at a field angle.

    A term that grows is given for a star along +x: rms (angle / field_edge)^growth. At the azimuth
    phi it is rotated, by the symmetry of a lens of revolution:

        (cos, sin) -> (c cos(m phi) - s sin(m phi), c sin(m phi) + s cos(m phi))

    x, y     radian, field angles along the columns and the rows
    Returns  optics with constant aberrations alone
    """
    height, azimuth = math.hypot(x, y) / optics.field_edge, math.atan2(y, x)
    terms: dict[int, float] = defaultdict(float)
    for aberration in optics.aberrations:
        rms = aberration.rms * height**aberration.growth if aberration.growth else aberration.rms
        n, m = noll_to_nm(aberration.noll)
        turn = abs(m) * azimuth if aberration.growth else 0.0
        if m < 0:
            turn += math.pi / 2  # a sine is a cosine shifted by a quarter of its period
        if m == 0:
            terms[aberration.noll] += rms
        else:
            terms[nm_to_noll(n, abs(m))] += rms * math.cos(turn)
            terms[nm_to_noll(n, -abs(m))] += rms * math.sin(turn)
    # The cosine of a quarter turn is rounding, not an aberration.
    least = 1e-12 * max((abs(rms) for rms in terms.values()), default=0.0)
    kept = tuple(Aberration(noll, rms) for noll, rms in sorted(terms.items()) if abs(rms) > least)
    return replace(optics, aberrations=kept)


def over_field(
    optics: Optics,
    angles: Sequence[tuple[float, float]],
    pitch: float,
    wavelength: Floats,
    weight: Floats,
    fill_factor: float = 1.0,
    diffusion: float = 0.0,
) -> tuple[Psf, ...]:
    """One Psf for each field angle; the other arguments are those of `pixel_psf`.

    angles  radian, field angles (x, y)
    """
    return tuple(
        pixel_psf(at_field(optics, x, y), pitch, wavelength, weight, fill_factor, diffusion)
        for x, y in angles
    )
