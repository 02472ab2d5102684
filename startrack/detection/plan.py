"""Settings and PSF -> DetectionPlan: values that are computed once for many frames."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from startrack.core import Floats, Frame, Psf, Refused, Workspace, is_code
from startrack.detection import matched
from startrack.detection.methods import CENTROIDS, CentroidMethod, method_of
from startrack.detection.parameters import QUICK, Detection
from startrack.detection.pixels import (
    Calibration,
    PixelCorrection,
    Pixels,
    corrected,
    correction_of,
    pixels,
)
from startrack.detection.star_model import StarModel, gaussian_psf, smeared


@dataclass(frozen=True, eq=False)
class DetectionPlan:
    """Values that depend only on the settings and the image of a star, each computed at first use.

    settings   thresholds and windows
    star       image of a star that the tracker assumes
    dark       function that takes the dark frames for the dark map; None: no dark frames
    workspace  arrays that the calls with this plan use again; never returned
    """

    settings: Detection
    star: StarModel
    dark: Calibration | None = None
    workspace: Workspace = field(default_factory=Workspace, repr=False)

    @cached_property
    def method(self) -> CentroidMethod:
        """The centroid method: that of the settings, or the likelihood for streaks."""
        if self.settings.streaked and not is_code(self.settings.centroid):
            return CENTROIDS["likelihood"]
        return method_of(self.settings.centroid)

    @cached_property
    def kernel(self) -> matched.Kernel:
        """Matched filter of a star in the middle of a pixel."""
        if self.settings.kernel == "psf" or self.settings.streaked:
            return matched.psf_kernel(self.star.psf)
        return matched.gaussian_kernel(self.settings.kernel_sigma)

    @cached_property
    def quick_filter(self) -> matched.Kernel:
        """Filter of 3 x 3 pixels, by which the quick search selects places to examine."""
        return matched.middle_of(self.kernel)

    @cached_property
    def correction(self) -> PixelCorrection | None:
        """Correction of each pixel by the tracker's dark map; None without one.

        Raises  ValueError if the settings have a dark map, but there are no dark frames.
        """
        if self.settings.dark_map is None:
            return None
        if self.dark is None:
            raise Refused(
                "detection.dark_map needs dark frames of the detector, and this image comes "
                "without: subtract a dark frame from it and leave dark_map out"
            )
        return correction_of(self.settings.dark_map, self.dark())

    @cached_property
    def filters(self) -> Floats:
        """Matched filters of stars between the pixels, as `offset_filters` gives them."""
        return matched.offset_filters(self.star.psf, self.kernel)

    @cached_property
    def roughness(self) -> float:
        """Lambda^(1/2) of the filtered noise per pixel, see `false_alarms`."""
        return matched.roughness(self.filters, self.kernel)

    def searches_quickly(self, frame: Frame) -> bool:
        """Whether the search is quick; it takes unsigned numbers of 16 bits, none of them dead."""
        if self.settings.search != QUICK:
            return False
        image = np.asarray(frame.image)
        numbers = image.dtype.kind == "u" and image.dtype.itemsize <= 2
        return numbers and image.ndim == 2 and min(image.shape) > 2

    def threshold(self, area: int) -> float:
        """Threshold in sigma of normal noise, for a search of a number of pixels."""
        if self.settings.false_per_frame is None:
            return self.settings.threshold
        return matched.threshold_for(self.settings.false_per_frame / (area * self.roughness))


def plan_detection(
    settings: Detection, psf: Psf | None = None, dark: Calibration | None = None
) -> DetectionPlan:
    """Plan the detection for many frames.

    psf   of the design at rest, if the settings use it; None: a Gaussian of their kernel_sigma dark
    takes the dark frames for the dark map of the settings
    """
    if psf is None:
        return _plan_gaussian(settings)
    image = smeared(psf, *settings.smear)
    return DetectionPlan(settings, StarModel(image, settings.window // 2), dark)


def calibrated(frame: Frame, plan: DetectionPlan) -> Pixels:
    """The pixels of a whole frame, minus the dark signal of the plan's dark map.

    Raises  as `pixels`, and ValueError where the map is missing or differs in shape.
    """
    raw, correction = pixels(frame), plan.correction
    if correction is None:
        return raw
    value = corrected(raw.value, correction, plan.settings.saturation, raw.pivot)
    dead = correction.marks if raw.dead is None else correction.marks | raw.dead
    return raw._replace(value=value, dead=dead)


@lru_cache(maxsize=16)
def _plan_gaussian(settings: Detection) -> DetectionPlan:
    return plan_detection(settings, gaussian_psf(settings.kernel_sigma))


def planned(settings: Detection | DetectionPlan, psf: Psf | None = None) -> DetectionPlan:
    """The plan itself, or the plan of settings and a PSF."""
    return settings if isinstance(settings, DetectionPlan) else plan_detection(settings, psf)


def false_alarms(settings: Detection | DetectionPlan, columns: int, rows: int) -> float:
    """Expected number of noise peaks that pass the threshold.

        n = area Lambda^(1/2) (2 pi)^(-3/2) z exp(-z^2 / 2)

    z is the threshold, Lambda the determinant of the covariance of the slopes of the filtered
    noise over its variance, here from the overlap of the filters of neighbouring positions.

    Source: Adler (1981), The geometry of random fields, theorem 6.9.3.

    settings  as `detect` takes them
    Returns   1, per frame
    Accuracy  model: 5 % for thresholds from 4 on where the gain is known, a factor of 2 where the
              noise is estimated from tiles alone.
    """
    plan, area = planned(settings), columns * rows
    return area * plan.roughness * matched.peak_density(plan.threshold(area))
