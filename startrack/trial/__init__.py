"""One trial in any of the fidelities: frame, window, spots, covariance.

window_plan  Case -> plan of its trials in windows: law of the noise, sampled frames, images.
window       Case and attitude -> the spots of a frame of which only windows are rendered.
spot_plan    Case -> plan of its statistical trials: detectable stars, their response, refusals.
spots        Case and attitude -> the spots of one trial, drawn without an image.
covariance   Case -> outcomes of trials from drawn spots, with identification assumed to be perfect.
effects      Table of the effects of designs: which parts of startrack count, refuse or omit each.
boxes        Stars that a tracker measures in its search boxes: in a frame, or as single stars by
             magnitude.
chain        One trial from stars to outcome: one line for each stage, in the order of the light.
"""

from startrack.trial.boxes import Images, SingleStars, agreeing, boxed, boxed_stars, follow_boxes
from startrack.trial.chain import (
    OUTCOMES,
    Record,
    drawn,
    frame_at,
    identify_and_solve,
    lost_in_space,
    observe,
    pattern_indexes,
    run_random_trial,
    run_trial,
    run_trials,
    searched,
    shrunk,
    solve_matches,
)
from startrack.trial.covariance import outcomes
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
from startrack.trial.spot_plan import (
    FluxLimits,
    SpotPlan,
    limits_of,
    plan_spots,
    plan_within,
    refuse,
    require_fidelity,
    through_of,
    view_of,
)
from startrack.trial.window import spots_in_windows
from startrack.trial.window_plan import plan_windows

# Public; the other imports serve other rooms.
__all__ = ["OUTCOMES"]
