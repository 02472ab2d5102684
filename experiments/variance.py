"""How many trials are needed for an rms within 1 %, plain and with each method, and do the
intervals have their coverage?

python experiments/variance.py [--json FILE] [--trials 896] [--windows 20] [--quick]

The figure of a method is the variance of its estimate times its number of frames, expressed as the
number of whole frames for which half of the 95 % interval is 1 % of the rms (2 % of the mean
square) on the example design. Other work of a method (windows, 400 covariance trials per frame, or
the control) counts as time: `times faster` is the gain in variance over the factor of CPU time.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from typing import Any

import one_thread  # noqa: F401  # isort: skip
import command
import numpy as np
from scipy import stats
from scipy.spatial.transform import Rotation

from startrack import Case, Fidelity, Streams, load_design, run_trials, shipped
from startrack.core import Floats, Ints, Rows
from startrack.montecarlo import (
    REPLICATES,
    Mean,
    Regions,
    Sampling,
    combined,
    mean_square,
    plain,
    squares,
    towards,
)
from startrack.montecarlo import one_thread as one_opencv_thread
from startrack.trial import OUTCOMES

FRAME, DRAWN = Fidelity.FRAME, Fidelity.COVARIANCE
SEED = 3
WANTED = 0.01  # half of the interval over the rms
REPETITIONS = 200
SAMPLE = 200  # trials of a repetition
REGIONS = Regions(4, 6)
COVARIANCES = 400  # for each frame
TIMED = 48  # plain frames
REGIONAL = 48  # windows in each region
MORE = 40  # windows or covariances for each frame of a repetition
MADE_OF = {
    "plain": ("frame",),
    "sobol": ("frame",),
    "control": ("frame and control",),
    "sobol and control": ("sobol frame and control",),
    "covariance": ("frame", "covariance"),
    "control and covariance": ("frame and control", "covariance"),
    "windows": ("frame", "window"),
    "all": ("frame and control", "window", "covariance"),
}


def by_regions(seed: int, numbers: Sequence[int], regions: Regions) -> Rotation:
    """Attitudes with boresights in each region in turn, uniform within the region.

    Trial n is in region n % len(regions).
    """
    fraction = np.array([Streams(seed, number)("region").random(3) for number in numbers])
    cell = np.asarray(numbers, np.int64) % len(regions)
    return towards(regions.place(cell, fraction[:, :2]), 2 * np.pi * fraction[:, 2])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=896)
    parser.add_argument(
        "--windows", type=int, default=20, help="number of windows for each frame (default: 20)"
    )
    options = command.read(parser, trials=2 * REPLICATES, windows=2)
    one_opencv_thread()
    case = load_design(shipped("designs/noise_only.toml")).case
    figures = measure(
        case, options.trials // REPLICATES * REPLICATES, options.windows, options.quick
    )
    command.save(options, figures)
    print(table(figures))


def stratified_error(values: Floats, stratum: Ints) -> float:
    """Standard error of the mean of values drawn independently in strata of equal probability.

    Source: Cochran (1977), Sampling Techniques, eq. (5.11).
    """
    count = np.bincount(stratum)
    mean = np.bincount(stratum, values) / count
    square = np.bincount(stratum, (values - mean[stratum]) ** 2) / (count - 1)
    return math.sqrt(float((square / count).sum())) / len(count)


def measure(case: Case, n: int, windows: int = 20, quick: bool = False) -> dict[str, Any]:
    """All methods on the example, from one run."""
    covariances, timed, regional_trials = (4, 2, 2) if quick else (COVARIANCES, TIMED, REGIONAL)
    kinds = {
        "frame": Sampling(),  # outcomes of frames with control; a few give the time
        "window": Sampling(Fidelity.WINDOW),
        "covariance": Sampling(DRAWN),
        "frame and control": Sampling(control=True),
        "sobol frame and control": Sampling(attitudes="sobol", control=True),
    }
    many = {"frame": timed, "window": windows * n, "covariance": covariances * n}
    made, seconds = {}, {}
    for name, sampling in kinds.items():
        sampling.trials(case, SEED, range(3))
        count = many.get(name, n)
        began = time.process_time()
        made[name] = sampling.trials(case, SEED, range(count))
        seconds[name] = (time.process_time() - began) / count
    names = list(OUTCOMES.names or ())
    controlled_frames = made["frame and control"]
    frames = controlled_frames[names]
    coarse, drawn = (made["window"], Fidelity.WINDOW), (made["covariance"], DRAWN)
    numbers = range(regional_trials * len(REGIONS))
    regional = run_trials(case, SEED, numbers, Fidelity.WINDOW, by_regions(SEED, numbers, REGIONS))
    cell = np.asarray(numbers) % len(REGIONS)
    figures: dict[str, Any] = {
        "trials": n,
        "windows": windows * n,
        "covariances": covariances * n,
        "ms_per_trial": {name: 1e3 * one for name, one in seconds.items()},
    }
    for about in (False, True):
        sobol = made["sobol frame and control"]
        means = {
            "plain": mean_square(frames, about),
            "sobol": mean_square(sobol[names], about, sobol=True),
            "control": mean_square(controlled_frames, about),
            "sobol and control": mean_square(sobol, about, sobol=True),
            "covariance": combined([(frames, FRAME), drawn], about),
            "control and covariance": combined([(controlled_frames, FRAME), drawn], about),
            "windows": combined([(frames, FRAME), coarse], about),
            "all": combined([(controlled_frames, FRAME), coarse, drawn], about),
        }
        name = "about" if about else "across"
        figures[name] = {}
        for method, mean in means.items():
            counts = many | {"frame": n}
            spent = sum(seconds[kind] * counts.get(kind, n) for kind in MADE_OF[method])
            figures[name][method] = told(mean, n, means["plain"], spent / (seconds["frame"] * n))
        in_regions = squares(regional, about)
        gain = (plain(in_regions).error / stratified_error(in_regions, cell)) ** 2
        figures[name]["regions"] = {"variance_reduction": gain}
        same = np.corrcoef(squares(frames, about), squares(made["window"][:n], about))[0, 1]
        figures[name]["window_correlation"] = float(same)
        figures[name]["coverage_95"] = coverage(
            controlled_frames,
            made["window"],
            made["covariance"],
            about,
            2 if quick else REPETITIONS,
        )
    across = figures["across"]
    figures["variance_reduction"] = max(across[one]["variance_reduction"] for one in means)
    figures["coverage_95"] = across["coverage_95"]
    return figures


def told(mean: Mean, n: int, alone: Mean, cost: float) -> dict[str, float]:
    """The efficiency of an estimate from n frames, with its interval.

    The gain of replicates has 15 degrees of freedom, the gain of other methods hundreds.

    cost  CPU time over the CPU time of plain frames
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
        "time": cost,
        "times_faster": gain / cost,
    }


def coverage(
    frames: Rows, windows: Rows, drawn: Rows, about: bool, repetitions: int
) -> dict[str, Any]:
    """Fraction of small samples from these trials whose interval contains the mean of all trials.

    Samples are drawn with replacement, so that the mean of all trials is the truth. For frames it
    is the mean of the windows, which include the trials of the frames. Differences are centred,
    because their expectation is zero.
    """
    rng = np.random.default_rng(SEED)
    name = "surplus_about" if about else "surplus_across"
    n = len(frames)
    centred = frames.copy()
    centred[name] -= centred[name].mean()
    names = list(OUTCOMES.names or ())
    truth = float(mean_square(frames[names], about).value)
    hits = dict.fromkeys(("plain", "control", "windows", "control and covariance"), 0)
    for _ in range(repetitions):
        mine, more = rng.integers(n, size=SAMPLE), rng.integers(n, size=MORE * SAMPLE)
        both = np.concatenate([mine, more])
        fine, coarse, cheap = (
            renumbered(centred[mine]),
            renumbered(windows[both]),
            renumbered(drawn[both]),
        )
        means = {
            "plain": mean_square(fine[names], about),
            "control": mean_square(fine, about),
            "windows": combined([(fine[names], FRAME), (coarse, Fidelity.WINDOW)], about),
            "control and covariance": combined([(fine, FRAME), (cheap, DRAWN)], about),
        }
        for method, mean in means.items():
            interval = mean.interval()
            hits[method] += bool(interval.low <= truth <= interval.high)
    bounds = stats.binom.ppf([1e-3, 0.999], repetitions, 0.95) / repetitions
    return {method: count / repetitions for method, count in hits.items()} | {
        "bounds_if_exact": bounds.tolist()
    }


def renumbered(outcomes: Rows) -> Rows:
    """Resampled trials with new numbers."""
    table = outcomes.copy()
    table["trial"] = np.arange(len(table))
    return table


def table(figures: dict[str, Any]) -> str:
    """The results as a text table."""
    lines = [
        f"{'':24s}{'across: frames for 1 %':>24s}{'times fewer':>20s}{'times faster':>14s}"
        f"{'about: fewer':>14s}{'faster':>8s}"
    ]
    across, about = figures["across"], figures["about"]
    for name, one in across.items():
        if name not in MADE_OF:
            continue
        fewer = (
            f"{one['variance_reduction']:.1f} [{one['variance_reduction_low']:.1f}, "
            f"{one['variance_reduction_high']:.1f}]"
        )
        lines.append(
            f"{name:24s}{one['trials_for_1_percent']:24.0f}{fewer:>20s}{one['times_faster']:14.2f}"
            f"{about[name]['variance_reduction']:14.1f}{about[name]['times_faster']:8.2f}"
        )
    lines.append(f"regions (windows): {across['regions']['variance_reduction']:.2f} times fewer")
    lines.append(f"correlation of frame and window {across['window_correlation']:.6f}")
    lines.append(f"ms a trial: {figures['ms_per_trial']}")
    lines.append(f"coverage: {across['coverage_95']}")
    return "\n".join(lines)


if __name__ == "__main__":
    command.run(main)
