"""Images of stars that a tracker sent down, and its design -> each figure as predicted and as seen.

Both are measured by the same code: what the design predicts are images that it would have made of
the same stars on the same paths, on detectors of other pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from startrack.core import Advance, Floats, Refused, printed
from startrack.design import Case
from startrack.detection import Box
from startrack.metrics import Interval
from startrack.observation import psf_of
from startrack.response import scale
from startrack.verification.figures import centroids, is_steady, known_mean, measure
from startrack.verification.prediction import fraction_in_box, simulate
from startrack.verification.windows_of_flight import Windows, blocks_of, jackknife_sigma

OFF = 1.5  # of half of its interval, beyond which an offset is not zero: 3 sigma
# What each figure depends on in a design; those first that are usually known worst.
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
    "the predicted images have the light that is seen, so that neither transmission nor quantum "
    "efficiency is tested; give magnitude_g, Gaia's G of the star"
)


class FlightDifference(NamedTuple):
    """One figure of one star: as seen and as predicted, and what it points to in the design.

    seen       95 % by a jackknife over eight blocks of time
    predicted  median and 95 % of the devices drawn
    untested   why the two cannot differ by the design; empty: they can
    """

    star: str
    name: str
    seen: Interval
    predicted: Interval
    key: str
    untested: str = ""

    @property
    def ratio(self) -> float:
        """Predicted over seen; NaN where either is none."""
        either = self.predicted.value and self.seen.value
        return self.predicted.value / self.seen.value if either else math.nan

    @property
    def differs(self) -> bool:
        """Whether the intervals do not meet, of what the comparison tests."""
        if self.untested:
            return False
        return self.predicted.low > self.seen.high or self.predicted.high < self.seen.low


@printed
class FlightComparison(NamedTuple):
    """A comparison of all stars.

    curves  star: as seen and as predicted (2, PHASES), mean of the devices, pixel
    left    names of stars that are left out: no steady light, in images as seen or as predicted
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
) -> FlightComparison:
    """Measure images in flight and those that the design predicts, by the same code.

    Predicted images have the brightness of the flown images, so that it tests nothing, except for a
    star with `magnitude_g`: its predicted brightness follows from this magnitude, and tests
    transmission and quantum efficiency. The background is not tested where the images have another
    offset than the design. Stars without steady light, as seen or as predicted, are left out.

    Raises    Refused where no star is left, and behind a mosaic of colour filters.
    Accuracy  model: of the light by a magnitude that of `photon_irradiance`, for a sunlike star.
    """
    if case.instrument.detector.mosaic is not None:
        raise Refused("instrument.detector.mosaic must be left out: predicted images have none")
    box, psf = case.tracker.box, psf_of(case.instrument)
    steady = [star for star in stars if is_steady(star, box)] or list(stars)
    made = simulate(case, steady, devices, seed, progress)
    kept = [n for n, images in enumerate(zip(*made, strict=True)) if _all_steady(images, box)]
    left = tuple(star.name for star in stars if star not in [steady[n] for n in kept])
    if not kept:
        raise Refused("stars must have a steady light, as seen and as predicted")
    stars = [steady[n] for n in kept]
    drawn = [measure([unit[n] for n in kept], box, None) for unit in made]
    electrons = case.instrument.detector.electrons_per_dn
    noise = case.instrument.detector.noise / electrons
    measured = measure(stars, box, psf, noise)
    parts = [measure(block, box, None, noise) for block in blocks_of(stars)]
    differences, curves = [], {}
    stated = {"image": 0.0, "gain": electrons, "read_noise": noise, "offset": 0.0}
    for n, star in enumerate(stars):
        for name, value in measured[n].scalar.items():
            seen = _jackknifed(value, [part[n].scalar[name] for part in parts])
            predicted = _middle([unit[n].scalar[name] for unit in drawn])
            if name == "image":
                seen = Interval(value, value, value)
            if name in stated:
                predicted = Interval(*[stated[name]] * 3)
            untested = ""
            if name == "brightness":
                untested = "" if math.isfinite(star.magnitude_g) else SCALED
                if not untested:
                    bright = _light_by_magnitude(case, star)
                    predicted = Interval(
                        bright * predicted.value, bright * predicted.low, bright * predicted.high
                    )
            if math.isfinite(seen.value):
                row = FlightDifference(star.name, name, seen, predicted, KEYS[name], untested)
                differences.append(row)
        curves[star.name] = (
            measured[n].curve,
            known_mean(np.array([unit[n].curve for unit in drawn]), 0),
        )
    return FlightComparison(_of_known_offset(differences), curves, left)


def _all_steady(images: Sequence[Windows], box: Box) -> bool:
    return all(is_steady(one, box) for one in images)


def _light_by_magnitude(case: Case, star: Windows) -> float:
    """Light of a sunlike star of this G over that of the predicted images."""
    injected = float(np.median(centroids(star, case.tracker.box).total))
    injected *= case.instrument.detector.electrons_per_dn
    image = fraction_in_box(psf_of(case.instrument), case.tracker.box)
    return scale(case).star * 10 ** (-0.4 * star.magnitude_g) * image / injected


def _of_known_offset(differences: list[FlightDifference]) -> list[FlightDifference]:
    """The differences; those of the background are not tested where the offset differs."""
    off = {
        row.star: row
        for row in differences
        if row.name == "offset" and abs(row.seen.value) > OFF * (row.seen.high - row.seen.value)
    }
    return [
        row._replace(
            untested="the numbers have another offset than instrument.detector.offset: by photon "
            f"transfer {off[row.star].seen.value:.4g} digital numbers are left where there is no "
            "light"
        )
        if row.name == "background" and row.star in off
        else row
        for row in differences
    ]


def _jackknifed(value: float, parts: list[float]) -> Interval:
    """95 % by leaving out each block of time in turn."""
    sigma = jackknife_sigma(parts)
    return Interval(value, value - 1.96 * sigma, value + 1.96 * sigma)


def _middle(values: list[float]) -> Interval:
    """Median and 95 % of the devices."""
    finite = [value for value in values if math.isfinite(value)] or [math.nan]
    low, middle, high = np.percentile(finite, [2.5, 50, 97.5])
    return Interval(float(middle), float(low), float(high))
