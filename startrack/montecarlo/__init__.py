"""Many trials: workers, store, resume, precision, variance reduction, rare events.

workers      Executors: this process, a pool of processes that survives crashes, Dask, MPI.
attitudes    Attitudes of trials: random, by Sobol points, or in turn in each region of the sky.
estimate     Values of trials, and what is known beside them -> a mean with its standard error.
control      Case, attitude and the image of a trial -> its linearised error, and the exact mean
             of that.
sampling     How a campaign draws its trials: fidelity, attitudes, with or without a control
             variate.
mean_square  Outcomes of a campaign, and of cheaper ones beside it -> the mean square of its
             errors.
rare         How often something rare befalls trials, by looking more often where it is likelier.
run          Many trials of one case over workers: the same numbers for any number of them.
precision    When a statistic of a campaign is known well enough; quantiles with exact intervals.
store        One SQLite file that holds a campaign: its case, seed, origin, and each block of
             trials done.
resume       Do what a store still lacks: the same trials, the same bytes, however often it was
             cut short.
watch        A store that is being filled -> how far it is and what it knows, now and then.
export       The trials of a campaign as files that other programs read; angles in radian.
"""

from startrack.montecarlo.attitudes import Regions, at_random, by_regions, by_sobol
from startrack.montecarlo.estimate import (
    Mean,
    controlled,
    plain,
    replicated,
    stratified,
    two_levels,
)
from startrack.montecarlo.export import export
from startrack.montecarlo.mean_square import combined, mean_square
from startrack.montecarlo.precision import STATISTICS, Precision, half_width, quantile_interval
from startrack.montecarlo.rare import chances, probability, where_likely
from startrack.montecarlo.resume import resume
from startrack.montecarlo.run import run, warm
from startrack.montecarlo.sampling import Sampling, sample_controlled
from startrack.montecarlo.store import Store, origin
from startrack.montecarlo.watch import Watch
from startrack.montecarlo.workers import Serial, cluster, dask_pool, mpi_pool, one_thread, pool

# Public; the other imports serve other rooms.
__all__ = [
    "Mean",
    "Precision",
    "Regions",
    "Sampling",
    "Serial",
    "Store",
    "Watch",
    "at_random",
    "by_regions",
    "by_sobol",
    "chances",
    "cluster",
    "combined",
    "controlled",
    "dask_pool",
    "export",
    "mean_square",
    "mpi_pool",
    "plain",
    "pool",
    "probability",
    "quantile_interval",
    "replicated",
    "resume",
    "run",
    "sample_controlled",
    "stratified",
    "two_levels",
    "warm",
    "where_likely",
]
