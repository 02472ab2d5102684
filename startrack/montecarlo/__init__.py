"""Many trials: workers, store, resume, precision, variance reduction, rare events.

workers     Executors: this process, a pool of processes that survives crashes, Dask, MPI.
attitudes   Attitudes of trials: random, at Sobol points, region by region, or denser where an event
            is likelier.
estimate    Values of trials, control variates, outcomes of faster fidelities -> a mean with its
            standard error.
control     Case, attitude and image of a trial -> its linearised error, and the exact mean of it.
sampling    Sampling: fidelity and attitudes of the trials of a campaign, and their control variate.
run         Many trials of one case over workers: the same numbers for any number of them.
store       One SQLite file that holds a campaign; its trials as CSV or Parquet.
causes      Outcomes of trials -> status, reason, boresight and nearby bodies of each trial.
comparison  The same trials of two campaigns, or at each fidelity -> their statistics side by side,
            and the differences.
resume      Run the trials that a store lacks, with the same bytes after any interruptions, until
            the interval of a statistic is narrow enough; a Watch reports the progress.
sketch      Outcomes of any number of trials -> a Sketch of fixed size: moments, quantiles, tails.
merge       Stores of parts of a campaign -> one store, with the same bytes in any order of the
            parts.
"""

from startrack.montecarlo.attitudes import (
    REPLICATES,
    Regions,
    at_random,
    chances,
    towards,
    where_likely,
)
from startrack.montecarlo.causes import Ending, Endings, endings, with_causes
from startrack.montecarlo.comparison import Difference, differences, fidelity_comparison
from startrack.montecarlo.estimate import Mean, combined, mean_square, plain, probability
from startrack.montecarlo.merge import merge_stores
from startrack.montecarlo.resume import (
    Precision,
    Watch,
    half_width,
    last_words,
    quantile_interval,
    resume,
)
from startrack.montecarlo.run import missing_runs, run, warm
from startrack.montecarlo.sampling import Sampling, squares
from startrack.montecarlo.sketch import (
    Sketch,
    load_sketch,
    merge_sketches,
    resume_sketch,
    save_sketch,
)
from startrack.montecarlo.store import Store, export, origin
from startrack.montecarlo.workers import Certificates, Serial, cluster, dask_pool, one_thread, pool

# Public; the other imports serve other rooms.
__all__ = [
    "Certificates",
    "Precision",
    "Regions",
    "Sampling",
    "Serial",
    "Sketch",
    "Store",
    "chances",
    "dask_pool",
    "export",
    "load_sketch",
    "merge_sketches",
    "merge_stores",
    "pool",
    "probability",
    "resume",
    "resume_sketch",
    "run",
    "save_sketch",
    "warm",
    "where_likely",
]
