"""Effects on charge and signal: residual charge, crosstalk, blooming, EM gain, settling."""

from __future__ import annotations

import cv2
import numpy as np
import scipy
from scipy import special

from startrack.core import Floats, kernel


def carry(electrons: Floats, before: Floats | None, fraction: float) -> Floats:
    """Expected electrons that are read with a frame, with the residual charge of the one before.

        read = (1 - fraction) electrons + fraction before

    Each electron is left behind independently, so that the numbers remain Poisson numbers.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on deferred charge; here of one
    frame alone.

    electrons  (rows, columns) electron, generated in this frame
    before     (rows, columns) electron, generated in the frame before; None: none
    """
    kept = (1 - fraction) * electrons
    return kept if before is None else kept + fraction * before


def diffuse(electrons: Floats, fraction: float) -> Floats:
    """Expected electrons after crosstalk: a fraction of each pixel's diffuses to each of its sides.

        after = (1 - 4 fraction) electrons + fraction (left + right + above + below)

    Electrons diffuse independently, so that Poisson numbers stay independent Poisson numbers, and
    it is enough to spread their expectations.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on diffusion; here to the nearest
    pixels alone.

    electrons  (rows, columns) electron; none crosses the border of the array
    fraction   1, at most 1/4
    """
    kernel = np.array([[0, fraction, 0], [fraction, 1 - 4 * fraction, fraction], [0, fraction, 0]])
    return np.asarray(cv2.filter2D(electrons, -1, kernel, borderType=cv2.BORDER_REFLECT), float)


def bloom(charge: Floats, full_well: float) -> Floats:
    """Charge after blooming: half of the excess of each pixel flows up its column, half down.

    The flow fills each pixel to its full well, until nothing is left or the array ends.

    Source: Janesick (2001), Scientific Charge-Coupled Devices, on blooming.

    charge   (rows, columns) electron
    Returns  (rows, columns) electron, at most full_well; the sum is conserved except for the flow
             out of the array
    """
    held = np.minimum(charge, full_well)
    for column in np.flatnonzero((charge > full_well).any(axis=0)):
        excess = (charge[:, column] - held[:, column]) / 2
        _run(held[:, column], excess, full_well)
        _run(held[::-1, column], excess[::-1], full_well)
    return held


@kernel
def _run(held, excess, full_well):  # type: ignore[no-untyped-def]
    running = 0.0
    for row in range(len(held)):
        running += excess[row]
        taken = min(running, full_well - held[row])
        held[row] += taken
        running -= taken


def multiply(charge: Floats, gain: float, fraction: Floats) -> Floats:
    """Electrons after the multiplication register: gamma distribution of shape n and scale `gain`.

        p(x | n) = x^(n - 1) exp(-x / gain) / (gain^n (n - 1)!),   n >= 1

    The variance of the shot noise is doubled.

    Source: Basden, Haniff and Mackay (2003), MNRAS 345, 985.

    charge    (...) electron
    gain      1
    fraction  (...) uniform numbers in (0, 1)
    Accuracy  model: a register of many stages with little gain each; no clock-induced charge.
    """
    out = np.zeros_like(charge)
    some = charge > 0
    out[some] = gain * special.gammaincinv(charge[some], fraction[some])
    return out


def settle(level: Floats, rest: float) -> Floats:
    """Signal of pixels read one after the other through a channel of limited bandwidth.

        out_i = (1 - rest) in_i + rest out_(i-1)

    A low-pass filter of first order with time constant tau, sampled at the end of each pixel's time
    T; each row starts settled to its first pixel.

    Source: Oppenheim and Schafer, Discrete-Time Signal Processing, on impulse invariance.

    level  (rows, columns) electron, in the order of reading
    rest   1, exp(-T / tau)
    """
    out, _ = scipy.signal.lfilter([1 - rest], [1, -rest], level, axis=1, zi=rest * level[:, :1])
    return out
