"""Windows of flight -> measured figures: centroids, light, noise, photon transfer, star image."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from startrack import core, detection
from startrack.core import Flags, Floats, Ints, Refused
from startrack.detector import stamp
from startrack.verification.windows_of_flight import BORDER, FEWEST_IMAGES, Windows, without_blocks

PHASES = 10  # positions in a pixel at which the curve of the centroid is measured
CELLS = 4  # cells of a pixel along each side, in which images are averaged
PLACES = [(x, y) for x in (-0.25, 0.25) for y in (-0.25, 0.25)]  # pixel, of images of one PSF
FEWEST = 20  # least number of exposures of a cell
MEMBERS = 60  # most exposures of a cell whose images the model averages
CLEAR = 0.2  # largest deviation of an exposure's light from the median light, relative
ROUNDING = 1 / 12  # variance by rounding of numbers
THIRD = np.array([1.0, -3.0, 3.0, -1.0]) / math.sqrt(20)  # keeps white noise, removes a parabola
# Degrees of freedom of third differences that each fitted term takes: they are correlated in time.
LOST = float((np.correlate(THIRD, THIRD, "full") ** 2).sum())
GROUP = 150  # differences of one pixel at one level that form a group of the photon transfer
CLIP = 5.0  # sigma; larger differences are left out
PULL = 4.0  # sigma; groups with larger deviations are left out: their pixel flickers
SEEN_TOGETHER = 0.5  # least fraction of a star's exposures in which another star shows its motion
LONGEST_GAP = 3.0  # longest gap over which places are interpolated, over the usual time step


class Centroids(NamedTuple):
    """Centroids of the images of one star, for exposures in which it was seen.

    place   (n, 2) pixel (x, y)
    total   (n,) digital number of the image above its background
    """

    windows: Windows
    place: Floats
    total: Floats


def centroids(windows: Windows, box: detection.Box) -> Centroids:
    """Centroids of a star by the tracker's first moments, from images of `box.size` pixels.

    Exposures whose light deviates from the median by more than 20 % are left out: they do not show
    the star.
    """
    light, corner = _light(windows, box)
    total = light.sum(axis=(1, 2))
    step = np.arange(light.shape[1]) - (light.shape[1] - 1) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        moment = np.stack([light.sum(axis=1) @ step, light.sum(axis=2) @ step], 1) / total[:, None]
    seen = _is_clear(total)
    if seen.sum() < FEWEST_IMAGES:
        raise Refused(f"{windows.name} must have a star of steady light in most of its images")
    place = corner + (light.shape[1] - 1) / 2 + moment
    return Centroids(windows.of(seen), place[seen], total[seen])


def is_steady(windows: Windows, box: detection.Box) -> bool:
    """Whether centroids can be measured, from all blocks of time and without any one of them."""
    total = _light(windows, box)[0].sum(axis=(1, 2))
    parts = [total, *(total[left] for (left,) in without_blocks([windows.time]))]
    return all(
        len(part) >= FEWEST_IMAGES and _is_clear(part).sum() >= FEWEST_IMAGES for part in parts
    )


def _is_clear(total: Floats) -> Flags:
    """Whether the light of exposures (n,) is near its median."""
    return np.asarray(np.abs(total / np.median(total) - 1) < CLEAR)


def _light(windows: Windows, box: detection.Box) -> tuple[Floats, Ints]:
    """Light above the background (n, k, k) in the used pixels, and the corners of the images."""
    side = windows.number.shape[1]
    size = min(box.size, side)
    cut = (side - size) // 2
    inner = windows.number[:, cut : cut + size, cut : cut + size]
    level = level_of(windows, box)
    return (inner - level[:, None, None]) * detection.image_mask(size), windows.corner + cut


def level_of(windows: Windows, box: detection.Box) -> Floats:
    """The background (n,) of a pixel that the tracker subtracts."""
    if windows.background is not None:
        return np.asarray(windows.background, float)
    if box.background == "none" or windows.number.shape[1] < 8:
        return np.zeros(len(windows.time))
    cut = windows.number.shape[1] // 2 - 4
    return np.asarray(
        detection.level_of_image(windows.number[:, cut : cut + 8, cut : cut + 8], box, 0)
    )


class MeasuredWindows(NamedTuple):
    """Measured figures of one star.

    scalar  value of each figure by name, for all of `KEYS` except the curve
    curve   (2, PHASES) pixel, mean centroid error along x and y, over the position in the pixel;
            NaN at positions without the star
    """

    scalar: dict[str, float]
    curve: Floats


def measure(
    stars: Sequence[Windows],
    box: detection.Box,
    psfs: Sequence[core.Psf] = (),
    read_noise: float = math.nan,
) -> list[MeasuredWindows]:
    """Measure stars that were seen together.

    psfs        predicted PSF of each star; none: images are not compared
    read_noise  digital number, of the design, for the offset

    temporal    pixel rms per axis, of the place minus the motion that all stars share, by third
                differences in time between exposures whose image did not move
    total       pixel rms per axis, of the same place over the whole time, minus a cubic in time and
                a part proportional to the common motion. Both figures are multiplied by sqrt(k / (k
                - 1)) for k stars, so that two stars have the same figure
    curve       pixel, mean of the same place over the position in the pixel
    moves       number of steps of an image along an axis, in an exposure
    background  digital number
    brightness  digital number per second and exposure
    gain, read_noise  electron per digital number, and digital number: see `gain_in_flight`; NaN if
                      it refuses
    offset      digital number at which the variance equals the design's read noise; zero if the
                offset was already subtracted
    acquired    fraction of the exposures with the star's light in which the search finds it
    image       1, of the peak: worst pixel of the mean images in phase cells minus the design's
                image at the fitted place and flux, NaN without `psfs`

    With only one star, the temporal scatter contains the motion, and there is neither total nor
    curve. A star that is never seen together with others has none of these three figures.
    """
    seen = [centroids(star, box) for star in stars]
    measured = []
    for number, (track, motion) in enumerate(zip(seen, about_common(seen), strict=True)):
        windows = track.windows
        errors, curve = _centroid_errors(track, motion, alone=len(seen) == 1)
        scalar = {
            "background": float(level_of(windows, box).mean()),
            "brightness": float(np.median(track.total)),
            **_photon_transfer(windows, read_noise, motion.others),
            "image": image_difference(track, box, psfs[number]) if psfs else math.nan,
            **errors,
            "moves": float(np.abs(np.diff(windows.corner, axis=0)).sum() / 2 / len(windows.corner)),
            "acquired": math.nan if windows.acquired is None else float(windows.acquired.mean()),
        }
        measured.append(MeasuredWindows(scalar, curve))
    return measured


def _photon_transfer(
    windows: Windows, read_noise: float, motion: Floats | None
) -> dict[str, float]:
    """Gain, read noise and offset from `_transfer_line`; NaN if the image moves too often."""
    try:
        rest, slope = _transfer_line(windows, motion)
    except Refused:
        return dict.fromkeys(("gain", "read_noise", "offset"), math.nan)
    offset = (read_noise**2 + ROUNDING - rest) / slope
    return {"gain": 1 / slope, "read_noise": _read_noise(rest), "offset": offset}


def _centroid_errors(
    track: Centroids, motion: OwnMotion, alone: bool
) -> tuple[dict[str, float], Floats]:
    """Temporal and total scatter of a centroid, and its curve.

    alone  whether no other star was seen, so that the motion of the camera is not known
    """
    off = motion.off * motion.scale
    third = third_differences(off)[motion.calm]
    known = np.isfinite(off[:, 0])
    temporal = math.sqrt(float((third**2).mean())) if len(third) else math.nan
    if alone or not known.any():
        return {"temporal": temporal, "total": math.nan}, np.full((2, PHASES), math.nan)
    total = math.sqrt(float((off[known] ** 2).mean()))
    return {"temporal": temporal, "total": total}, _curve(track.place[known], off[known])


class OwnMotion(NamedTuple):
    """Places of one star minus the motion that it shares with others.

    off    (n, 2) pixel; NaN at exposures without the other stars
    calm   (n - 3,) whether four successive exposures are known and their images did not move
    scale  1, factor from `off` to the error of one star, because the common motion contains a part
           of this error
    others (n, 2) pixel, mean place of the other stars; None if it is unknown
    """

    off: Floats
    calm: Flags
    scale: float
    others: Floats | None = None


def about_common(seen: Sequence[Centroids]) -> list[OwnMotion]:
    """The motion of each star relative to the motion that all stars share.

    The common motion is the mean over the star and all stars that are seen in half of its
    exposures, a part proportional to this mean, and a cubic in time. It is known at exposures for
    which each of these stars has an exposure before and one after. The own motion of a star that is
    never seen together with others is unknown. The own motion of a single star is its whole motion
    about its mean place.
    """
    times = [track.windows.time for track in seen]
    moved = [still(track.windows) for track in seen]
    if len(seen) == 1:
        return [OwnMotion(seen[0].place - seen[0].place.mean(axis=0), moved[0], 1.0)]
    found = []
    for number, track in enumerate(seen):
        time, place, mine = track.windows.time, track.place, moved[number]
        there = [_between(time, other) for other in times]
        members = [k for k, both in enumerate(there) if k == number or both.mean() > SEEN_TOGETHER]
        together = np.all([there[k] for k in members], axis=0)
        off = np.full(place.shape, math.nan)
        if len(members) < 2 or together.sum() < FEWEST_IMAGES:
            found.append(OwnMotion(off, mine, 1.0))
            continue
        others = [
            np.column_stack([np.interp(time, times[k], p) for p in seen[k].place.T])
            for k in members
        ]
        # If the image of another star moved, its step is in the third difference.
        quiet = [np.interp(time[:-3], times[k][:-3], moved[k]) > 0.999 for k in members]
        common = np.mean(others, axis=0)
        common = common - common[together].mean(axis=0)
        span = (time - time.mean()) / np.ptp(time)
        terms = np.column_stack([np.vander(span, 4), common])[together]
        left = (place - common)[together]
        left = left - left.mean(axis=0)
        off[together] = left - terms @ np.linalg.lstsq(terms, left, rcond=None)[0]
        four = together[:-3] & together[1:-2] & together[2:-1] & together[3:]
        scale = math.sqrt(len(members) / (len(members) - 1))
        away = np.mean([p for k, p in zip(members, others, strict=True) if k != number], axis=0)
        found.append(OwnMotion(off, mine & four & np.all(quiet, axis=0), scale, away))
    return found


def _between(time: Floats, other: Floats) -> Flags:
    """Whether a star has exposures at, or shortly before and after, times (n,) of another star."""
    near = LONGEST_GAP * np.median(np.diff(other))
    after = np.searchsorted(other, time)
    last = len(other) - 1
    before = other[np.clip(after - 1, 0, last)], other[np.clip(after, 0, last)]
    exact = before[1] == time
    inside = (after > 0) & (after <= last) & (before[1] - before[0] <= near)
    return np.asarray(exact | inside)


def still(windows: Windows) -> Any:
    """Whether four successive exposures have a still image and no gap, (n - 3,)."""
    step = np.diff(windows.time)
    near = step < 1.5 * np.median(step)
    same = near & (np.diff(windows.corner, axis=0) == 0).all(axis=1)
    return same[:-2] & same[1:-1] & same[2:]


def third_differences(values: Floats) -> Floats:
    """Third differences (n - 3, ...) in time, scaled to keep the variance of white noise."""
    count = len(values) - 3
    return np.asarray(sum(w * values[k : k + count] for k, w in enumerate(THIRD)))


def _curve(place: Floats, off: Floats) -> Floats:
    curve = np.full((2, PHASES), math.nan)
    for axis in (0, 1):
        phase = (np.mod(place[:, axis] + 0.5, 1.0) * PHASES).astype(int)
        for n in np.unique(phase):
            curve[axis, n] = off[phase == n, axis].mean()
    return curve - known_mean(curve, 1)[:, None]


def known_mean(values: Floats, axis: int) -> Floats:
    """Mean of the values that are not NaN; NaN if all are NaN."""
    finite = np.isfinite(values)
    many = finite.sum(axis=axis)
    total = np.where(finite, values, 0.0).sum(axis=axis)
    return np.where(many > 0, total / np.maximum(many, 1), np.nan)


def correlation(seen: Floats, predicted: Floats) -> float:
    """Correlation of two curves (2, PHASES), both axes together."""
    both = np.isfinite(seen) & np.isfinite(predicted)
    if both.sum() < 4:
        return math.nan
    return float(np.corrcoef(seen[both], predicted[both])[0, 1])


def gain_in_flight(windows: Windows) -> tuple[float, float]:
    """Gain (electron / digital number) and read noise (digital number) of pixels in flight.

        variance = read noise^2 + 1/12 + mean / gain

    Variances are those of third differences in time of one pixel, between exposures whose image did
    not move, in groups of equal level; a weighted line is fitted. Groups more than four standard
    deviations above the line are left out: their pixels flicker, or a star moved.

    Raises    Refused if there are fewer than eight groups.
    Accuracy  model: the mean has no offset; nonlinearity is left out.
    """
    rest, slope = _transfer_line(windows)
    return 1 / slope, _read_noise(rest)


def _read_noise(rest: float) -> float:
    """Read noise, digital number, from the variance without light."""
    return math.sqrt(max(rest - ROUNDING, 0.0))


def _transfer_line(windows: Windows, motion: Floats | None = None) -> tuple[float, float]:
    """Variance without light, and its slope over the mean; digital numbers.

    motion  (n, 2) pixel, places of other stars: the part of each pixel that follows them is
            subtracted, because motion between exposures changes bright pixels as noise does
    """
    calm = still(windows)
    number = windows.number.reshape(len(windows.number), -1)
    level = (number[:-3] + number[1:-2] + number[2:-1] + number[3:])[calm] / 4
    third = third_differences(number)[calm]
    if motion is not None and len(third) > FEWEST_IMAGES:
        moved = third_differences(motion)[calm]
        third = third - moved @ np.linalg.lstsq(moved, third, rcond=None)[0]
        third *= math.sqrt(len(third) / (len(third) - LOST * moved.shape[1]))
    groups = []
    for pixel in np.flatnonzero(np.ptp(number, axis=0) > 0):
        order = np.argsort(level[:, pixel])
        for part in np.array_split(order, max(len(order) // GROUP, 1)):
            values = third[part, pixel]
            inside = np.abs(values) <= CLIP * 1.4826 * np.median(np.abs(values)) + 1e-9
            if inside.sum() > 8:
                groups.append((level[part, pixel].mean(), values[inside].var(), inside.sum()))
    if len(groups) < 8:
        raise Refused(f"{windows.name} must have more exposures whose image does not move")
    mean, variance, count = np.array(groups).T
    model, kept = np.maximum(variance, 1.0), np.ones(len(mean), bool)
    terms, line = np.column_stack([np.ones(len(mean)), mean]), np.zeros(2)
    for _ in range(20):
        weight = np.sqrt(count / 2) / model * kept
        line = np.linalg.lstsq(terms * weight[:, None], variance * weight, rcond=None)[0]
        model = np.maximum(terms @ line, 0.1)
        kept = (variance - model) * np.sqrt(count / 2) / model < PULL
    return float(line[0]), float(line[1])


def image_difference(seen: Centroids, box: detection.Box, psf: core.Psf) -> float:
    """Largest difference of a pixel, mean flown image minus the design's, relative to the peak."""
    light, corner = _light(seen.windows, box)
    size = light.shape[1]
    middle = corner + (size - 1) / 2
    moment, worst = seen.place - middle, 0.0
    cell = np.floor((moment + 0.5) * CELLS).astype(int)
    counted = detection.image_mask(size).astype(bool)
    for x in range(CELLS):
        for y in range(CELLS):
            chosen = np.flatnonzero((cell == (x, y)).all(axis=1))
            if len(chosen) < FEWEST:
                continue
            image = light[chosen].mean(axis=0)
            mean = moment[chosen].mean(axis=0)
            some = moment[chosen[:: max(len(chosen) // MEMBERS, 1)]] - mean
            off = _fitted(image, mean, some, psf)[counted]
            worst = max(worst, float(np.abs(off).max() / image.max()))
    return worst


def image_of_other(psf: core.Psf, design: core.Psf, box: detection.Box) -> float:
    """Largest difference of a pixel between the images of a star with two PSFs.

    It is relative to the peak, over places in the pixel. The image by `design` is at the
    best-fitting place and flux.
    """
    if psf is design:
        return 0.0
    worst, one = 0.0, np.zeros((1, 2))
    counted = detection.image_mask(box.size).astype(bool)
    far = (box.size - 1) / 2 + BORDER
    for place in PLACES:
        image = np.zeros((box.size + 2 * BORDER, box.size + 2 * BORDER))
        stamp(image, psf, np.array([far + place[0]]), np.array([far + place[1]]), np.ones(1))
        inner = image[BORDER:-BORDER, BORDER:-BORDER] * detection.image_mask(box.size)
        off = _fitted(inner, np.array(place), one, design)[counted]
        worst = max(worst, float(np.abs(off).max() / inner.max()))
    return worst


def _fitted(image: Floats, start: Floats, spread: Floats, psf: core.Psf) -> Floats:
    """Residual: an image minus the image of a star at the best-fitting place and flux."""
    size = len(image)
    far = (size - 1) / 2 + BORDER
    inner = slice(BORDER, BORDER + size)

    def difference(place: Floats) -> Floats:
        model = np.zeros((size + 2 * BORDER, size + 2 * BORDER))
        at = place + spread + far
        stamp(model, psf, at[:, 0].copy(), at[:, 1].copy(), np.full(len(at), 1 / len(at)))
        part = model[inner, inner] * detection.image_mask(size)
        flux = float((part * image).sum() / (part**2).sum())
        return np.asarray(flux * part - image).ravel()

    scale = float(image.max())
    fit = optimize.least_squares(lambda at: difference(at) / scale, start, diff_step=1e-2)
    return difference(fit.x).reshape(image.shape)
