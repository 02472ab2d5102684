"""Inputs of an exposure: stars, images, attitude and motion; and the values the tracker assumes.

pointing  Attitude of a trial, the motion of the camera about it, and the attitude that a tracker
          must report.
stars     Case -> the stars that may be in a frame, their brightness and colour.
images    Instrument -> the images of stars: PSF by place in the frame and by colour.
exposure  Case and attitude -> the exposure of its detector, a matrix or scanning lines.
belief    Case -> values that its tracker assumes: detection plan, meaning of the numbers, smear.
"""

from startrack.observation.belief import (
    SMEAR_STEP,
    as_believed,
    detection_plan,
    frames_of_map,
    seen_smear,
    smear,
    smear_of,
    with_smear,
)
from startrack.observation.exposure import (
    at_one_time,
    duration,
    expected_electrons,
    exposure_of,
    out_of_step,
    straighten,
    sweep,
)
from startrack.observation.images import (
    TEMPERATURES,
    colour_range,
    detected_spectrum,
    field_psf_of,
    images_of,
    psf_at,
    psf_of,
    sunlike_colour,
    with_images_of,
)
from startrack.observation.pointing import (
    exposure_jitter,
    in_believed_axes,
    line_of_sight,
    mean_attitude,
    motion_before,
    motion_function,
    platform_jitter,
    random_attitude,
    random_attitudes,
    reference_attitude,
    rotations_from_cube,
)
from startrack.observation.stars import (
    colour_correction,
    colours_of,
    electrons_of,
    index_resolution,
    light_by_colour,
    light_of,
    mean_by_colour,
    mean_colour,
    near_pairs,
    nearby,
    separated,
    sky_electrons,
    sorted_wavelengths,
    stars_in_field,
    throughput,
    throughput_of_colours,
)

# Public; the other imports serve other rooms.
__all__ = ["light_of", "line_of_sight", "psf_of", "stars_in_field", "throughput"]
