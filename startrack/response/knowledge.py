"""Case -> the tracker's knowledge of its errors: their distributions, never the drawn values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated

import numpy as np

from startrack.attitude import UNKNOWN_FLOOR, KnownErrors, SharedErrors
from startrack.catalog import open_sky
from startrack.core import Floats, Ints, Stars, Unit, printed
from startrack.design import Case, aged, unchecked
from startrack.observation import (
    colour_correction,
    exposure_jitter,
    index_resolution,
    mean_colour,
    separated,
    sky_electrons,
)
from startrack.response.calibration_residual import map_noise, remaining_turns, residual_law
from startrack.response.dark_pattern import dark_pattern, with_uniform_dark
from startrack.response.neighbours import blending_shift
from startrack.response.spot_response import ResponseGrid, hot_windows
from startrack.response.star_errors import errors, lasting
from startrack.response.star_response import scale
from startrack.response.zones import focal_stretch, lens_variance


@printed
@dataclass(frozen=True, eq=False)
class TrackerKnowledge:
    """Knowledge that a tracker has of its errors.

    Arrays have one entry for each of the n stars of the tracker's own catalogue. Each part is
    computed when it is first needed, and kept.

    design   the case as designed, from which the distributions come
    of_unit  whether the tracker is a unit of this design with a calibrated camera
    age      second in orbit, at which hot pixels are counted; None: the age of the design
    """

    design: Case
    of_unit: bool = False
    age: Annotated[float | None, Unit("s", "yr")] = None

    @cached_property
    def stars(self) -> Stars:
        """The stars of the believed catalogue."""
        return open_sky(self.design.believed_catalog).stars

    @cached_property
    def systematic(self) -> Floats:
        """Pixel^2 (n,), variance per axis of a centroid by all causes except noise.

            variance = S-curve^2 + PRNU^2 + DSNU^2 + shift^2 / 2 + lens^2 + residual^2

        S-curve, PRNU, DSNU  from centroids of noise-free stars of the star's magnitude (`errors`)
        shift     by neighbours in the believed catalogue (`blending_shift`), along one line; each
                  axis therefore has half of its square
        lens      error of the lens model that the tracker does not correct, for a star of the
                  star's colour, mean over the frame (`lens_variance`)
        residual  rms of the `Residual` of a unit after its calibration

        `centroid_floor`, if given, replaces the sum.

        Accuracy  as `errors` and `blending_shift`. model: for a detector that scans, the tracker
                  assumes UNKNOWN_FLOOR. The tracker does not know how a residual changes with
                  temperature.
        """
        design, settings = self.design, self.design.tracker.attitude
        if settings.centroid_floor is not None:
            return np.full(len(self.stars), settings.centroid_floor**2)
        if design.instrument.detector.scan:
            variance = np.full(len(self.stars), UNKNOWN_FLOOR**2)
        else:
            variance = self._of_single_stars
        if not self.of_unit or design.instrument.residual is None:
            return variance
        square = residual_law(design) ** 2
        return variance + float(square.sum(axis=-1).mean()) + map_noise(design)

    @cached_property
    def of_pixels(self) -> Floats:
        """Pixel^2 (n,), the part of `systematic` that varies as a star moves over the pixels."""
        if not self._measures_stars:
            return np.zeros(len(self.stars))
        magnitude = self.stars.magnitude_g + colour_correction(self.design, self.stars.colour)
        return np.asarray(lasting(errors(self.design), magnitude) ** 2)

    @cached_property
    def hot(self) -> Floats:
        """Pixel^2 (n,) per axis, variance of stars by hot pixels at this age.

        It changes no weight and excludes no star, because it concerns few stars, and the tracker
        does not know which ones. `solve` adds it to the stated error if the residuals show no
        outlier.

            p <s^2 / 2 where s^2 < 2 g^2 (noise + lasting)>

        p is the probability of a hot pixel in a window, s the shift by hot pixels, and g the gate
        of the solver. The term is zero if `centroid_floor` is given.

        Accuracy  model: whether a star is left out does not depend on other stars. The squared
                  normalised error should have the mean 3. With this term it is 3.0 instead of 3.4
                  for 600 windows of `nanosatellite`. It is 2.4 instead of 3.4 for 400 windows of
                  `high_accuracy`, where nearly each star has a hot pixel. It is 2.9 to 4.2 instead
                  of 4.9 to 6.8 for 140 to 200 windows of `noise_only` at three doses.
        """
        none = np.zeros(len(self.stars))
        design = self.design if self.age is None else aged(self.design, self.age)
        if not self._measures_stars or dark_pattern(design) is None:
            return none
        star, even = errors(design), with_uniform_dark(design)
        magnitude = star.magnitude[::2]
        flux = scale(even).star * 10 ** (-0.4 * magnitude)
        windows, _ = hot_windows(ResponseGrid(even, sky_electrons(design)), design, flux)
        if not windows.chance:
            return none
        square = np.nan_to_num((windows.shift**2).sum(axis=-1) / 2, nan=np.inf)
        noise = np.trace(star.stated[::2], axis1=1, axis2=2) / 2
        own = noise + lasting(star, magnitude) ** 2
        used = square < design.tracker.attitude.gate**2 * own[:, None]
        variance = windows.chance * np.where(used, square, 0.0).mean(axis=1)
        where = self.stars.magnitude_g + colour_correction(design, self.stars.colour)
        return np.interp(where, magnitude, variance)

    @cached_property
    def shared(self) -> SharedErrors | None:
        """Errors that stars share; None if they share none.

        They are the `Residual` after the calibration of a unit, by rms and correlation length, and
        rotations of the camera relative to the spacecraft that vary after the calibration
        (`remaining_turns`). Jitter within the exposure is included, also for the case as designed.

        Accuracy  model: the tracker knows neither drifts over life, nor the change of a residual
                  with temperature, nor jitter by user code.
        """
        design, camera, turn = (
            self.design,
            self.design.believed_camera,
            exposure_jitter(self.design),
        )
        table = np.zeros((1, 1, 2, 1))
        if self.of_unit:
            turn = remaining_turns(design) + turn
            if design.tracker.attitude.centroid_floor is None:
                table = residual_law(design)
        variance = float((table**2).sum(axis=-1).mean())
        if not (variance or turn.any()):
            return None
        return SharedErrors(camera.columns, camera.rows, table, variance, turn)

    @cached_property
    def stretch(self) -> Floats | None:
        """`focal_stretch` (n,) for each star's colour; None if all are zero."""
        if not self.design.tracker.focal_length_by_colour:
            return None
        return focal_stretch(self.design, mean_colour(self.design, self.stars.colour))

    def of(self, star: Ints) -> KnownErrors:
        """The same knowledge for some stars of the catalogue."""
        return KnownErrors(self.systematic[star], self.shared, self.hot[star])

    def places(self, stars: Stars) -> Ints:
        """Indices in the catalogue of stars of the true sky; arbitrary for stars not in it."""
        return self.stars.find(stars.identifier)[0]

    @property
    def _measures_stars(self) -> bool:
        """Whether each star has its own systematic error, instead of one floor for all."""
        floor = self.design.tracker.attitude.centroid_floor
        return floor is None and not self.design.instrument.detector.scan

    @property
    def _of_single_stars(self) -> Floats:
        """`systematic` (n,) of the design, without residuals of a unit's calibration."""
        design, catalog = self.design, self.design.believed_catalog
        variance = self.of_pixels.copy()
        name = separated(catalog, index_resolution(design.instrument.camera)).name
        variance[name] += (blending_shift(design, catalog) ** 2).sum(axis=1) / 2
        if design.instrument.optics.tabulated:
            variance += lens_variance(design, mean_colour(design, self.stars.colour))
        return variance


def knowledge_of(case: Case) -> TrackerKnowledge:
    """Knowledge that the tracker of a case has of its errors; cached for 8 designs and ages.

    The true age of its detector is the only true value in it.
    """
    age = case.instrument.detector.age
    return _knowledge(case.as_designed, case.design is not None, age.time if age else None)


@lru_cache(maxsize=8)
def _knowledge(design: Case, of_unit: bool, age: float | None) -> TrackerKnowledge:
    # Knowledge of single stars is the same for all devices.
    alike: Case = unchecked(design, {"instrument.detector.device_seed": 0})
    return TrackerKnowledge(alike, of_unit, age)
