"""Frames, spots -> the likelihood of each width of the PSF."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.special import erf

from startrack.core import Floats, Frame, Refused, Spots

# All chosen by hand.
HALF = 4  # pixel, half side of a stamp: light in the wings against neighbours
MIN_SEPARATION = 2 * HALF  # pixel along either axis to the next spot, so that a stamp has one star
MOST_STARS = 40  # of a frame: precision against time
LEAST_SNR = 15.0  # fainter stars add time and little information
WIDTHS = 61  # in each table of the likelihood, first over all, then nearer to its peak
ZOOMS = 3  # tables: WIDTHS and these set the error of the interpolation
STEPS = 3  # of Gauss-Newton on each star's position, which starts at the centroid


def width_likelihood(
    frames: Sequence[Frame], spots: Sequence[Spots], low: float, high: float
) -> Callable[[Floats], Floats]:
    """The logarithm of the likelihood of the PSF's sigma, from the stars' pixels.

        pixel = background + flux g(position, sigma) + noise,   g a Gaussian integrated over pixels
        ln L = sum_stars -1/2 (n - 4) ln(r^T V^-1 r) - 1/2 ln |V| - 1/2 ln |A^T V^-1 A|

    r the residuals of the best background, flux and position at this sigma and A their derivatives:
    all four are marginalised by Laplace with uniform priors, as is the noise level (uniform in its
    logarithm), so that V is needed only up to a factor: photons and read noise where the frame
    has a gain, else equal for all pixels.

    low, high  pixel, the range of the widths
    Returns    a function of ln sigma (w,)
    Raises     ValueError if no star is alone in its stamp, unsaturated, and brighter than 15
               sigma.
    Accuracy   model: one Gaussian for the whole field; for a PSF with wings the width is more than
               that of its core. numerical: interpolated, 1e-3 in ln L near its peak.
    """
    stars = [
        (_stamp(image, *np.rint(position).astype(int)).ravel(), frame, position)
        for frame, own_spots in zip(frames, spots, strict=True)
        for image in [np.asarray(frame.image, float)]
        for position in _alone(image, own_spots)
    ]
    if not stars:
        raise Refused(
            f"frames must hold a star above {LEAST_SNR:g} sigma, alone and not saturated, for "
            "the width of the PSF, got none"
        )
    log, total = np.empty(0), np.empty(0)
    left, right = np.log([low, high])
    for _ in range(ZOOMS):
        more = np.setdiff1d(np.linspace(left, right, WIDTHS), log)
        log = np.concatenate([log, more])
        total = np.concatenate([total, sum(_star(*star, np.exp(more)) for star in stars)])
        order = np.argsort(log)
        log, total = log[order], total[order]
        # The next table lies between the neighbours of the best.
        left, right = log[np.clip(np.argmax(total) + np.array([-2, 2]), 0, len(log) - 1)]
    return PchipInterpolator(log, total)


def _alone(image: Floats, spots: Spots) -> list[Floats]:
    """Positions (2,) of the spots whose complete stamp has one star and no saturated pixel."""
    rows, columns = image.shape
    x, y = np.rint(spots.x).astype(int), np.rint(spots.y).astype(int)
    top = image.max()
    clipped = (image == top).sum() > 1  # one pixel may be the largest by chance
    chosen = []
    for i in np.flatnonzero(spots.snr >= LEAST_SNR):
        if not (HALF <= x[i] < columns - HALF and HALF <= y[i] < rows - HALF):
            continue
        near = (
            np.maximum(np.abs(spots.x - spots.x[i]), np.abs(spots.y - spots.y[i])) <= MIN_SEPARATION
        )
        stamp = _stamp(image, x[i], y[i])
        if near.sum() == 1 and not (clipped and stamp.max() == top):
            chosen.append(np.array([spots.x[i], spots.y[i]]))
        if len(chosen) == MOST_STARS:
            break
    return chosen


def _stamp(image: Floats, x: int, y: int) -> Floats:
    return image[y - HALF : y + HALF + 1, x - HALF : x + HALF + 1]


def _star(value: Floats, frame: Frame, position: Floats, width: Floats) -> Floats:
    """ln L of one star at each width, from the pixels (n,) of its stamp."""
    at = np.tile(position - np.rint(position), (len(width), 1))
    variance = np.ones((len(width), len(value)))
    for _ in range(STEPS):
        terms = _terms(at, width)
        weighted = terms / variance[:, None, :]
        normal = weighted @ terms.swapaxes(1, 2)
        best = np.linalg.solve(normal, (weighted @ value)[..., None])[..., 0]
        model = np.einsum("wk,wkn->wn", best, terms)
        # The last two terms are the derivatives by position; a step is half a pixel at most.
        at = at + np.clip(best[:, 2:] / best[:, 1:2], -0.5, 0.5)
        variance = _variance(frame, model)
    residual = ((value - model) ** 2 / variance).sum(axis=1)
    # The derivative by position is the flux times its term.
    size = np.linalg.slogdet(normal)[1] + 4 * np.log(np.abs(best[:, 1]))
    return -0.5 * ((len(value) - 4) * np.log(residual) + np.log(variance).sum(axis=1) + size)


def _terms(at: Floats, width: Floats) -> Floats:
    """(w, 4, n) of each pixel: one, g, and the derivatives of g by the star's x and y."""
    offset = np.arange(-HALF, HALF + 1)
    scale = 1 / (np.sqrt(2) * width[:, None, None])
    right, left = (scale * (offset - at[..., None] + half) for half in (0.5, -0.5))
    fraction = 0.5 * (erf(right) - erf(left))
    slope = scale / np.sqrt(np.pi) * (np.exp(-(left**2)) - np.exp(-(right**2)))
    along = {
        "g": (fraction[:, 0], fraction[:, 1]),
        "x": (slope[:, 0], fraction[:, 1]),
        "y": (fraction[:, 0], slope[:, 1]),
    }
    terms = [np.einsum("wi,wj->wji", *pair).reshape(len(width), -1) for pair in along.values()]
    return np.stack([np.ones_like(terms[0]), *terms], axis=1)


def _variance(frame: Frame, model: Floats) -> Floats:
    """Variance of each pixel, digital number squared; 1 where the frame has no gain."""
    if not (frame.electrons_per_dn > 0 and frame.read_noise > 0):
        return np.ones_like(model)
    light = np.maximum(model - frame.offset, 0) / frame.noise_gain
    return light + (frame.read_noise / frame.electrons_per_dn) ** 2
