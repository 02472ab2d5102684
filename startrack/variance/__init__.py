"""More knowledge from fewer trials; every estimate here is right on average, whatever it leans on.

attitudes  where trials look: at random, by Sobol's points, in turn in each region
regions    the sky cut into cells of equal area
sample     trials at chosen attitudes, with their controls where asked for
control    a trial to first order in its pixel noise, and the exact mean of that
estimate   values and what is known beside them -> a mean with its standard error
rare       how often something rare happens, by looking more often where it is likelier
"""
