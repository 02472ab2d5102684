"""Studies on designs: many trials, better designs, tolerances.

box           Variable, Box: named parameters of a case as points of a unit cube
requirements  Requirements: mass, power, update rate, stars in the sky, availability
workers       executors: this process, a pool that is made again when a worker dies
cluster       executors beyond one machine: Dask, MPI
montecarlo    many trials of one case over workers
optimize      nlopt on the Monte Carlo of the whole chain
surface       a quadratic through Monte Carlo results, with the error that it makes
sample        emcee on the designs that meet the requirement
campaign      Campaign: what an optimisation or a sampling is asked to do
"""
