"""Detection: how spots are distinguished from noise, and how they are measured."""

import math
from dataclasses import replace
from typing import Self

from startrack.core import (
    NON_NEGATIVE,
    POSITIVE,
    Parameters,
    Range,
    Refused,
    Unit,
    parameter,
    within,
)
from startrack.detection.methods import CENTROIDS
from startrack.detection.pixels import DarkMap

FILTER, QUICK = SEARCHES = ("filter", "quick")
KERNELS = ("gaussian", "psf")
COMPENSATIONS = ("none", "gaussian", "psf")
LONGEST_STREAK = 100.0  # pixel
# Pixel, smear from which on only the likelihood follows a star. Chosen by hand: the windows of
# other methods lose the ends of a longer smear, and a shorter smear adds less than 10 % to their
# error.
STREAK = 1.0


SMEAR = (
    "pixel, by which the tracker assumes that a star's image moves in the exposure: they draw the "
    'PSF out and make it the kernel, and beyond a pixel "likelihood" the centroid, unless that is '
    "code. None: in a trial or a sequence that of the rates that the tracker knows, elsewhere "
    "none; 0: none"
)


class Detection(Parameters):
    """Detection and measurement of spots. The defaults suit real images of many cameras."""

    centroid: str = parameter(
        '"gravity": centre of gravity; "weighted": under a Gaussian weight that follows the '
        'star; "gaussian": fit of a Gaussian, its width too; "likelihood": fit of the design\'s '
        "PSF; or user code, see docs/extensions.md",
        limit=Range(choices=CENTROIDS, code="centroids"),
        default="gravity",
    )
    compensation: str = parameter(
        'of "gravity" for what its window cuts off and pixels average: "none", "gaussian" as '
        'for a Gaussian star of unknown width, "psf" by the design\'s PSF',
        limit=Range(choices=COMPENSATIONS),
        default="gaussian",
    )
    kernel: str = parameter(
        'of the matched filter: "gaussian" of kernel_sigma, or the design\'s "psf"',
        limit=Range(choices=KERNELS),
        default="gaussian",
    )
    smear_x: float | None = parameter(SMEAR, default=None)
    smear_y: float | None = parameter(SMEAR, default=None)
    threshold: float = parameter(
        "sigma of the filtered frame, above the background, that a spot must exceed",
        limit=POSITIVE,
        default=5.5,
    )
    false_per_frame: float | None = parameter(
        "false spots that noise may make on average in what is searched; where given, the "
        "threshold follows from it",
        limit=Range(1e-12, 1e3),
        default=None,
    )
    kernel_sigma: float = parameter(
        "pixel, sigma of the Gaussian matched filter; best near that of the stars",
        limit=Range(0.3, 10),
        default=1.0,
    )
    window: int = parameter(
        "pixel, odd side of the square whose centre of gravity is taken",
        limit=Range(3, 31),
        default=5,
    )
    mesh: int = parameter(
        "pixel, side of the tiles that background and noise are estimated on",
        limit=Range(8, 1024),
        default=32,
    )
    min_area: int = parameter(
        "pixel, smallest connected component above the threshold", limit=Range(1, 2**30), default=1
    )
    max_area: int = parameter(
        "pixel, largest one; trees, clouds and the Earth's limb are larger",
        limit=Range(1, 2**30),
        default=1000,
    )
    max_spots: int = parameter(
        "number of spots that are kept, the brightest ones", limit=Range(1, 2**30), default=100
    )
    sharpest_sigma: float = parameter(
        "pixel, sigma of the sharpest star; what is sharper is a hot pixel. 0 keeps all",
        limit=NON_NEGATIVE,
        default=0.35,
    )
    saturation: float | None = parameter(
        "digital number from which a pixel's value is no longer known; None if never",
        limit=POSITIVE,
        default=None,
    )
    edge: int = parameter(
        "pixel, how far a window must stay from the border of the frame",
        limit=Range(0, 2**20),
        default=0,
    )
    dark_map: DarkMap | None = parameter(
        "what the tracker knows of the dark signal of its pixels; None: nothing", default=None
    )
    dark_map_age: float | None = parameter(
        "second in orbit at which its dark map is made; before, and None: of the same day",
        unit=Unit("s", "yr"),
        limit=NON_NEGATIVE,
        default=None,
    )
    search: str = parameter(
        '"filter": peaks of the matched filter above the threshold; "quick": the same near the '
        "pixels that a filter of 3 x 3 pixels points out, in a third of the time where stars are "
        "few, which loses some of the faintest stars; or user code, see docs/extensions.md, which "
        "finds the stars of whole frames without threshold, kernel, mesh and areas",
        limit=Range(choices=SEARCHES, code="detections"),
        default=FILTER,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        within(-LONGEST_STREAK, LONGEST_STREAK, smear_x=self.smear[0], smear_y=self.smear[1])
        if self.window % 2 == 0:
            raise Refused(f"window must be odd, got {self.window}")
        if self.max_area < self.min_area:
            raise Refused(
                f"max_area must be at least min_area = {self.min_area}, got {self.max_area}"
            )
        if self.dark_map_age is not None and self.dark_map is None:
            raise Refused("dark_map_age must come with a dark_map")

    @property
    def without_map(self) -> Self:
        """This detection without a dark map."""
        return replace(self, dark_map=None, dark_map_age=None)

    @property
    def smear(self) -> tuple[float, float]:
        """Pixel along x and y; 0 if left out."""
        return self.smear_x or 0.0, self.smear_y or 0.0

    @property
    def streaked(self) -> bool:
        """Whether stars are smeared by more than `STREAK`."""
        return math.hypot(*self.smear) > STREAK
