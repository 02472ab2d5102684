"""Star images downlinked by a tracker, and its design -> each figure, predicted and measured.

Both figures are measured by the same code. The predicted images are those that the design would
have made of the same stars on the same paths, on detectors with other pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import stdtrit

from startrack.core import Advance, Floats, Refused, printed
from startrack.design import Case
from startrack.detection import Box
from startrack.metrics import Interval
from startrack.observation import psf_at
from startrack.response import scale
from startrack.verification.figures import centroids, image_of_other, is_steady, known_mean, measure
from startrack.verification.prediction import fraction_in_box, images_of_stars, simulate
from startrack.verification.windows_of_flight import Windows, blocks_of, jackknife_sigma

OFF = 1.5  # an offset is not zero if it exceeds 1.5 times half of its 95 % interval (3 sigma)
# Keys of the design that each figure depends on, usually least known first.
KEYS = {
    "background": "instrument.detector.dark_current, .thermal, .age; scene.background_g",
    "brightness": "instrument.optics.transmission, instrument.detector.quantum_efficiency",
    "gain": "instrument.detector.full_well, .bits",
    "read_noise": "instrument.detector.read_noise",
    "offset": "instrument.detector.offset, .read_noise",
    "image": "instrument.optics.psf_file (or the optics that make the image), .focus",
    "temporal": "instrument.detector.read_noise, .full_well; instrument.motion",
    "total": "instrument.detector.age, .dark_current, .prnu; tracker.box.background, .size",
    "moves": "tracker.box.moves",
    "curve": "tracker.box.background, .size, .moves; instrument.optics.psf_file",
    "acquired": "tracker.detection.threshold, .kernel_sigma; instrument.optics.transmission",
}
SCALED = (
    "the predicted images have the measured light, so that neither transmission nor quantum "
    "efficiency is tested; give magnitude_g, Gaia's G of the star"
)


class FlightDifference(NamedTuple):
    """One figure of one star: measured and predicted, and the keys of the design behind it.

    seen       measured value, with its 95 % interval by a jackknife over eight blocks of time
    predicted  median of the drawn devices, and the 95 % interval for a further device
    untested   why this figure does not test the design; empty if it does
    """

    star: str
    name: str
    seen: Interval
    predicted: Interval
    key: str
    untested: str = ""

    @property
    def ratio(self) -> float:
        """Predicted over measured; NaN if either is missing."""
        either = self.predicted.value and self.seen.value
        return self.predicted.value / self.seen.value if either else math.nan

    @property
    def differs(self) -> bool:
        """Whether a tested figure has intervals that do not overlap."""
        if self.untested:
            return False
        return self.predicted.low > self.seen.high or self.predicted.high < self.seen.low


@printed
class FlightComparison(NamedTuple):
    """A comparison of all stars.

    curves  for each star by name: measured and predicted curve (2, PHASES), pixel; the predicted
            one is the mean over the devices
    left    names of the stars that are left out, because their light is not steady in measured or
            predicted images
    """

    differences: list[FlightDifference]
    curves: dict[str, tuple[Floats, Floats]]
    left: tuple[str, ...] = ()


def compare_flown(
    case: Case,
    stars: Sequence[Windows],
    devices: int = 16,
    seed: int = 0,
    progress: Advance | None = None,
    unknown: Sequence[Case] = (),
) -> FlightComparison:
    """Measure images in flight and those that the design predicts, by the same code.

    Predicted images have the brightness of the flown images, so that brightness tests nothing. The
    exception is a star with `magnitude_g`: its predicted brightness follows from this magnitude,
    and tests transmission and quantum efficiency. Background and read noise are not tested if the
    images and the design have different offsets. A star is left out if its light is not steady in
    the measured or in the predicted images.

    unknown   the design with other values of its unknowns, one for each device, so that the
              predicted intervals include them; none: all devices are of `case`
    Raises    Refused if no star is left, or for a mosaic of colour filters; as `simulate`.
    Accuracy  model: light by a magnitude as in `photon_irradiance`, for a sunlike star; the image
              of a star on another device differs from that of `case` only by its PSF.
    """
    if case.instrument.detector.mosaic is not None:
        raise Refused("instrument.detector.mosaic must be left out: predicted images have none")
    box = case.tracker.box
    steady = [star for star in stars if is_steady(star, box)] or list(stars)
    made = simulate(case, steady, devices, seed, progress, unknown)
    kept = [n for n, images in enumerate(zip(*made, strict=True)) if _all_steady(images, box)]
    left = tuple(star.name for star in stars if star not in [steady[n] for n in kept])
    if not kept:
        raise Refused("stars must have a steady light, as measured and as predicted")
    stars = [steady[n] for n in kept]
    drawn = [measure([unit[n] for n in kept], box) for unit in made]
    detector = case.instrument.detector
    noise = detector.noise / detector.electrons_per_dn
    psfs, cases = images_of_stars(case, stars), unknown or [case] * devices
    measured = measure(stars, box, psfs, noise)
    parts = [measure(block, box, read_noise=noise) for block in blocks_of(stars)]
    others = [images_of_stars(one, stars) if unknown else psfs for one in cases]
    differences, curves = [], {}
    for n, star in enumerate(stars):
        predicted = {
            name: np.array([unit[n].scalar[name] for unit in drawn]) for name in measured[n].scalar
        }
        predicted["image"] = np.array([image_of_other(one[n], psfs[n], box) for one in others])
        scaled = not math.isfinite(star.magnitude_g)
        if not scaled:
            predicted["brightness"] *= [_light_by_magnitude(one, star) for one in cases]
        predicted |= _by_design(case, cases)
        for name, value in measured[n].scalar.items():
            seen = _jackknifed(value, [part[n].scalar[name] for part in parts])
            if name == "image":
                seen = Interval(value, value, value)
            if math.isfinite(seen.value):
                row = FlightDifference(
                    star=star.name,
                    name=name,
                    seen=seen,
                    predicted=_of_devices(predicted[name]),
                    key=KEYS[name],
                    untested=SCALED if scaled and name == "brightness" else "",
                )
                differences.append(row)
        curves[star.name] = (
            measured[n].curve,
            known_mean(np.array([unit[n].curve for unit in drawn]), 0),
        )
    return FlightComparison(_of_known_offset(differences), curves, left)


def _all_steady(images: Sequence[Windows], box: Box) -> bool:
    return all(is_steady(one, box) for one in images)


def _by_design(case: Case, cases: Sequence[Case]) -> dict[str, Floats]:
    """Figures (n,) of each of the cases that need no image; the offset is relative to `case`."""
    detectors = [one.instrument.detector for one in cases]
    gain = np.array([detector.electrons_per_dn for detector in detectors])
    return {
        "gain": gain,
        "read_noise": np.array([detector.noise for detector in detectors]) / gain,
        "offset": np.array([detector.offset for detector in detectors])
        - case.instrument.detector.offset,
    }


def _light_by_magnitude(case: Case, star: Windows) -> float:
    """Light of a sunlike star of this G over the light of the predicted images."""
    injected = float(np.median(centroids(star, case.tracker.box).total))
    injected *= case.instrument.detector.electrons_per_dn
    psf = psf_at(case.instrument, *star.place_on(case.instrument.detector))
    image = fraction_in_box(psf, case.tracker.box)
    return scale(case).star * 10 ** (-0.4 * star.magnitude_g) * image / injected


def _of_known_offset(differences: list[FlightDifference]) -> list[FlightDifference]:
    """The differences, with background and read noise untested if the offset differs.

    Both of these figures are measured from numbers without light, which contain the offset.
    """
    off = {
        row.star: row
        for row in differences
        if row.name == "offset"
        and _distance(row.seen.value, row.predicted) > OFF * (row.seen.high - row.seen.value)
    }
    return [
        row._replace(
            untested="the offset of the numbers is not instrument.detector.offset: by photon "
            f"transfer, {off[row.star].seen.value:.4g} digital numbers remain where there is no "
            "light"
        )
        if row.name in ("background", "read_noise") and row.star in off
        else row
        for row in differences
    ]


def _distance(value: float, interval: Interval) -> float:
    """Distance of a value from an interval; zero inside."""
    return max(interval.low - value, value - interval.high, 0.0)


def _jackknifed(value: float, parts: list[float]) -> Interval:
    """95 % interval by leaving out each block of time in turn."""
    sigma = jackknife_sigma(parts)
    return Interval(value, value - 1.96 * sigma, value + 1.96 * sigma)


def _of_devices(values: Floats) -> Interval:
    """Median of the devices (n,), and the 95 % interval for a further device.

    It follows from Student's t distribution, for positive values of their logarithms. It is
    unbounded for one device.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return Interval(math.nan, math.nan, math.nan)
    value, positive = float(np.median(known)), bool((known > 0).all())
    if len(known) < 2:
        return Interval(value, 0.0 if positive else -math.inf, math.inf)
    normal = np.log(known) if positive else known
    half = (
        float(stdtrit(len(known) - 1, 0.975)) * math.sqrt(1 + 1 / len(known)) * normal.std(ddof=1)
    )
    ends = normal.mean() + np.array([-half, half])
    low, high = np.exp(ends) if positive else ends
    # Equal devices differ by rounding.
    return Interval(value, min(float(low), value), max(float(high), value))
