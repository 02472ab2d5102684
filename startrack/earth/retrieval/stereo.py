"""Stereo: heights of terrain from two images along the track; their error by formula and by trials.

A camera with lines that look ahead, down and back sees each point of the ground at several angles.
A height h moves a point by h (tan b - tan a) along the track between the images at the angles a and
b. Matching measures that parallax.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from startrack.core import (
    NON_NEGATIVE,
    Flags,
    Floats,
    Parameters,
    Range,
    Refused,
    Singles,
    Streams,
    Unit,
    parameter,
    printed,
)
from startrack.earth.imager import Channel, Survey
from startrack.earth.retrieval import patch, texture
from startrack.earth.retrieval.fire_forecast import Side, side_of
from startrack.earth.retrieval.hot_spots import refuse_other_grounds

STEEPEST = 0.1  # largest slope times difference of tangents; above, ground is hidden or torn
TURNS_OF_LIGHT = 12  # iterations of the intersection of a line of sight and the terrain
UPDATES = 4  # updates of a match by least squares
LEAST = 0.5  # least correlation of both windows for an accepted match
FAR = 1.5  # pixel, largest change from the first to the last parallax of an accepted match
SHIFTED = 0.877  # variance of noise after a cubic spline, the mean over shifts
SLOPED = 0.470  # half the variance of its differences over two pixels, likewise
CLEAR = 0.7  # least expected correlation for a forecast
LOOSE = 0.28  # largest relative variance of a window's squared gradients for a forecast
WIDEST = 31  # pixel, largest side of a window
NODES, TURNS = 120, 12  # frequencies and directions


class Stereo(Parameters):
    """Heights from the parallax between two channels that look along the track.

    Terrain is a fractal above level ground straight below, with the scene's texture.
    """

    channels: tuple[str, str] = parameter(
        "names of two channels whose views differ along the track", default=("nadir", "backward")
    )
    window: int = parameter("pixel, a side of the matched windows", default=9)
    relief: float = parameter(
        "rms height of the terrain over 1024 cells",
        unit=Unit("m"),
        limit=NON_NEGATIVE,
        default=10.0,
    )
    cell: float = parameter("of the terrain", unit=Unit("m"), limit=Range(0.01, 1e5), default=1.0)
    roughness: float = parameter(
        "spectral exponent of the heights' amplitudes, lower for rougher terrain",
        limit=Range(1.05, 4),
        default=2.0,
    )
    height: float = parameter(
        "height of the ground above the ellipsoid",
        unit=Unit("m"),
        limit=Range(0, 9000),
        default=0.0,
    )
    sun_zenith: float = parameter(
        "of the Sun", unit=Unit("rad", "deg"), limit=Range(0, math.radians(85)), default=0.7
    )
    size: int = parameter(
        "pixel, a side of an image of a trial", limit=Range(48, 1024), default=128
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window not in range(3, min(self.size // 3, WIDEST) + 1, 2):
            raise Refused(
                f"window must be an odd number of pixels from 3 to {WIDEST}, and a third of size "
                f"or less, got {self.window}"
            )


def channels_of(survey: Survey, own: Stereo) -> tuple[Channel, Channel]:
    """Both channels.

    Raises  ValueError as `sunlit_channels`, and where both views are equal.
    """
    first, second = patch.sunlit_channels(survey, own.channels, "retrieval.stereo.channels")
    if abs(_base(first, second)) < 0.01:
        raise Refused(
            f"the base of channels {first.name} and {second.name} along the track must be 0.01 "
            "or more of the height"
        )
    return first, second


def _base(first: Channel, second: Channel) -> float:
    """Base over height: parallax in metre for a height of one metre."""
    return math.tan(second.forwards) - math.tan(first.forwards)


@lru_cache(maxsize=8)
def _views(survey: Survey, own: Stereo) -> tuple[patch.View, patch.View]:
    first, second = (
        patch.view_below(survey, channel, own.size, own.height, own.sun_zenith)
        for channel in channels_of(survey, own)
    )
    refuse_other_grounds(first, second)
    return first, second


class StereoImages(NamedTuple):
    """Two images of a terrain, and its true heights.

    first, second  (size, size) measured radiance
    height         (size, size) metre, of the ground that each pixel of the first sees
    highest        metre, largest deviation of the terrain from its mean
    """

    first: Floats
    second: Floats
    height: Floats
    highest: float


def observe_terrain(survey: Survey, own: Stereo, seed: int, number: int) -> StereoImages:
    """Images of a random terrain, from a seed and the image's number.

    Raises  ValueError as `channels_of` and `view_below`.
    """
    views, streams = _views(survey, own), Streams(seed, number)
    rays, count = survey.rays, own.size * survey.rays
    step = views[0].along / rays, views[0].across / rays
    height = own.relief * texture.draw(
        streams("terrain"), count, count, step, own.cell, own.roughness
    ).astype(np.float64)
    height -= height.mean()
    grey = texture.draw(streams("reflectance"), count, count, step, survey.land.texture_cell)
    images, truth = [], height
    for place, view in enumerate(views):
        source = _sighted(height, math.tan(view.channel.forwards) / step[0])
        seen = _along(grey, source, 3).astype(np.float32)
        light = patch.ground_radiance(view, survey.land, seen, None, own.size, rays).astype(float)
        images.append(patch.numbers_of(view, light, Streams(seed, 2 * number + place)))
        if not place:
            truth = _along(height, source, 1)
    middles = truth.reshape(own.size, rays, own.size, rays).mean((1, 3))
    return StereoImages(images[0], images[1], middles, float(np.abs(height).max()))


def _sighted(height: Floats, slant: float) -> Floats:
    """Row (n, n) of the terrain in each pixel of an image, counted in pixels of level ground.

    slant  rows by which a metre of height displaces a point
    """
    rows = np.arange(len(height), dtype=np.float64)[:, None] + np.zeros_like(height)
    source = rows
    for _ in range(TURNS_OF_LIGHT if slant else 0):
        source = rows - slant * _along(height, source, 1)
    return source


def _along(values: Floats | Singles, rows: Floats, order: int) -> Floats:
    """Values of a periodic image at fractional rows."""
    columns = np.arange(values.shape[1], dtype=np.float64) + np.zeros_like(rows)
    return np.asarray(
        ndimage.map_coordinates(values, [rows, columns], order=order, mode="grid-wrap"), np.float64
    )


class Heights(NamedTuple):
    """Heights (size, size) in metre, and whether each pixel was matched; the border is not."""

    height: Floats
    matched: Flags
    inside: Flags


def match_heights(survey: Survey, own: Stereo, images: StereoImages) -> Heights:
    """Heights from two images: the best correlation of windows, then least squares.

        p = sum g (e + g p) / sum g^2

    The sums are over a window. g is the gradient along the track; e is the first image minus the
    second image shifted by the parallaxes p.

    Source: Foerstner (1982), On the geometric precision of digital correlation.
    """
    first, second = _views(survey, own)
    metre = _base(first.channel, second.channel) / first.along
    left, right = (image / image.mean() - 1 for image in (images.first, images.second))
    most = math.ceil(abs(metre) * images.highest) + 1
    parallax = _correlated(left, right, most, own.window)
    start = parallax
    for _ in range(UPDATES):
        moved = _along(right, np.arange(own.size)[:, None] + parallax, 3)
        slope = np.gradient(moved, axis=0)
        off = left - moved
        off = off - _mean(off, own.window)
        square = _mean(slope**2, own.window)
        parallax = _mean(slope * off + slope**2 * parallax, own.window) / np.maximum(square, 1e-30)
        parallax = np.clip(parallax, -most - 1, most + 1)
    moved = _along(right, np.arange(own.size)[:, None] + parallax, 3)
    similar = _correlation(left, moved, own.window)
    matched = (similar > LEAST) & (np.abs(parallax - start) < FAR)
    border = most + own.window
    inside = np.zeros_like(matched)
    inside[border:-border, own.window : -own.window] = True
    return Heights(parallax / metre, matched & inside, inside)


def _mean(values: Floats, window: int) -> Floats:
    return np.asarray(cv2.blur(values, (window, window), borderType=cv2.BORDER_REFLECT), np.float64)


def _correlation(left: Floats, right: Floats, window: int) -> Floats:
    """Correlation coefficient (n, n) of both windows around each pixel."""
    means = _mean(left, window), _mean(right, window)
    common = _mean(left * right, window) - means[0] * means[1]
    squares = (
        np.maximum(_mean(image**2, window) - mean**2, 1e-30)
        for image, mean in zip((left, right), means, strict=True)
    )
    return np.asarray(common / np.sqrt(next(squares) * next(squares)))


def _correlated(left: Floats, right: Floats, most: int, window: int) -> Floats:
    """Parallax (n, n) of the highest correlation: whole pixels from -`most` to `most`."""
    best, found = np.full(left.shape, -2.0), np.zeros(left.shape)
    for shift in range(-most, most + 1):
        similar = _correlation(left, np.roll(right, -shift, 0), window)
        better = similar > best
        best[better], found[better] = similar[better], shift
    return found


@printed
class StereoForecast(NamedTuple):
    """Errors that the formulas predict.

    height_error  metre, rms
    parallax_error  pixel, rms, from noise alone
    smoothing     metre, rms of the terrain that windows average out
    base          1, base over height
    """

    height_error: float
    parallax_error: float
    smoothing: float
    base: float


def forecast_heights(survey: Survey, own: Stereo) -> StereoForecast:
    """Errors of heights.

        s_h^2 = (s_p m / (B / H))^2 + Int S_h (1 - W)^2 + sum_ij v_ij u_ij
        s_p^2 = 2 n^2 / (1 - sum_ij v_ij) / (N g^2),   v_ij = 2 c_ij^2 / N^2

    n is the noise and g the rms gradient of an image, blurred by lens, pixel and smear; m is the
    side of a pixel along the track. A window has N pixels and the transfer function W. S_h is the
    spectrum of the terrain, c the correlation of gradients between pixels of a window, u the
    covariance of heights about the window's mean.

    Source    Foerstner (1982) for s_p; the terms of terrain follow from the weights g^2.
    Raises    ValueError as `channels_of` and `side_of`; where the texture is too weak for the
              noise, or the terrain too steep for both views.
    Accuracy  model: matches are correct, textures Gaussian; slopes do not change an image's scale.
              Within 15 % of trials over the designs of experiments/retrieval_formulas.py, on which
              limits and one factor were chosen. f/8 and a blur of 6 um, 17 % too small, is refused.
    """
    first, second = (side_of(survey, channel, own) for channel in channels_of(survey, own))
    refuse_other_grounds(first, second)
    base = _base(first.channel, second.channel)
    window = own.window
    image = _moments(survey, own, first, second)
    noises = [float(side.variance(np.array(side.mean))) / side.mean**2 for side in (first, second)]
    noises[1] *= SHIFTED
    clear = image.variance / (image.variance + sum(noises) / 2)
    if clear < CLEAR:
        raise Refused(
            f"images must be correlated by {CLEAR} or more for a forecast of heights, got "
            f"{clear:.2f}: increase light or texture, or reduce noise"
        )
    slope = _slope(own, first)
    tangents = (math.tan(side.channel.forwards) for side in (first, second))
    steep = slope * max(abs(base), *(abs(tangent) for tangent in tangents))
    if steep > STEEPEST:
        raise Refused(
            f"rms slope times tan(view) must be {STEEPEST} or less for a forecast of heights, got "
            f"{steep:.2f}: reduce the relief or the angle between the views"
        )
    rough, uneven, long = _weights(own, first, image.gradients)
    stripes = sum(side.stripes / side.mean**2 for side in (first, second)) * long
    blurred = image.gradient / (image.gradient + SLOPED * noises[1] / SHIFTED)
    if rough > LOOSE:
        raise Refused(
            f"retrieval.stereo.window of {window} pixels holds too few details of the ground for a "
            f"forecast: its squared gradients vary by {rough:.2f}, above {LOOSE}"
        )
    square = (sum(noises) + stripes) / (1 - rough) / window**2 / image.gradient
    parallax = math.sqrt(square)
    smoothing = _smoothed(own, first) + uneven * blurred**2 / (1 + rough)
    noise = parallax * first.along / base
    return StereoForecast(
        math.sqrt(noise**2 + smoothing), parallax, math.sqrt(smoothing), abs(base)
    )


class _Moments(NamedTuple):
    """Moments of an image relative to its mean: variance in a window, variance and spectrum of
    gradients."""

    variance: float
    gradient: float
    gradients: "_Spectrum"


class _Spectrum(NamedTuple):
    """Frequencies (n, t) along and across the track, cycle / metre, and the variance of each."""

    along: Floats
    across: Floats
    variance: Floats

    def covariance(self, side: Side, window: int) -> Floats:
        """(w, w) at distances of whole pixels along and across the track."""
        step = 2 * math.pi * np.arange(window)
        waves = np.cos(np.multiply.outer(step * side.along, self.along.ravel()))
        other = np.cos(np.multiply.outer(step * side.across, self.across.ravel()))
        return np.asarray((waves * self.variance.ravel()) @ other.T, np.float64)


def _weights(own: Stereo, side: Side, gradients: _Spectrum) -> tuple[float, float, float]:
    """Moments over a window: variances of squared gradients and of heights; noise factor of
    stripes.

    The first variance is relative. The second is the variance of the heights, weighted by squared
    gradients. The factor is the variance of the result by noise that is equal along a column, over
    its variance by independent noise of the same rms.
    """
    count = own.window
    at = np.arange(count**2)
    down, right = (np.abs(np.subtract.outer(part, part)) for part in (at // count, at % count))
    correlation = gradients.covariance(side, count)
    correlation = correlation / correlation[0, 0]
    square = 2 * correlation[down, right] ** 2 / count**4
    heights = _terrain(own, side).covariance(side, count)[down, right]
    about = heights - heights.mean(0) - heights.mean(1)[:, None] + heights.mean()
    column = correlation[down[: count**2 : count, : count**2 : count], 0].sum() / count
    return float(square.sum()), float((square * about).sum()), float(column)


def _polar(cell: float, finest: float) -> tuple[Floats, Floats, Floats]:
    """Frequencies (n, t) along and across the track, cycle / metre, and the area of each cell."""
    size = np.geomspace(0.5 / texture.TEXELS / cell, finest, NODES + 1)
    middle, width = np.sqrt(size[1:] * size[:-1]), np.diff(size)
    turn = (np.arange(TURNS) + 0.5) * math.pi / 2 / TURNS
    area = np.repeat((2 * math.pi * middle * width)[:, None] / TURNS, TURNS, 1)
    return np.outer(middle, np.sin(turn)), np.outer(middle, np.cos(turn)), area


def _moments(survey: Survey, own: Stereo, first: Side, second: Side) -> _Moments:
    land = survey.land
    along, across, area = _polar(land.texture_cell, math.sqrt(0.5) / land.texture_cell)
    spectrum = texture.power(np.stack([along, across], -1), land.texture_cell) * land.texture**2
    transfer = first.transfer(across * first.side, along * first.side)
    transfer = transfer * second.transfer(across * second.side, along * second.side)
    # The part of the mean ground's radiance that is proportional to reflectance.
    contrast = [side.ground_slopes()[0] / side.mean for side in (first, second)]
    seen = spectrum * transfer * contrast[0] * contrast[1]
    slope = seen * np.sin(2 * math.pi * along * first.along) ** 2 * area
    window = np.sinc(along * first.along * own.window) * np.sinc(across * first.across * own.window)
    inside = float((seen * (1 - window**2) * area).sum())
    # Both images are taken relative to their means over windows, which reduces the gradient.
    # Repeated updates restore half of that reduction in the logarithm: chosen by hand.
    high = _Spectrum(along, across, slope * (1 - window) ** 2)
    square = float(slope.sum() * (slope * (1 - window)).sum())
    return _Moments(inside, square / max(float(high.variance.sum()), 1e-300), high)


def _terrain(own: Stereo, side: Side) -> _Spectrum:
    """Spectrum of the heights' means over pixels."""
    along, across, area = _polar(own.cell, math.sqrt(0.5) / own.cell)
    power = texture.power(np.stack([along, across], -1), own.cell, own.roughness) * own.relief**2
    pixel = np.sinc(along * side.along) * np.sinc(across * side.across)
    return _Spectrum(along, across, power * pixel**2 * area)


def _smoothed(own: Stereo, side: Side) -> float:
    """Variance of the terrain in a pixel about the mean of its window."""
    along, across, variance = _terrain(own, side)
    window = np.ones_like(along)
    for frequency, step in ((along, side.along), (across, side.across)):
        window *= np.sinc(frequency * step * own.window) / np.sinc(frequency * step)
    return float((variance * (1 - window) ** 2).sum())


def _slope(own: Stereo, side: Side) -> float:
    """Rms slope of the terrain along the track, 1."""
    along, _, variance = _terrain(own, side)
    return math.sqrt(float((variance * (2 * math.pi * along) ** 2).sum()))
