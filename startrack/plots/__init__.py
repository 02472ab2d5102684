"""Pictures of frames, PSFs, errors, sequences, budgets, optimisations and Earth scenes.

style     One look for all pictures: size, letters, colours, numbers; and how they are saved.
stretch   Frame -> brightness of a picture in which faint stars are seen, at any size.
names     Proper names of the brightest stars.
frames    Pictures of frames and solutions.
errors    Picture of the errors of many trials.
psf       The picture of a PSF: the image of a star over its pixels, and its modulation transfer.
earth     Pictures of Earth scenes: geometry over the image; image and radiance.
sequence  Picture of the errors of one sequence in time.
mission   Pictures of missions: when heads are blind, over season, orbit and direction.
budget    Pictures of an error budget: its causes, and the sky.
curves    Picture of an error budget beside trials: over slew rate, magnitude and field position.
optimise  Pictures of studies: convergence, samples, Pareto fronts and sensitivities.
"""

from startrack.plots.budget import draw_budget, draw_sky
from startrack.plots.curves import (
    LONGEST,
    SMEARS,
    Curve,
    analytic_curve,
    draw_curves,
    rates_drawn,
    slew_rates,
    slewing,
)
from startrack.plots.earth import draw_geometry, draw_picture, draw_product
from startrack.plots.errors import draw_errors
from startrack.plots.frames import draw_frame, draw_solution, draw_spots
from startrack.plots.mission import draw_beta, draw_mission, draw_placement
from startrack.plots.optimise import (
    draw_convergence,
    draw_corner,
    draw_front,
    draw_tolerance,
    draw_tornado,
    draw_variables,
)
from startrack.plots.psf import Curves, draw_psf
from startrack.plots.sequence import draw_sequence
from startrack.plots.style import (
    BLACK,
    BLUE,
    CYCLE,
    GREEN,
    GREY,
    LINES,
    MARKERS,
    ORANGE,
    PURPLE,
    RED,
    SETTINGS,
    SKY,
    SMALL,
    colour_bar,
    colour_limits,
    legend_below,
    number,
    outline,
    panel_title,
    picture,
    plain_numbers,
    save_picture,
    say,
    styled,
)

# Public; the other imports serve other rooms.
__all__ = ["draw_budget", "draw_errors", "draw_frame", "draw_sequence", "draw_spots"]
