"""Response of the tracker to one star: its errors, and its probability of detection.

star_inputs    Case -> the case with fixed values of all parameters that do not change a star image.
star_response  Case -> response of the tracker's centroid to single stars of any flux.
star_errors    Case -> errors of single stars over their magnitude, cause by cause.
zones          Case with a lens table -> errors of single stars, by place in the frame and colour.
neighbours     Case and catalogue -> shift of each star by the light of its neighbours.
calibration_residual  Design -> errors that remain after the calibration of a unit's camera:
                      displacements of stars, and rotations.
knowledge      Case -> its tracker's knowledge of its errors.
dark_pattern   Dark signal of pixels: its law, its pattern in a case, and the effect of hot pixels.
spot_response  Case -> detection and centroid of a star, over its flux and position in the pixel.
"""

from startrack.response.dark_pattern import (
    HotPixels,
    dark_currents,
    dark_electrons,
    dark_pattern,
    empty_frame,
    with_uniform_dark,
)
from startrack.response.knowledge import TrackerKnowledge, knowledge_of
from startrack.response.neighbours import blending_shift
from startrack.response.spot_response import (
    COMPANION_RADIUS,
    COMPANION_RATIOS,
    FLUX_STEP,
    ResponseGrid,
    SpotResponse,
    companion_shift,
    fluxes_between,
    hot_windows,
    response_of,
    response_of_zones,
)
from startrack.response.star_errors import METHOD, READ, SHOT, TYPICAL, Errors, errors, lasting
from startrack.response.star_inputs import star_inputs
from startrack.response.star_response import (
    PHASES,
    StarSearch,
    cell_side,
    detection_probability,
    magnitudes,
    measure,
    noise_free_frame,
    pixel_noise,
    point_images,
    scale,
    star_images,
    within_frame,
)
from startrack.response.zones import (
    LENS_FIELD,
    centroid_shift,
    focal_stretch,
    residual_shift,
    unique_places,
    zone_detection,
    zone_errors,
    zones_of,
)

# Public; the other imports serve other rooms.
__all__ = ["errors", "knowledge_of"]
