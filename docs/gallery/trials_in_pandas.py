"""Trials of a design as a pandas table: the error over the number of matched stars."""

from startrack import Fidelity, load_design, run_trials, shipped, to_pandas

case = load_design(shipped("designs/noise_only.toml")).case
trials = to_pandas(run_trials(case, seed=1, numbers=range(200), fidelity=Fidelity.COVARIANCE))
print("units:", trials.attrs["units"])
trials["across"] = (trials.error_x**2 + trials.error_y**2) ** 0.5 * 206265
print(trials.groupby(trials.stars // 20 * 20)["across"].agg(["count", "median", "max"]))
axes = trials.plot.scatter("stars", "across", xlabel="matched stars", ylabel="across (arcsec)")
axes.figure.savefig("stars.png")
