"""Detection: how spots are distinguished from noise, and how they are measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from startrack.core import (
    Refused,
    Unit,
    code_field,
    full_name,
    non_negative,
    one_of,
    one_of_or_code,
    positive,
    whole,
    within,
)
from startrack.detection.dark_map import DarkMap
from startrack.detection.methods import CENTROIDS

SEARCHES = ("filter",)
KERNELS = ("gaussian", "psf")
COMPENSATIONS = ("none", "gaussian", "psf")
LONGEST_STREAK = 100.0  # pixel


@dataclass(frozen=True)
class Detection:
    """How spots are found and measured. The defaults serve real images of many cameras.

    centroid        "gravity": centre of gravity; "weighted": under a Gaussian weight that follows
                    the star; "gaussian": fit of a Gaussian, its width too; "likelihood": fit of
                    the design's PSF; or code of one's own, see docs/extensions.md
    search          "filter": peaks of the matched filter above the threshold; or code of one's own,
                    see docs/extensions.md, which finds the stars of whole frames without threshold,
                    kernel, mesh and areas
    compensation    of "gravity" for what its window cuts off and pixels average: "none",
                    "gaussian" as for a Gaussian star of unknown width, "psf" by the design's PSF
    kernel          of the matched filter: "gaussian" of kernel_sigma, or the design's "psf"
    smear_x, _y     pixel, by which the tracker assumes that a star's image moves in the exposure:
                    they draw the PSF out and make it the kernel, and beyond a pixel "likelihood"
                    the centroid, unless that is code. None: in a trial or a sequence that of the
                    rates that the tracker knows, elsewhere none; 0: none
    threshold       sigma of the filtered frame, above the background, that a spot must exceed
    false_per_frame false spots that noise may make on average in what is searched; where given,
                    the threshold follows from it
    kernel_sigma    pixel, sigma of the Gaussian matched filter; best near that of the
                    stars
    window          pixel, odd side of the square whose centre of gravity is taken
    mesh            pixel, side of the tiles that background and noise are estimated on
    min_area        pixel, smallest connected component above the threshold
    max_area        pixel, largest one; trees, clouds and the Earth's limb are larger
    max_spots       the brightest so many are kept
    sharpest_sigma  pixel, sigma of the sharpest star; what is sharper is a hot pixel. 0 keeps all
    saturation      digital number from which a pixel's value is no longer known; None if never
    edge            pixel, how far a window must stay from the border of the frame
    dark_map        what the tracker knows of the dark signal of its pixels; None: nothing
    dark_map_age    second in orbit at which its dark map is made; before, and None: of the same day
    """

    centroid: str = code_field("centroids", "gravity")
    compensation: str = "gaussian"
    kernel: str = "gaussian"
    smear_x: float | None = None
    smear_y: float | None = None
    threshold: float = 5.5
    false_per_frame: float | None = None
    kernel_sigma: float = 1.0
    window: int = 5
    mesh: int = 32
    min_area: int = 1
    max_area: int = 1000
    max_spots: int = 100
    sharpest_sigma: float = 0.35
    saturation: float | None = None
    edge: int = 0
    dark_map: DarkMap | None = None
    dark_map_age: Annotated[float | None, Unit("s", "yr")] = None
    search: str = code_field("detections", "filter")

    def __post_init__(self) -> None:
        centroid = full_name("centroids", CENTROIDS, self.centroid)
        object.__setattr__(self, "centroid", centroid)
        one_of_or_code(CENTROIDS, centroid=self.centroid)
        object.__setattr__(self, "search", full_name("detections", SEARCHES, self.search))
        one_of_or_code(SEARCHES, search=self.search)
        one_of(COMPENSATIONS, compensation=self.compensation)
        one_of(KERNELS, kernel=self.kernel)
        within(-LONGEST_STREAK, LONGEST_STREAK, smear_x=self.smear[0], smear_y=self.smear[1])
        positive(threshold=self.threshold)
        if self.false_per_frame is not None:
            within(1e-12, 1e3, false_per_frame=self.false_per_frame)
        within(0.3, 10, kernel_sigma=self.kernel_sigma)
        whole(3, 31, window=self.window)
        if self.window % 2 == 0:
            raise Refused(f"window must be odd, got {self.window}")
        whole(8, 1024, mesh=self.mesh)
        whole(1, 2**30, min_area=self.min_area, max_area=self.max_area, max_spots=self.max_spots)
        if self.max_area < self.min_area:
            raise Refused(
                f"max_area must be at least min_area = {self.min_area}, got {self.max_area}"
            )
        non_negative(sharpest_sigma=self.sharpest_sigma)
        if self.saturation is not None:
            positive(saturation=self.saturation)
        whole(0, 2**20, edge=self.edge)
        if self.dark_map_age is not None:
            non_negative(dark_map_age=self.dark_map_age)
            if self.dark_map is None:
                raise Refused("dark_map_age must come with a dark_map")

    @property
    def smear(self) -> tuple[float, float]:
        """Pixel along x and y; 0 where it is left out."""
        return self.smear_x or 0.0, self.smear_y or 0.0
