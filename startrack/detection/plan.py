"""Settings and PSF -> DetectionPlan: what the detection computes once for many frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

from startrack.core import Floats, Psf, Workspace
from startrack.detection.matched import Kernel, kernel_of
from startrack.detection.parameters import Detection
from startrack.detection.psf_table import gaussian_psf
from startrack.detection.star_model import StarModel, smeared
from startrack.detection.threshold import offset_filters, peak_density, roughness, threshold_for


@dataclass(frozen=True, eq=False)
class DetectionPlan:
    """What follows from the settings and the image of a star alone, each computed at first use.

    settings   thresholds and windows
    star       image of a star that the tracker assumes
    workspace  arrays that the calls with this plan use again; never returned
    """

    settings: Detection
    star: StarModel
    workspace: Workspace = field(default_factory=Workspace, repr=False)

    @cached_property
    def kernel(self) -> Kernel:
        """Matched filter of a star in the middle of a pixel."""
        return kernel_of(self.settings, self.star.psf)

    @cached_property
    def filters(self) -> Floats:
        """Matched filters of stars between the pixels, as `offset_filters` gives them."""
        return offset_filters(self.star.psf, self.kernel)

    @cached_property
    def roughness(self) -> float:
        """Lambda^(1/2) of the filtered noise per pixel, see `false_alarms`."""
        return roughness(self.filters, self.kernel)

    def threshold(self, area: int) -> float:
        """Threshold in sigma of normal noise, for a search of so many pixels."""
        if self.settings.false_per_frame is None:
            return self.settings.threshold
        return threshold_for(self.settings.false_per_frame / (area * self.roughness))


def plan_detection(settings: Detection, psf: Psf | None = None) -> DetectionPlan:
    """Plan the detection for many frames.

    psf  of the design at rest, where the settings use it; None: a Gaussian of their kernel_sigma
    """
    if psf is None:
        return _plan_gaussian(settings)
    image = smeared(psf, settings.smear_x, settings.smear_y)
    return DetectionPlan(settings, StarModel(image, settings.window // 2))


@lru_cache(maxsize=16)
def _plan_gaussian(settings: Detection) -> DetectionPlan:
    return plan_detection(settings, gaussian_psf(settings.kernel_sigma))


def planned(settings: Detection | DetectionPlan, psf: Psf | None = None) -> DetectionPlan:
    """The plan itself, or that of settings and a PSF."""
    return settings if isinstance(settings, DetectionPlan) else plan_detection(settings, psf)


def false_alarms(
    settings: Detection | DetectionPlan, columns: int, rows: int, psf: Psf | None = None
) -> float:
    """Expected number of noise peaks that pass the threshold.

        n = area Lambda^(1/2) (2 pi)^(-3/2) z exp(-z^2 / 2)

    z is the threshold, Lambda the determinant of the covariance of the slopes of the filtered
    noise over its variance, here from the overlap of the filters of neighbouring positions.

    Source: Adler (1981), The geometry of random fields, theorem 6.9.3.

    settings, psf  as `detect` takes them
    Returns  1, per frame
    Accuracy  model: 5 % for thresholds from 4 on where the gain is known, a factor of 2 where the
              noise is estimated from tiles alone.
    """
    plan, area = planned(settings, psf), columns * rows
    return area * plan.roughness * peak_density(plan.threshold(area))


def threshold_of(
    settings: Detection | DetectionPlan, columns: int, rows: int, psf: Psf | None = None
) -> float:
    """Threshold of the search of a frame, in sigma of normal noise; arguments as `false_alarms`."""
    return planned(settings, psf).threshold(columns * rows)
