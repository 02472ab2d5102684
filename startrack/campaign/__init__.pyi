from .export import export as export
from .precision import Precision as Precision
from .precision import quantile_interval as quantile_interval
from .resume import resume as resume
from .store import Store as Store
from .watch import Watch as Watch
