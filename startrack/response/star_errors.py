"""Case -> errors of single stars over their magnitude, cause by cause."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Annotated, NamedTuple

import numpy as np

from startrack.core import Floats, Unit, kept, printed
from startrack.design import Case, unchecked
from startrack.response import star_response
from startrack.response.dark_pattern import dark_residual
from startrack.response.star_inputs import unmapped_inputs
from startrack.response.star_response import Chart, chart, magnitudes, pattern, scale

LEAST_KEPT = 1e-6  # sum of probabilities to be kept, below which a magnitude is not used
TYPICAL = 4.5  # G of a star of high weight in most trackers; chosen by hand
NEAR = 0.8  # fraction of saturation from which on a star may saturate; chosen by hand
SHOT, READ, METHOD = "shot noise", "read noise", "centroid method"


@printed
class Errors(NamedTuple):
    """Errors of single stars.

    magnitude  (m,) G of a sunlike star
    kept       (m,) probability that the tracker measures a detected star and does not reject it as
               a hot pixel
    stated     (m, 2, 2) pixel^2, covariance that the tracker states
    random     (m, 2, 2) pixel^2 by cause, covariance over positions, times and devices
    mean       (m, 2) pixel, error of the centroid method, mean over the positions
    """

    magnitude: Annotated[Floats, Unit("mag")]
    kept: Floats
    stated: Annotated[Floats, Unit("pixel2")]
    random: Annotated[dict[str, Floats], Unit("pixel2")]
    mean: Annotated[Floats, Unit("pixel")]


@kept(8, reads=unmapped_inputs)
def errors(case: Case) -> Errors:
    """Errors of single stars of each magnitude, cause by cause; kept for the 8 last cases."""
    detector = case.instrument.detector
    images = star_response.images_at_phases(case)
    magnitude = magnitudes(case, case.believed_catalog.limit_g)
    star = noisy_stars(case, magnitude, images)
    plain, kept = star.plain, star.kept
    method = mean_of(plain.offset, kept)
    stated, noise, shot = (
        mean_of(values, kept) for values in (plain.covariance, star.noise, star.shot)
    )
    random = {
        SHOT: shot,
        READ: noise - shot,
        METHOD: moment_of(plain.offset - method[:, None], kept),
    }
    shape = (len(magnitude), *images.point.shape)
    if detector.prnu:
        gain = 1 + detector.prnu / detector.binning * pattern("photo response", shape)
        moved = chart(case, magnitude, gain=gain, both_signs=False).offset - plain.one_sign
        random["PRNU"] = moment_of(moved, kept)
    spread = dark_residual(detector, case.tracker.detection.dark_map)
    if spread:
        extra = spread * pattern("dark current", shape)
        moved = chart(case, magnitude, extra=extra, both_signs=False).offset - plain.one_sign
        random["DSNU"] = moment_of(moved, kept)
    return Errors(magnitude, kept.mean(axis=1), stated, random, method)


class NoisyStars(NamedTuple):
    """Stars of m magnitudes at p positions, and their errors by noise.

    plain        noise-free stars, with the covariance that the tracker states
    kept         (m, p) probability that the tracker measures a detected star and does not reject it
                 as a hot pixel
    noise, shot  (m, p, 2, 2) pixel^2, covariance by all noise, and by shot noise alone
    """

    plain: Chart
    kept: Floats
    noise: Floats
    shot: Floats

    def at(self, positions: slice) -> NoisyStars:
        """The stars at some of the positions."""
        plain = Chart(self.plain.magnitude, *(values[:, positions] for values in self.plain[1:]))
        return NoisyStars(plain, *(values[:, positions] for values in self[1:]))


def noisy_stars(
    case: Case,
    magnitude: Floats,
    images: star_response.StarImages,
    both_signs: bool = True,
    groups: int = 1,
) -> NoisyStars:
    """The noise of stars of some images; arguments as for `chart`."""
    measured = partial(chart, magnitude=magnitude, images=images, groups=groups)
    plain = measured(case, both_signs=both_signs)
    kept = star_response.kept_fraction(case, plain, images)
    noise = _noise_covariance(case, plain, images, both_signs, groups)
    # The tracker overstates the covariance of a saturated star on purpose.
    bold = without_saturation(case)
    bare = measured(bold, reading=star_response.Reading.SHOT_NOISE, both_signs=False)
    return NoisyStars(plain, kept, noise, bare.covariance)


def _noise_covariance(
    case: Case, plain: Chart, images: star_response.StarImages, both_signs: bool, groups: int
) -> Floats:
    """The true covariance (m, p, 2, 2) pixel^2 of a chart, by the case `without_saturation`."""
    saturation, bold = case.tracker.detection.saturation, without_saturation(case)
    magnitude, covariance = plain.magnitude, plain.covariance
    measured = partial(chart, bold, images=images, both_signs=both_signs, groups=groups)
    if case.design is not None:
        return measured(magnitude, reading=star_response.Reading.TRUE).covariance
    if saturation is None:
        return covariance
    size, detector = scale(case), case.instrument.detector
    peak = size.star * 10 ** (-0.4 * magnitude) * float(images.point.max())
    peak += size.background + size.pixel
    # Only stars that may saturate at some position are computed again: the others do not change.
    near = detector.offset + peak / detector.electrons_per_dn > NEAR * saturation
    covariance = covariance.copy()
    if near.any():
        covariance[near] = measured(magnitude[near]).covariance
    return covariance


@lru_cache(maxsize=8)
def without_saturation(case: Case) -> Case:
    """The case with a tracker that does not overstate the covariance of saturated stars.

    Cached for the last 8 cases.
    """
    bold: Case = unchecked(case, {"tracker.detection.saturation": None})
    return bold


def mean_of(values: Floats, kept: Floats) -> Floats:
    """Mean over the positions (second axis), weighted by the chance (m, p) that a star is kept.

    If no star of a magnitude is kept, the mean is that of the nearest magnitude with kept stars,
    because values are interpolated between magnitudes. If no star of any magnitude is kept, the
    mean is zero and is never used.
    """
    weight = kept.reshape(*kept.shape, *[1] * (values.ndim - 2)) * np.isfinite(values)
    total = (weight * np.nan_to_num(values)).sum(axis=1)
    count = weight.sum(axis=1)
    mean = total / np.where(count > 0, count, 1.0)
    row = np.arange(len(mean))
    some = np.flatnonzero((count > LEAST_KEPT).reshape(len(mean), -1).any(axis=1))
    if len(some):
        mean = mean[some[np.abs(row[:, None] - some).argmin(axis=1)]]
    return np.asarray(mean)


def moment_of(offset: Floats, kept: Floats) -> Floats:
    """Second moments (m, 2, 2) of offsets (m, p, 2)."""
    return mean_of(offset[..., :, None] * offset[..., None, :], kept)


def lasting(star: Errors, magnitude: Floats | float = TYPICAL) -> Floats:
    """Rms error per axis (pixel) of noise-free stars: constant while a star stays on its pixels.

    magnitude  (...) G of sunlike stars
    Returns    (...) root mean square over positions in the pixel and over devices
    """
    still = sum(part for name, part in star.random.items() if name not in (SHOT, READ))
    variance = np.trace(still, axis1=1, axis2=2) / 2
    # The error by dark current grows exponentially with magnitude: interpolate its logarithm.
    return np.exp(np.interp(magnitude, star.magnitude, np.log(np.maximum(variance, 1e-16)) / 2))
