"""Many trials: workers, store, resume, precision, variance reduction, rare events.

workers      Executors: this process, a pool of processes that survives crashes, Dask, MPI.
attitudes    Attitudes of trials: random, at Sobol points, or in each region of the sky in turn.
estimate     Values of trials, and control variates -> a mean with its standard error.
control      Case, attitude and image of a trial -> its linearised error, and the exact mean of it.
sampling     Sampling: fidelity and attitudes of the trials of a campaign, and their control
             variate.
mean_square  Outcomes of a campaign, and of faster fidelities -> the mean square of its errors.
rare         Probability of a rare event, with more trials where it is likelier.
run          Many trials of one case over workers: the same numbers for any number of them.
precision    When the interval of a statistic is narrow enough; quantiles with exact intervals.
store        One SQLite file that holds a campaign; its trials as CSV or Parquet.
causes       Outcomes of trials -> the status of each, why it is so, where it looked, and what
             was near.
paired       Outcomes of two campaigns -> their statistics side by side, and the differences.
resume       Do the trials that a store lacks: the same bytes, however often it was interrupted.
sketch       Outcomes of any number of trials -> a Sketch of fixed size: moments, quantiles, tails.
merge        Stores of parts of a campaign -> one store, with the same bytes in any order of the
             parts.
fidelities   CPU time and error of the same trials at each fidelity.
watch        A store that is being filled -> its progress and statistic, from time to time.
"""

from startrack.montecarlo.attitudes import Regions, at_random, by_regions, by_sobol
from startrack.montecarlo.causes import Ending, Endings, endings, with_causes
from startrack.montecarlo.estimate import (
    Mean,
    controlled,
    plain,
    replicated,
    stratified,
    two_levels,
)
from startrack.montecarlo.fidelities import fidelity_comparison
from startrack.montecarlo.mean_square import combined, mean_square
from startrack.montecarlo.merge import Merged, merge_stores
from startrack.montecarlo.paired import Difference, differences
from startrack.montecarlo.precision import STATISTICS, Precision, half_width, quantile_interval
from startrack.montecarlo.rare import chances, probability, where_likely
from startrack.montecarlo.resume import last_words, resume
from startrack.montecarlo.run import run, warm
from startrack.montecarlo.sampling import Sampling, sample_controlled
from startrack.montecarlo.sketch import (
    Bins,
    Sketch,
    load_sketch,
    merge_sketches,
    resume_sketch,
    save_sketch,
)
from startrack.montecarlo.store import Store, checksum, export, impossible, origin
from startrack.montecarlo.watch import Watch
from startrack.montecarlo.workers import (
    Certificates,
    Serial,
    cluster,
    dask_pool,
    mpi_pool,
    one_thread,
    pool,
)

# Public; the other imports serve other rooms.
__all__ = [
    "Bins",
    "Certificates",
    "Difference",
    "Ending",
    "Endings",
    "Mean",
    "Merged",
    "Precision",
    "Regions",
    "Sampling",
    "Serial",
    "Sketch",
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
    "differences",
    "endings",
    "export",
    "load_sketch",
    "mean_square",
    "merge_sketches",
    "merge_stores",
    "mpi_pool",
    "plain",
    "pool",
    "probability",
    "quantile_interval",
    "replicated",
    "resume",
    "resume_sketch",
    "run",
    "sample_controlled",
    "save_sketch",
    "stratified",
    "two_levels",
    "warm",
    "where_likely",
    "with_causes",
]
