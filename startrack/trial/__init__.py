"""One trial in any fidelity: frame, window, spots, covariance.

view           Case and attitude -> what stands before the detector: stars, light, PSF, path,
               throughput.
sweep          Case and attitude -> the image of lines that sweep over the sky, and its spots as a
               matrix's.
window         Case and attitude -> the spots of a frame of which only windows are rendered.
conditions     What changes a star's error besides noise: dark current, colour, stars too close
               together.
star_response  A Case enters; how the tracker's centroid responds to single stars of any flux
               leaves.
star_errors    Case -> errors of single stars over their magnitude, cause by cause.
neighbours     Case -> how far each star of a sky is moved by the light of those beside it.
systematic     Case -> what the tracker reckons each star to err by, beside the noise that it
               measures.
spot_response  Case -> what its detection makes of a star, by the star's flux and its place in the
               pixel.
spot_plan      Case -> all that its drawn trials share: what can be found, how it is seen, what is
               refused.
spots          A Case and an attitude enter; the spots of one trial leave, drawn without an image.
covariance     A Case enters; outcomes of trials leave, from drawn spots with identification
               assumed perfect.
chain          One trial, one line a room, in the order in which the light goes.
"""

from startrack.trial.chain import (
    OUTCOMES,
    Record,
    identify_and_solve,
    index_of,
    lost_in_space,
    observe,
    run_random_trial,
    run_trial,
    run_trials,
    solve_matches,
)
from startrack.trial.conditions import (
    SeparableStars,
    colour_correction,
    dark_currents,
    separable_stars,
)
from startrack.trial.covariance import outcomes
from startrack.trial.neighbours import blending_shift
from startrack.trial.spot_plan import plan_of, refuse
from startrack.trial.spots import spots_of
from startrack.trial.star_errors import METHOD, READ, SHOT, Errors, errors, lasting
from startrack.trial.star_response import (
    cell,
    detection_probability,
    images,
    measure,
    noise_free_frame,
    pixel_noise,
    scale,
)
from startrack.trial.systematic import systematic_variance, systematic_variance_of
from startrack.trial.view import (
    detected_spectrum,
    detection_plan,
    expected_electrons,
    light_of,
    line_of_sight,
    psf_of,
    random_attitude,
    random_attitudes,
    reference_attitude,
    rotations_from_cube,
    stars_in_field,
    throughput,
)

# Public; the other imports serve other rooms.
__all__ = ["Errors", "errors", "lasting", "systematic_variance", "systematic_variance_of"]
