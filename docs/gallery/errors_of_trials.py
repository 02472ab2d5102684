"""The errors of a hundred trials, across the boresight and about it, with their intervals."""

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.metrics import summarise
from startrack.plots import draw_errors

case = load_design(shipped("designs/noise_only.toml")).case
outcomes = run_trials(case, seed=1, numbers=range(100), fidelity=Fidelity.COVARIANCE)
print(summarise(outcomes))
draw_errors(None, outcomes, "noise alone").savefig("errors.png")
