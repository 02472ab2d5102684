"""One trial in any fidelity: frame, window, spots, covariance.

pointing       Attitude of a trial, the motion of the camera about it, and what a tracker must
               report.
stars          Case -> the stars of its sky: which a frame may hold, how bright, and of what colour.
images         Instrument -> the images of stars: their PSF, over the frame and over their colour.
exposure       Case and attitude -> what its detector is exposed to, a matrix or lines that sweep.
belief         Case -> what its tracker believes: plan of the detection, meaning of the numbers,
               smear.
window         Case and attitude -> the spots of a frame of which only windows are rendered.
star_response  Case -> response of the tracker's centroid to single stars of any flux.
star_errors    Case -> errors of single stars over their magnitude, cause by cause.
zones          Case with a lens table -> how single stars are measured over the frame and over their
               colour.
systematic     Case -> systematic variance of each star, which the tracker adds to that of the
               noise.
dark_pattern   Dark signal of pixels: its law, its pattern in a case, and what hot pixels do.
spot_response  Case -> detection and centroid of a star, over its flux and position in the pixel.
spot_plan      Case -> plan of its statistical trials: detectable stars, their response, what is
               refused.
spots          Case and attitude -> the spots of one trial, drawn without an image.
covariance     Case -> outcomes of trials from drawn spots, with identification assumed to be
               perfect.
effects        The effects that designs may have, one row each: who counts, refuses or leaves out
               each.
boxes          Stars that a tracker takes in its search boxes: of a frame, and single ones by
               magnitude.
chain          One trial, one line a room, in the order in which the light goes.
photograph     Frame of an unknown camera -> its attitude and lens, whatever must be tried.
"""

from startrack.trial.belief import (
    SMEAR_STEP,
    as_believed,
    detection_plan,
    frames_of_map,
    seen_smear,
    smear_of,
)
from startrack.trial.boxes import Images, SingleStars, agreeing, boxed, boxed_stars, follow_boxes
from startrack.trial.chain import (
    OUTCOMES,
    Record,
    drawn,
    estimate_of,
    identify_and_solve,
    lost_in_space,
    observe,
    pattern_indexes,
    run_random_trial,
    run_trial,
    run_trials,
    searched,
    shrunk,
)
from startrack.trial.covariance import outcomes
from startrack.trial.dark_pattern import (
    HotPixels,
    dark_electrons,
    dark_pattern,
    empty_frame,
    with_uniform_dark,
)
from startrack.trial.effects import (
    DSNU,
    EFFECTS,
    HITS,
    JITTER,
    JITTER_OF_HEAD,
    LENS_COLOUR,
    SHUTTER,
    Term,
    left_out,
    present,
)
from startrack.trial.exposure import at_one_time, expected_electrons
from startrack.trial.images import detected_spectrum, images_of, psf_of
from startrack.trial.photograph import THRESHOLDS, Photograph, PhotographView, solve_photograph
from startrack.trial.pointing import (
    in_believed_axes,
    line_of_sight,
    random_attitude,
    random_attitudes,
    reference_attitude,
    rotations_from_cube,
)
from startrack.trial.spot_plan import (
    FluxLimits,
    SpotPlan,
    limits_of,
    plan_within,
    refuse,
    require_fidelity,
    through_of,
    view_of,
)
from startrack.trial.spot_response import ResponseGrid, hot_windows
from startrack.trial.star_errors import METHOD, READ, SHOT, TYPICAL, Errors, errors, lasting
from startrack.trial.star_response import (
    StarSearch,
    cell_side,
    detection_probability,
    measure,
    noise_free_frame,
    pixel_noise,
    scale,
    star_images,
)
from startrack.trial.stars import (
    colour_correction,
    index_resolution,
    light_of,
    mean_colour,
    separated,
    sky_electrons,
    stars_in_field,
    throughput,
)
from startrack.trial.systematic import (
    blending_shift,
    focal_stretches,
    hot_variance,
    pixel_variance,
    pixel_variance_of,
    platform_jitter,
    shared_errors,
    systematic_variance,
    systematic_variance_of,
)
from startrack.trial.window import spots_in_windows
from startrack.trial.zones import LENS_FIELD, residual_shift, zone_detection, zone_errors, zones_of

# Public; the other imports serve other rooms.
__all__ = ["errors", "systematic_variance"]
