"""More knowledge from fewer trials; every estimate here is right on average, whatever it leans on.

attitudes    where trials look: at random, by Sobol's points, in turn in each region
regions      the sky cut into cells of equal area
control      a trial to first order in its pixel noise, and the exact mean of that
sample       frames at chosen attitudes, with their controls
sampling     Sampling: how the trials of a campaign are made
estimate     values and what is known beside them -> a mean with its standard error
mean_square  outcomes, and those of cheaper campaigns -> the mean square of the errors
rare         how often something rare happens, by looking more often where it is likelier
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
