"""Image of expected numbers, and its stars -> their expected detection and measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from startrack.core import Flags, Floats, Frame, Ints, Singles, kernel
from startrack.detection import matched
from startrack.detection.connect import Peaks
from startrack.detection.examine import chance_to_pass, largest_fraction
from startrack.detection.gravity import FLUX, FLUX_SIGMA, XX, XY, YY, X, Y
from startrack.detection.matched import filtered, highest_between
from startrack.detection.measure import measured, sample
from startrack.detection.parameters import Detection
from startrack.detection.pixels import PixelGain, Pixels, gain_of
from startrack.detection.plan import DetectionPlan, calibrated

NEAR = 2  # pixel, from the place of a star to its highest pixel


class SpotExpectation(NamedTuple):
    """Expected brightness, place and noise of stars; NaN for stars without a centroid.

    x, y        (n,) pixel, centroid without noise
    flux        (n,) digital number
    sigma       (n,) digital number, of the flux, as the centroid method states it
    covariance  (n, 2, 2) pixel^2, as the centroid method states it
    above       (n,) sigma, excess over the threshold; negative if the star does not pass it
    spread      (n,) standard deviation of the value that is compared with the threshold; same unit
    kept        (n,) 1, probability that it is not taken for a hot pixel because of noise
    """

    x: Floats
    y: Floats
    flux: Floats
    sigma: Floats
    covariance: Floats
    above: Floats
    spread: Floats
    kept: Floats


def expect(
    frame: Frame,
    place: Floats,
    level: float,
    area: int,
    plan: DetectionPlan,
    search: tuple[float, float] | None = None,
) -> SpotExpectation:
    """Search and measure a frame without noise.

    A star is found with the probability kept Phi(above / spread).

    frame  whose image holds expected numbers, not rounded, and whose gain and noise are known
    place  (n, 2) pixel, places of the stars, which must not affect each other
    level  digital number without stars
    area   pixel, of the searched frames; the threshold may depend on it
    search  noise of the filtered frame (digital number), and the number of sigma by which a star
            must exceed the level, as the tiles of a frame show them; None: by the gain
    Accuracy  model: the search takes the maximum of the noise around a star, as a fit of its place
              would: its squared height has two more degrees of freedom (Wilks). The number of found
              stars is right within 2 %.
    """
    settings, kernel, gain = plan.settings, plan.kernel, gain_of(frame, 0.0)
    image = np.ascontiguousarray(frame.image, np.float32)
    calibrated_image = Pixels(image, 0.0, 1.0, None, gain)
    column, row = _peaks(filtered(image, kernel), np.rint(place).astype(np.int64))
    rms, skewness, kurtosis = matched.noise_from_gain(
        np.array([level], np.float32), gain, 1.0, kernel
    )
    far = matched.equivalent_sigmas(plan.threshold(area), skewness, kurtosis)
    if search is not None:
        rms, far = (np.array([number], np.float32) for number in search)
    height = _heights(image, column, row, level, plan.filters) / rms
    # The star's own photons add to the noise of its filtered image.
    light = _light(image, column, row, level, kernel.whole)
    spread = np.sqrt(1 + light / gain.light / rms**2)
    # The search takes the maximum over places around the peak, which adds two degrees of freedom.
    height = np.where(height > 0, np.sqrt(height**2 + 2 * spread**2), height)
    dark = float(rms[0]) / kernel.noise
    kept = _kept(image, column, row, level, dark, gain, settings)
    seen = sample(frame, calibrated_image, Peaks(column, row, np.ones_like(row)), settings)
    # The ring around a star shows no noise here. So the noise of a dark pixel is given as the least
    # noise, which then also holds for the ring.
    table = measured(seen._replace(floor=dark, offset=level, read_noise=0.0), plan)
    covariance = table[:, [XX, XY, XY, YY]].reshape(-1, 2, 2)
    x, y, flux, sigma = (table[:, column] for column in (X, Y, FLUX, FLUX_SIGMA))
    return SpotExpectation(
        x=x,
        y=y,
        flux=flux,
        sigma=sigma,
        covariance=covariance,
        above=height - far,
        spread=spread,
        kept=kept,
    )


def chance_kept(frame: Frame, place: Floats, level: float, plan: DetectionPlan) -> Floats:
    """Only `kept` of `expect`: probability (n,) that a star is not taken for a hot pixel."""
    gain = gain_of(frame, 0.0)
    image = np.ascontiguousarray(frame.image, np.float32)
    column, row = _peaks(filtered(image, plan.kernel), np.rint(place).astype(np.int64))
    rms, _, _ = matched.noise_from_gain(np.array([level], np.float32), gain, 1.0, plan.kernel)
    dark = float(rms[0]) / plan.kernel.noise
    return _kept(image, column, row, level, dark, gain, plan.settings)


def _kept(
    image: Singles,
    x: Ints,
    y: Ints,
    level: float,
    dark: float,
    gain: PixelGain,
    settings: Detection,
) -> Floats:
    """`SpotExpectation.kept` of peaks; `dark` is the noise of an empty pixel, digital number."""
    if not settings.sharpest_sigma > 0:
        return np.ones(len(x))
    shot, fraction = 1 / gain.light, largest_fraction(settings.sharpest_sigma)
    return chance_to_pass(image, x, y, level, dark, shot, fraction)


@kernel
def _peaks(image, near):  # type: ignore[no-untyped-def]
    """The highest pixels (n,), x and y, of the filtered image within NEAR of given places."""
    x, y = np.empty((2, len(near)), np.int64)
    for n in range(len(near)):
        x[n], y[n] = near[n]
        for v in range(near[n, 1] - NEAR, near[n, 1] + NEAR + 1):
            for u in range(near[n, 0] - NEAR, near[n, 0] + NEAR + 1):
                if image[v, u] > image[y[n], x[n]]:
                    x[n], y[n] = u, v
    return x, y


@kernel
def _heights(image, x, y, level, filters):  # type: ignore[no-untyped-def]
    height = np.empty(len(x))
    for n in range(len(x)):
        height[n] = highest_between(image, x[n], y[n], level, filters)
    return height


@kernel
def _light(image, x, y, level, weight):  # type: ignore[no-untyped-def]
    """Digital numbers of light, weighted by the square of the filter."""
    down, across = weight.shape[0] // 2, weight.shape[1] // 2
    light = np.zeros(len(x))
    for n in range(len(x)):
        for j in range(weight.shape[0]):
            for i in range(weight.shape[1]):
                light[n] += weight[j, i] ** 2 * (image[y[n] + j - down, x[n] + i - across] - level)
    return np.maximum(light, 0.0)


class Response(NamedTuple):
    """A centroid to first order: place + sum over pixels of slope times the pixel's change.

    place       (n, 2) pixel x, y on the unchanged frame; NaN without a centroid
    covariance  (n, 2, 2) pixel^2, as the detection states it
    snr         (n,) 1
    corner      (n, 2) pixel x, y, the first of the pixels that count
    slope       (n, 2, side, side) pixel per digital number, [axis, row, column]
    """

    place: Floats
    covariance: Floats
    snr: Floats
    corner: Ints
    slope: Floats

    def of(self, which: Ints | Flags) -> Response:
        """The response of some of the stars."""
        return Response._make(array[which] for array in self)


def joined(parts: Sequence[Response]) -> Response:
    """The responses of several parts, one after the other."""
    return Response._make(np.concatenate(arrays) for arrays in zip(*parts, strict=True))


def response(frame: Frame, x: Ints, y: Ints, sigma: Floats, plan: DetectionPlan) -> Response:
    """Derivatives of centroids by their pixels, whatever the method of the settings.

    Each pixel is changed up and down by its noise, for all stars together. Stars must be farther
    apart than twice the side, or they respond to each other's pixels.

    frame    expected numbers, not rounded
    x, y     (n,) pixel, peaks, at least the side from the border
    sigma    (rows, columns) digital number, of the pixels' noise
    Accuracy  numerical: a secant over two sigma, exact where the centroid is quadratic there. The
              effect of ring pixels on the background is left out.
    """
    nothing: Ints = np.ones(len(x), np.int64)
    # Frames hold whole numbers, although their expectation is not whole.
    stars = sample(frame, calibrated(frame, plan), Peaks(x, y, nothing), plan.settings)
    stars = stars._replace(floor=1 / math.sqrt(12))
    middle = measured(stars, plan)
    half = half_of(plan)
    slope = np.zeros((len(x), 2, 2 * half + 1, 2 * half + 1))
    image = stars.image
    for j in range(-half, half + 1):
        for i in range(-half, half + 1):
            pixel = y + j, x + i
            before, step = image[pixel], sigma[pixel].astype(np.float32)
            image[pixel] = before + step
            above = measured(stars, plan, stated=False)[:, [X, Y]]
            image[pixel] = before - step
            below = measured(stars, plan, stated=False)[:, [X, Y]]
            image[pixel] = before
            slope[:, :, half + j, half + i] = (above - below) / (2 * step)[:, None]
    covariance = middle[:, [XX, XY, XY, YY]].reshape(-1, 2, 2)
    corner = np.column_stack([x, y]) - half
    snr = middle[:, FLUX] / middle[:, FLUX_SIGMA]
    return Response(middle[:, [X, Y]], covariance, snr, corner, slope)


def half_of(plan: DetectionPlan) -> int:
    """Half the side of the square of pixels that move a centroid."""
    settings = plan.settings
    return plan.method.moved_by(settings.window // 2, settings.kernel_sigma, plan.star)
