"""Pictures of frames, PSFs, errors, sequences, budgets, optimisations and Earth scenes.

frames    Pictures of frames, solutions and errors.
psf       The picture of a PSF: the image of a star over its pixels, and its modulation transfer.
earth     Pictures of Earth scenes: geometry over the image; image and radiance.
sequence  Picture of the errors of one sequence in time.
budget    Pictures of an error budget: its causes, the sky, and the error over rate, magnitude,
          field.
optimise  Pictures of studies: convergence, samples, Pareto fronts and sensitivities.
"""

from startrack.plots.budget import draw_budget, draw_curves, draw_sky
from startrack.plots.earth import draw_geometry, draw_picture
from startrack.plots.frames import draw_errors, draw_frame, draw_solution, draw_spots
from startrack.plots.optimise import (
    draw_convergence,
    draw_corner,
    draw_front,
    draw_tolerance,
    draw_tornado,
)
from startrack.plots.psf import Curves, draw_psf
from startrack.plots.sequence import draw_sequence
