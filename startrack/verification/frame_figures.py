"""Figures measured from frames of a tracker, and the same figures predicted by the design.

Both are reduced by the same code, so that a design can be estimated from them (`Told`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from startrack import detection
from startrack.core import Floats, Refused
from startrack.design import Case, Told
from startrack.motion import exposure_mean_rms
from startrack.response import READ, SHOT, errors, scale, star_images
from startrack.verification.accuracy import limiting_magnitude
from startrack.verification.figures import (
    ROUNDING,
    THIRD,
    Centroids,
    centroids,
    is_steady,
    still,
    third_differences,
)
from startrack.verification.windows_of_flight import (
    BORDER,
    FEWEST_IMAGES,
    Windows,
    blocks_of,
    jackknife_sigma,
)

SIDE = 8  # pixel, of the images whose corners give the background
SUBPIXELS = 4  # places of a star in a pixel, along each axis
# Least sigma of a figure's logarithm: difference between reduction and formula, measured in frames
# of drawn designs.
LEAST_SIGMA = {"star signal": 0.01, "image width": 0.01}
LEAST_KEPT = 1e-3  # least probability that a tracker measures a star of a figure
LEAST_MOTION = 1e-3  # pixel, least common motion that is returned
FEWEST_STILL = 16  # least number of third differences between images that do not move
OFF_RATE = 0.01  # largest relative difference of the time between frames from the design


class Reduced(NamedTuple):
    """Light and width of the images of a star.

    total   (n,) light above the background, in the unit of the images
    moment  (n,) pixel^2, second central moment per axis
    """

    total: Floats
    moment: Floats


def reduced(images: Floats, size: int) -> Reduced:
    """Light and width of images (n, 8, 8) in their `size` inner pixels, by the rule of
    `tracker.box`."""
    level = detection.corner_level(images)
    cut = (SIDE - size) // 2
    inner = images[:, cut : cut + size, cut : cut + size] - level[:, None, None]
    light = inner * detection.image_mask(size)
    total, step = light.sum(axis=(1, 2)), np.arange(size) - (size - 1) / 2
    moment = np.zeros(len(images))
    for axis in (1, 2):
        profile = light.sum(axis=axis) / total[:, None]
        moment += (profile @ step**2 - (profile @ step) ** 2) / 2
    return Reduced(total, moment)


def expected_in_frames(case: Case) -> dict[str, float]:
    """Figures that frames measure, predicted by the design, as `told_by_frames` defines them.

    Figures of other measurements are added: the limiting magnitude by `limiting_magnitude`, and
    PRNU and full well of a photon transfer. There are no figures for scanned lines.

    Raises    Refused if the design has no image.
    Accuracy  model: equal pixels; one image for the whole field; jitter by user code left out.
              numerical: 1e-3 of a star's light and width, by 16 places in the pixel.
    """
    instrument = case.instrument
    detector = instrument.detector
    if detector.scan:
        return {}
    seen = _reduced_stars(case)
    light = scale(case).star * float(seen.total.mean())
    electrons = detector.electrons_per_dn
    motion = exposure_mean_rms(instrument.motion, detector.exposure, _passed(detector.update_rate))
    pixel = 1 / instrument.camera.focal_length_px
    return {
        "gain": electrons,
        "read noise": detector.noise / electrons,
        "PRNU": detector.prnu / detector.binning,
        "full well": scale(case).largest,
        "star signal": light / electrons,
        "star electrons": light,
        "image width": math.sqrt(float(seen.moment.mean())),
        "common motion": math.sqrt(float((motion[:2] ** 2).mean())) / pixel,
        "limiting magnitude": limiting_magnitude(case),
    }


def _reduced_stars(case: Case) -> Reduced:
    """Light (fraction) and width of stars in the tracker's box, at several places in a pixel.

    The middle of an image lies between pixels; the middle of a cell lies on a pixel.
    """
    place = (np.arange(SUBPIXELS) + 0.5) / SUBPIXELS - 1
    places = np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)
    images = star_images(case.instrument, places, SIDE + 2 * BORDER)
    return reduced(images[:, BORDER:-BORDER, BORDER:-BORDER], case.tracker.box.size)


def expected_of_star(case: Case, figure: str, magnitude: float) -> float:
    """Figure of a sunlike star of a magnitude (Gaia's G), predicted by the design.

        SNR = N / sqrt(F^2 (N + n sky) + sum_i w_i^2 noise^2),  N its light in the tracker's box

    with the weights w of the n pixels of the box. "centroid noise", pixel rms per axis, is the
    temporal noise of the tracker's centroids, as in budgets.

    Raises    Refused for scanned lines, or if the tracker detects no star of the magnitude.
    """
    if case.instrument.detector.scan:
        raise Refused(f"told: {figure} must be left out for a detector that scans")
    if figure == "SNR":
        size = scale(case)
        light = size.star * 10 ** (-0.4 * magnitude) * float(_reduced_stars(case).total.mean())
        weight = detection.image_mask(case.tracker.box.size)
        dark = float((weight**2).sum()) * size.pixel**2
        return light / math.sqrt(size.excess * light + dark)
    star = errors(case)
    random = star.random[SHOT] + star.random[READ]
    sigma = np.sqrt(np.trace(random, axis1=1, axis2=2) / 2)
    seen = star.kept > LEAST_KEPT
    if not seen.any() or not star.magnitude[seen].min() <= magnitude <= star.magnitude[seen].max():
        raise Refused(f"told: the tracker must detect a star of G {magnitude:g}")
    logarithm = np.interp(magnitude, star.magnitude[seen], np.log(sigma[seen]))
    return math.exp(float(logarithm))


def _passed(rate: float) -> Callable[[Floats], Floats]:
    """Function: frequency -> fraction of a sinusoid's power that third differences keep."""
    lag = np.arange(len(THIRD))
    return lambda hertz: (
        np.abs(np.exp(-2j * np.pi * np.multiply.outer(np.asarray(hertz), lag) / rate) @ THIRD) ** 2
    )


def told_by_frames(case: Case, stars: Sequence[Windows], source: str = "") -> list[Told]:
    """Figures measured in frames of a tracker at rest, with their errors, to estimate a design.

        read noise     digital number, from the darker pixels around the stars and the design's gain
        star signal    digital number in an exposure: light of a sunlike star of G = 0 in the box,
                       from stars with `magnitude_g`
        image width    pixel, root of the second moment of the light in the box, mean of both axes
        common motion  pixel rms per axis, of third differences in time of the mean place of all
                       stars between frames at the update rate, without centroid noise

    stars     windows of stars, with images of 8 x 8 pixels
    Returns  figures that the frames determine; figures with unknown errors are left out
    Raises    Refused if the images are smaller.
    Accuracy  model: the error is from a jackknife over eight blocks of time; errors of magnitudes
              and differences between pixels are not included.
    """
    for star in stars:
        if star.number.shape[1] != SIDE:
            raise Refused(
                f"images of {star.name} must have 8 x 8 pixels for told figures, got "
                f"{star.number.shape[1]} x {star.number.shape[1]}"
            )
    stars = [star for star in stars if is_steady(star, case.tracker.box)]
    if not stars:
        raise Refused("images must hold a star of steady light for told figures, got none")
    whole, parts = _seen(case, stars), [_seen(case, part) for part in blocks_of(stars)]
    told = []
    for name, value in whole.items():
        values = np.array([part.get(name, math.nan) for part in parts])
        if not (value > 0 and (values > 0).all()):
            continue
        factor = math.exp(math.hypot(jackknife_sigma(np.log(values)), LEAST_SIGMA.get(name, 1e-3)))
        told.append(Told(name, number=value, factor=factor, source=source))
    return told


def _seen(case: Case, stars: Sequence[Windows]) -> dict[str, float]:
    """The figures of `told_by_frames`, each the mean over the stars."""
    figures = dict[str, float]()
    electrons = case.instrument.detector.electrons_per_dn
    variances = [_dark_variance(star, electrons) for star in stars]
    if finite := [variance for variance in variances if math.isfinite(variance)]:
        figures["read noise"] = math.sqrt(max(float(np.mean(finite)), 0.0))
    box = case.tracker.box
    seen = [centroids(star, box) for star in stars]
    light = [reduced(track.windows.number, box.size) for track in seen]
    flux = np.array([np.median(one.total) for one in light])
    known = np.array([star.magnitude_g for star in stars])
    bright = np.isfinite(known) & (flux > 0)
    if bright.any():
        signal = np.log(flux[bright]) + 0.4 * math.log(10) * known[bright]
        figures["star signal"] = math.exp(float(signal @ flux[bright] / flux[bright].sum()))
    moments = [float((one.total * one.moment).sum() / one.total.sum()) for one in light]
    weight = np.maximum(flux, 0) ** 2
    moment = float(weight @ moments / weight.sum())
    figures["image width"] = math.sqrt(max(moment, 0.0))
    figures["common motion"] = _common_motion(case, seen)
    return figures


def _dark_variance(star: Windows, electrons: float) -> float:
    """Variance of pixels without light, digital number^2, from the darker half of a star's window.

    It is computed from third differences in time, minus the shot noise of their light by the gain
    of the design. A photon transfer is not used, because bright pixels change when a star moves
    from frame to frame. NaN if the image moves too often.
    """
    number, calm = star.number.reshape(len(star.number), -1), still(star)
    if calm.sum() < FEWEST_STILL:
        return math.nan
    mean = number.mean(axis=0)
    dark = mean <= np.median(mean)
    variance = third_differences(number[:, dark])[calm].var(axis=0)
    return float((variance - mean[dark] / electrons).mean()) - ROUNDING


def _common_motion(case: Case, seen: Sequence[Centroids]) -> float:
    """Common motion of all stars, pixel rms per axis.

    NaN if frames are not at the update rate, or have only one star.
    """
    times, counts = np.unique(
        np.concatenate([track.windows.time for track in seen]), return_counts=True
    )
    if len(seen) < 2 or len(times) < FEWEST_IMAGES:
        return math.nan
    period = float(np.median(np.diff(times))) * case.instrument.detector.update_rate
    times = times[counts == len(seen)]
    if abs(period - 1) > OFF_RATE or len(times) < FEWEST_IMAGES:
        return math.nan
    together = [track.windows.of(np.isin(track.windows.time, times)) for track in seen]
    calm = np.all([still(windows) for windows in together], axis=0)
    place = np.stack([track.place[np.isin(track.windows.time, times)] for track in seen])
    if calm.sum() < FEWEST_STILL:
        return math.nan
    common = place.mean(axis=0)
    power = float((third_differences(common)[calm] ** 2).mean())
    noise = [float((third_differences(one - common)[calm] ** 2).mean()) for one in place]
    square = power - sum(noise) / (len(seen) * (len(seen) - 1))
    return math.sqrt(square) if square > LEAST_MOTION**2 else math.nan
