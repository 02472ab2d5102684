"""Diffraction of any pupil by fast transforms; closed forms of an ideal lens, a blur, a pixel."""

import math

import numpy as np
from scipy import fft, special

from startrack.core import Floats, kernel


def pupil_samples(half_width: float, slope: float = 0.0) -> int:
    """Number of samples across a pupil that its transform needs.

    half_width  1, half the width of the field over wavelength * f-number: cycles across the pupil
    slope       wave per radius, steepest slope of the wavefront
    Returns     1, even
    Accuracy    numerical: 3e-6 of the peak without aberrations, 1e-4 with a wavefront of this
                slope; it falls with the fifth power of the number of samples. The three constants
                were chosen by hand for these errors; tests/optics checks them.
    """
    return 2 * math.ceil(max(2.4 * half_width, 6 * slope) + 14)


def intensity(pupil: Floats, phase: Floats, coordinate: Floats, field: Floats) -> Floats:
    """The irradiance of a pupil, in its natural unit.

        |sum_ij pupil_ij exp(i phase_ij) exp(-i pi (x_i u + y_j v))|^2

    pupil       (n, n) 1, weights of the open area times amplitude, n even, rows along y
    phase       (n, n) radian
    coordinate  (n,) 1, of the samples in radii of the aperture; symmetric about zero
    field       (m,) 1, of the points over wavelength * f-number; symmetric about zero, m odd
    Returns     (m, m), rows along y
    Accuracy    numerical: 1e-13 of the peak, without the error of sampling; see `pupil_samples`.
    """
    cosine, sine = _waves(coordinate, field)
    parts = _fold(pupil, phase)
    half, width = len(coordinate) // 2, len(field) // 2 + 1
    # After the rows: [x even or odd][re, im] over (v, x). Then the columns.
    shape = (2, 2, width, width)
    even = (cosine @ parts[0]).reshape(width, 2, 2, half).transpose(1, 2, 0, 3)
    odd = (sine @ parts[1]).reshape(width, 2, 2, half).transpose(1, 2, 0, 3)
    by_cosine = np.stack([even[0], odd[0]]).reshape(-1, half) @ cosine.T
    by_sine = np.stack([even[1], odd[1]]).reshape(-1, half) @ sine.T
    return _unfold(by_cosine.reshape(shape), by_sine.reshape(shape))


def _waves(coordinate: Floats, field: Floats) -> tuple[Floats, Floats]:
    """Cosines and sines between the positive halves of both grids: (m // 2 + 1, n // 2)."""
    angle = np.pi * np.outer(field[len(field) // 2 :], coordinate[len(coordinate) // 2 :])
    return np.cos(angle), np.sin(angle)


@kernel(fastmath=True)
def _fold(pupil: Floats, phase: Floats) -> Floats:
    """Even and odd parts of the complex pupil, on the quarter x > 0, y > 0.

    parts[y odd] holds, side by side, [x even: re, im | x odd: re, im].
    """
    n = pupil.shape[0]
    half = n // 2
    parts = np.zeros((2, half, 4 * half))
    for j in range(half):
        for i in range(half):
            for above in range(2):
                row = half + j if above == 0 else half - 1 - j
                for side in range(2):
                    column = half + i if side == 0 else half - 1 - i
                    size = pupil[row, column]
                    if size == 0.0:
                        continue
                    re = size * np.cos(phase[row, column])
                    im = size * np.sin(phase[row, column])
                    across = 1.0 if side == 0 else -1.0
                    down = 1.0 if above == 0 else -1.0
                    parts[0, j, i] += re
                    parts[0, j, half + i] += im
                    parts[0, j, 2 * half + i] += across * re
                    parts[0, j, 3 * half + i] += across * im
                    parts[1, j, i] += down * re
                    parts[1, j, half + i] += down * im
                    parts[1, j, 2 * half + i] += down * across * re
                    parts[1, j, 3 * half + i] += down * across * im
    return parts


@kernel(fastmath=True)
def _unfold(by_cosine: Floats, by_sine: Floats) -> Floats:
    """|U|^2 on the whole field from its four parts on a quarter.

    by_cosine[0], by_sine[0]  even rows: cos cos and (odd columns) cos sin
    by_cosine[1], by_sine[1]  odd rows: sin cos and sin sin; first axis after that re, im
    """
    width = by_cosine.shape[2]
    m = 2 * width - 1
    result = np.empty((m, m))
    for j in range(width):
        for i in range(width):
            # exp(-i(a + b)) = cos cos - sin sin - i (sin cos + cos sin)
            cc_re, cc_im = by_cosine[0, 0, j, i], by_cosine[0, 1, j, i]
            ss_re, ss_im = by_sine[1, 0, j, i], by_sine[1, 1, j, i]
            sc_re, sc_im = by_cosine[1, 0, j, i], by_cosine[1, 1, j, i]
            cs_re, cs_im = by_sine[0, 0, j, i], by_sine[0, 1, j, i]
            for above in range(2):
                down = 1.0 if above == 0 else -1.0
                row = width - 1 + j if above == 0 else width - 1 - j
                for side in range(2):
                    across = 1.0 if side == 0 else -1.0
                    column = width - 1 + i if side == 0 else width - 1 - i
                    re = cc_re - down * across * ss_re + down * sc_im + across * cs_im
                    im = cc_im - down * across * ss_im - down * sc_re - across * cs_re
                    result[row, column] = re * re + im * im
    return result


def airy(radius: Floats, wavelength: float, f_number: float) -> Floats:
    """Irradiance at the focus of a clear circular pupil, relative to its peak.

        E(r) / E(0) = [2 J1(v) / v]^2,  v = pi r / (wavelength f_number)

    Source: Krutz et al. (2011), eq. (8), where f_number is the image distance over 2 R.

    radius    (...) metre from the centre
    Returns   (...) 1, in [0, 1]
    Accuracy  model: scalar, paraxial.  numerical: 1e-15 of the peak.
    """
    return np.square(jinc(np.pi * np.asarray(radius, float) / (wavelength * f_number)))


def jinc(v: Floats) -> Floats:
    """2 J1(v) / v, one at v = 0.

    Accuracy  numerical: 1e-15. Below v = 1e-8 the quotient is one to the last digit.
    """
    tiny = np.abs(v) < 1e-8
    safe = np.where(tiny, 1.0, v)
    return np.where(tiny, 1.0, 2 * special.j1(safe) / safe)


def pupil_transfer(frequency: Floats, wavelength: float, f_number: float) -> Floats:
    """Transfer function of a clear circular pupil without aberrations.

        2 / pi * (acos s - s sqrt(1 - s^2)),  s = frequency * wavelength * f_number

    Source: Goodman, Introduction to Fourier Optics, 3rd ed., eq. (6-32).

    frequency  (...) cycle / metre on the detector
    Returns    (...) 1; zero from s = 1 on
    """
    s = np.minimum(np.abs(frequency) * (wavelength * f_number), 1.0)
    return 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s * s))


def blur_transfer(frequency: Floats, sigma: float) -> Floats:
    """Transfer function of a Gaussian: exp(-2 (pi sigma frequency)^2); sigma in metre."""
    return np.exp(-2 * (np.pi * sigma * frequency) ** 2)


def pixel_transfer(frequency: Floats, pitch: float) -> Floats:
    """Transfer function of a pixel along one axis: sin(pi pitch f) / (pi pitch f)."""
    return np.sinc(frequency * pitch)


def pixel_average(plane: Floats, spacing: float, side: float, blur: float, room: int) -> Floats:
    """The mean of a sampled irradiance over a square around each sample, after a Gaussian blur.

    plane    (m, m) irradiance, without frequencies above its Nyquist frequency
    spacing  spacing of the samples, in the unit of side and blur
    room     number of samples added at the border, at least side / 2 + 6 blur
    Returns  (m, m) mean; too small within `room` plus 24 samples of an edge
    Accuracy  numerical: 1e-6 of the peak.
    """
    size = fft.next_fast_len(len(plane) + room, real=True)
    fx, fy = fft.rfftfreq(size, spacing), fft.fftfreq(size, spacing)
    along, down = (pixel_transfer(f, side) * blur_transfer(f, blur) for f in (fx, fy))
    spectrum = fft.rfft2(plane, s=(size, size)) * along * down[:, None]
    return np.asarray(fft.irfft2(spectrum, s=(size, size))[: len(plane), : len(plane)])
