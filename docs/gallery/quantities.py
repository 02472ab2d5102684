"""Results in an astropy table with units, of a design whose stars end at another magnitude."""

from startrack import Fidelity, load_design, run_trials, shipped, to_qtable
from startrack.metrics import summarise

for limit in (5.5, 6.5):
    changes = [f"catalog.limit_g={limit}"]
    case = load_design(shipped("designs/noise_only.toml"), changes).case
    outcomes = run_trials(case, seed=1, numbers=range(100), fidelity=Fidelity.COVARIANCE)
    table = to_qtable(outcomes[outcomes["solved"]])
    print(limit, table["error_x"].std().to("arcsec"), summarise(outcomes))
