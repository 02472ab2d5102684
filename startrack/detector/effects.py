"""Effects on charge and signal: residual charge, crosstalk, blooming, EM gain, settling."""

from __future__ import annotations

import cv2
import numpy as np
import scipy
from numba import njit
from scipy import special

from startrack.core import Floats


def carry(electrons: Floats, before: Floats | None, fraction: float) -> Floats:
    """Expected electrons that are read with a frame.

        read = (1 - share) electrons + share before

    Each electron stays behind by its own chance, so that the numbers remain Poisson's. Source:
    Janesick (2001), Scientific Charge-Coupled Devices, on deferred charge, cut to one frame.

    electrons  (rows, columns) electron, made in this frame
    before     the same of the frame before, None where the pixels were empty
    """
    kept = (1 - fraction) * electrons
    return kept if before is None else kept + fraction * before


def diffuse(electrons: Floats, fraction: float) -> Floats:
    """Expected electrons after a fraction of each pixel's went to each of its four sides.

        after = (1 - 4 share) electrons + share (left + right + above + below)

    Each electron goes its own way, so that Poisson numbers stay independent Poisson numbers, and
    the expectations alone need to be spread. Source: Janesick (2001), Scientific Charge-Coupled
    Devices, on diffusion; here the kernel is cut to the nearest pixels.

    electrons  (rows, columns) electron; at the borders, none leaves
    fraction   1, at most 1/4
    """
    kernel = np.array([[0, fraction, 0], [fraction, 1 - 4 * fraction, fraction], [0, fraction, 0]])
    return np.asarray(cv2.filter2D(electrons, -1, kernel, borderType=cv2.BORDER_REFLECT))


def bloom(charge: Floats, full_well: float) -> Floats:
    """Charge after each overfull pixel spilt one half of its excess up and one half down.

    What runs on fills each pixel to its full well, until nothing is left or the array ends.
    Source: Janesick (2001), Scientific Charge-Coupled Devices, on blooming.

    charge   (rows, columns) electron
    Returns  (rows, columns) electron, at most full_well; the sum is kept but for what runs out of
             the array
    """
    held = np.minimum(charge, full_well)
    for column in np.flatnonzero((charge > full_well).any(axis=0)):
        excess = (charge[:, column] - held[:, column]) / 2
        _run(held[:, column], excess, full_well)
        _run(held[::-1, column], excess[::-1], full_well)
    return held


@njit(cache=True, error_model="numpy")
def _run(held, excess, full_well):  # type: ignore[no-untyped-def]
    running = 0.0
    for row in range(len(held)):
        running += excess[row]
        taken = min(running, full_well - held[row])
        held[row] += taken
        running -= taken


def multiply(charge: Floats, gain: float, fraction: Floats) -> Floats:
    """Electrons at the end of the register: a gamma distribution of shape n and scale `gain`.

        p(x | n) = x^(n - 1) exp(-x / gain) / (gain^n (n - 1)!),   n >= 1

    Its variance doubles that of the shot noise. Source: Basden, Haniff and Mackay (2003), MNRAS
    345, 985.

    charge   (...) electron
    gain     1
    fraction  (...) uniform numbers in (0, 1)
    Accuracy  model: a register of many stages with little gain each; no clock-induced charge.
    """
    out = np.zeros_like(charge)
    some = charge > 0
    out[some] = gain * special.gammaincinv(charge[some], fraction[some])
    return out


def settle(level: Floats, rest: float) -> Floats:
    """What a channel of limited bandwidth makes of the pixels that pass through it in turn.

        out_i = (1 - rest) in_i + rest out_(i-1)

    A low-pass of first order with time constant tau, sampled at the end of each pixel's time T;
    each row starts settled on its first pixel. Source: Oppenheim and Schafer, Discrete-Time Signal
    Processing, on impulse invariance.

    level  (rows, columns) electron, in the order of reading
    rest   1, exp(-T / tau)
    """
    out, _ = scipy.signal.lfilter([1 - rest], [1, -rest], level, axis=1, zi=rest * level[:, :1])
    return out
