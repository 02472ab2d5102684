"""Campaigns: many trials that survive a kill at any instant and stop when they know enough.

store      Store: one SQLite file with the case, the seed, and each block of trials that was done
origin     which software and which machine made the numbers
precision  Precision: when a statistic is known well enough; quantiles with intervals
watch      how far it is and what it knows, while it runs
resume     do what a store still lacks
export     the trials as CSV or Parquet
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
