"""Pictures of frames, PSFs, errors, sequences, budgets, optimisations and Earth scenes.

style     One look for all pictures: size, letters, colours, numbers; and how they are saved.
frames    Pictures of frames and solutions that show faint stars at any size.
errors    Pictures of errors: of many trials, and of one sequence in time.
psf       The picture of a PSF: the image of a star over its pixels, and its modulation transfer.
earth     Pictures of Earth scenes: geometry over the image; image and radiance.
mission   Pictures of missions: when heads are blind, over season, orbit and direction.
budget    Pictures of an error budget: its causes, the sky, and beside trials its curves over slew
          rate, magnitude and field position.
prediction  Intervals of predicted errors, and the part of each unknown in their width.
improve   The search of a problem: forecasts, trials, start and best.
sweep     Pictures of sweeps: errors and margins over keys, and the values that just keep a limit.
optimise  Pictures of studies: convergence, samples, Pareto fronts and sensitivities.
"""

import lazy_loader

# Each name is loaded when it is first used: a picture of a frame needs no error budget.
__getattr__, __dir__, _ = lazy_loader.attach_stub(__name__, __file__)

# Public; the other names serve other rooms.
__all__ = ["draw_budget", "draw_sequence", "draw_sky"]
