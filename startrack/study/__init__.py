"""Studies on designs: many trials, better designs, tolerances.

parameter        a dotted name in a case -> its value, or the case with another
box              Variable, Link, Box: named parameters of a case as points of a unit cube
choice           Choice: parts of a design that are one of several
requirements     Requirements: mass, power, update rate, stars in the sky, availability
objective        which error is made small
campaign         Campaign: what an optimisation or a sampling is asked to do

montecarlo       many trials of one case over workers
workers          executors: this process, a pool that is made again when a worker dies
cluster          executors beyond one machine: Dask, MPI
bench            where designs are tried
ledger           trials that were done, on disk

optimize         nlopt on the Monte Carlo of the whole chain, from first to last:
reach            a place that meets what needs no trials
prospect         where the analytic budget is best
race             which of several branches goes on
refine           passes of the search on ever more trials
search           nlopt
evaluate         a place -> how good its design is
correction       how far trials are from the analytic budget
assure           the availability, and a bound that holds

pareto           what one goal costs in terms of another
sensitivity      what the error depends on
sample           how far each parameter may stray
surface          a quadratic through Monte Carlo results, with the error that it makes
ensemble         emcee, and whether to believe it
posterior        what a camera may be, by the stars that it saw
width            what the width of its PSF may be
photon_transfer  what a detector may be, by frames of even light
tables           the results as CSV, JSON and Markdown
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
