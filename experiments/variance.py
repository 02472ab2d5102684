"""How many trials does 1 % of an rms take, plain and with each help, and do the intervals hold?

python experiments/variance.py --json FILE [--trials 800] [--out FOLDER]

A method's figure is the variance of its estimate times its trials: how many whole frames it needs
until half its 95 % interval is 1 % of the rms (2 % of the mean square) on the example design.
Windows that a frame needs beside it are counted as time, not as trials.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import one_thread  # noqa: F401  # isort: skip
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from startrack.case import Case, Fidelity
from startrack.catalog import shipped
from startrack.design import load_design
from startrack.study.workers import one_thread as one_opencv_thread
from startrack.variance.attitudes import REPLICATES, at_random, by_regions, by_sobol
from startrack.variance.estimate import (
    Mean,
    best_share,
    controlled,
    explained,
    plain,
    replicated,
    stratified,
    two_levels,
)
from startrack.variance.regions import Regions
from startrack.variance.sample import sample, sample_controlled, squares, surplus

Floats = NDArray[np.float64]

SEED = 3
WANTED = 0.01  # of the rms, half of the interval
REPETITIONS = 200
SAMPLE = 200  # trials of a repetition
REGIONS = Regions(4, 6)
WINDOWS = 12  # for each frame


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=800)
    options = parser.parse_args()
    one_opencv_thread()
    case = load_design(shipped("designs/nanosatellite.toml")).case
    figures = measure(case, options.trials // REPLICATES * REPLICATES)
    options.json.write_text(json.dumps(figures, indent=1) + "\n")
    print(table(figures))


def measure(case: Case, n: int) -> dict[str, Any]:
    """All methods on the example, from one run."""
    numbers = range(n)
    random = at_random(SEED, numbers)
    sample(case, SEED, range(3), random[:3]), sample(case, SEED, range(3), random[:3], WINDOW)
    seconds: dict[str, float] = {}
    frames = timed(seconds, "frame", n, lambda: sample(case, SEED, numbers, random))
    windows = timed(seconds, "window", n, lambda: sample(case, SEED, numbers, random, WINDOW))
    controls = timed(
        seconds, "frame and control", n, lambda: sample_controlled(case, SEED, numbers, random)
    )[1]
    sobol, sobol_controls = sample_controlled(case, SEED, numbers, by_sobol(SEED, numbers))
    extra = range(n, n + WINDOWS * n)
    more = sample(case, SEED, extra, at_random(SEED, extra), WINDOW)
    many = range(16 * REPLICATES * (n // REPLICATES))
    regional = sample(case, SEED, many, by_regions(SEED, many, REGIONS), WINDOW)
    figures: dict[str, Any] = {
        "trials": n,
        "ms_per_trial": {k: 1e3 * v for k, v in seconds.items()},
    }
    for about in (False, True):
        values, coarse, further = (squares(one, about) for one in (frames, windows, more))
        with_sobol = squares(sobol, about)
        replicate = np.arange(n) % REPLICATES
        c, cs = surplus(controls, about)[:, None], surplus(sobol_controls, about)[:, None]
        cell = np.asarray(many) % len(REGIONS)
        in_regions = squares(regional, about)
        stratified_gain = (plain(in_regions).error / stratified(in_regions, cell).error) ** 2
        means = {
            "plain": plain(values),
            "sobol": replicated(with_sobol, replicate),
            "control": controlled(values, c),
            "sobol and control": replicated(with_sobol - explained(with_sobol, cs), replicate),
            "windows": two_levels(values, coarse, further),
        }
        name = "about" if about else "across"
        figures[name] = {key: told(mean, n, means["plain"]) for key, mean in means.items()}
        figures[name]["regions"] = {"variance_reduction": stratified_gain}
        correlation = float(np.corrcoef(values, coarse)[0, 1])
        share = best_share(correlation, seconds["frame"] / seconds["window"])
        figures[name]["window_correlation"] = correlation
        figures[name]["best_windows_per_frame"] = share
        figures[name]["frames_times_fewer_at_best"] = 1 / (
            1 - correlation**2 + correlation**2 / (share + 1)
        )
        figures[name]["coverage_95"] = coverage(values, c[:, 0], coarse)
    figures["variance_reduction"] = max(
        figures["across"][method]["variance_reduction"]
        for method in ("control", "sobol and control", "windows")
    )
    return figures


WINDOW = Fidelity.WINDOW


def timed(seconds: dict[str, float], name: str, n: int, call: Any) -> Any:
    """The call's result; its CPU time a trial is kept."""
    began = time.process_time()
    result = call()
    seconds[name] = (time.process_time() - began) / n
    return result


def told(mean: Mean, n: int, alone: Mean) -> dict[str, float]:
    """What an estimate from n frames is worth, with the interval of its worth.

    The gain of replicates rests on 15 degrees of freedom, that of the others on hundreds.
    """
    gain = (alone.error / mean.error) ** 2
    low, high = stats.f.ppf([0.025, 0.975], mean.freedom, alone.freedom)
    z = stats.norm.ppf(0.975)
    needed = n * (z * mean.error / (2 * WANTED * mean.value)) ** 2
    return {
        "mean_square": mean.value,
        "standard_error": mean.error,
        "trials_for_1_percent": needed,
        "variance_reduction": gain,
        "variance_reduction_low": gain * float(low),
        "variance_reduction_high": gain * float(high),
    }


def coverage(values: Floats, control: Floats, coarse: Floats) -> dict[str, Any]:
    """How often the intervals of small samples from these trials hold the mean of all of them.

    Drawn with replacement, so that the mean of all is the truth.
    """
    rng = np.random.default_rng(SEED)
    hits = dict.fromkeys(("plain", "control", "windows"), 0)
    control = control - control.mean()
    for _ in range(REPETITIONS):
        mine = rng.integers(len(values), size=SAMPLE)
        many = rng.integers(len(values), size=WINDOWS * SAMPLE)
        means = {
            "plain": (plain(values[mine]), values.mean()),
            "control": (controlled(values[mine], control[mine, None]), values.mean()),
            "windows": (two_levels(values[mine], coarse[mine], coarse[many]), values.mean()),
        }
        for name, (mean, truth) in means.items():
            interval = mean.interval()
            hits[name] += bool(interval.low <= truth <= interval.high)
    bounds = stats.binom.ppf([1e-3, 0.999], REPETITIONS, 0.95) / REPETITIONS
    return {name: count / REPETITIONS for name, count in hits.items()} | {
        "bounds_if_exact": bounds.tolist()
    }


def table(figures: dict[str, Any]) -> str:
    """For a person."""
    lines = [f"{'':20s}{'across: trials for 1 %':>24s}{'times fewer':>24s}{'about: fewer':>14s}"]
    for name in ("plain", "sobol", "control", "sobol and control", "windows"):
        one, other = figures["across"][name], figures["about"][name]
        fewer = (
            f"{one['variance_reduction']:.1f} [{one['variance_reduction_low']:.1f}, "
            f"{one['variance_reduction_high']:.1f}]"
        )
        lines.append(
            f"{name:20s}{one['trials_for_1_percent']:24.0f}{fewer:>24s}"
            f"{other['variance_reduction']:14.1f}"
        )
    across = figures["across"]
    lines.append(
        f"{'regions (windows)':20s}{'':24s}{across['regions']['variance_reduction']:24.2f}"
    )
    lines.append(f"correlation of frame and window {across['window_correlation']:.5f}; at best "
                 f"{across['best_windows_per_frame']:.0f} windows a frame, "
                 f"{across['frames_times_fewer_at_best']:.0f} times fewer frames")  # fmt: skip
    lines.append(f"ms a trial: {figures['ms_per_trial']}")
    lines.append(f"coverage: {across['coverage_95']}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
