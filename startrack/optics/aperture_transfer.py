"""Transfer function of an aperture of any shape and phase, and the Wiener filter that undoes it."""

import math

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, positive
from startrack.optics.choose import wavefront
from startrack.optics.parameters import Optics

CELLS = 512  # number of cells across the aperture


def aperture_transfer(optics: Optics, wavelength: float, frequency: Floats, along: str) -> Floats:
    """MTF of a lens without its blur: the autocorrelation of its complex pupil.

        H(f) = |Int P(x) P*(x - lambda N f 2) dx| / Int |P|^2 dx,  x in radii of the aperture

    Source: Goodman, Introduction to Fourier Optics, 3rd ed., eq. (6-28).

    wavelength  metre
    frequency   (n,) cycle / metre on the detector
    along       "x" or "y"
    Returns     (n,) 1
    Accuracy    model: Fraunhofer, at one wavelength. numerical: 1e-3; 0.003 at shifts at which
                equal segments coincide; 0.005 below 1 % of the cutoff. Between touching segments,
                steps of the phase have the width of a cell.
    """
    wave = wavefront(optics, "fraunhofer", CELLS)
    field = wave.weight * np.exp(2j * math.pi / wavelength * wave.path)
    spectrum = np.abs(np.fft.fft(field, 2 * CELLS, axis=1 if along == "x" else 0)) ** 2
    power = spectrum.sum(0 if along == "x" else 1)
    cell = wave.coordinate[1] - wave.coordinate[0]
    shift = 2 * wavelength * optics.working_f_number * np.abs(frequency)
    turns = np.exp(2j * math.pi * np.outer(shift / cell, np.fft.fftfreq(2 * CELLS)))
    value = np.abs(turns @ power) / (2 * CELLS * wave.energy)
    value = np.where(shift == 0, 1.0, value)  # soft edges that coincide lose light
    return np.asarray(np.where(shift < 2 + 6 * cell, value, 0.0))


def wiener_filter(
    transfer: NDArray[np.complexfloating], signal_to_noise: float
) -> NDArray[np.complexfloating]:
    """Wiener filter: it divides by the transfer function as far as noise allows.

        W = (1 + 1 / SNR^2) H* / (|H|^2 + 1 / SNR^2)

    Uniform light, with H = 1, keeps its value. The filtered image has the transfer function H W,
    and its white noise is multiplied by the rms of |W| over all frequencies.

    Source: Goodman, Introduction to Fourier Optics, 3rd ed., eq. (8-42).

    transfer         (...) 1, of lens, pixel and motion together
    signal_to_noise  1, rms of the signal over that of the noise, at each frequency
    """
    positive(signal_to_noise=signal_to_noise)
    noise = signal_to_noise**-2
    filtered = np.conj(transfer) * (1 + noise) / (np.abs(transfer) ** 2 + noise)
    return np.asarray(filtered, np.complex128)
