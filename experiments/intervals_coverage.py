"""Intervals of rms, levels and ratios, for trials drawn from pools of a design's trials."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.budget import SkySample
from startrack.design import Objective
from startrack.metrics import level_interval, rms_interval
from startrack.observation import random_attitudes

COUNTS = (20, 50, 200, 1000)
LEVELS = (0.95, 0.9973)
TIMES = 4  # frames of each member of a budget
BLUR = "instrument.optics.blur=4 um"


class Design(NamedTuple):
    """A design and the fidelity of its trials; a second design has another blur.

    changes  as for `--set`
    """

    file: str
    changes: tuple[str, ...]
    fidelity: Fidelity


DESIGNS = {
    "many stars": Design("noise_only", (), Fidelity.COVARIANCE),
    "five stars": Design("noise_only", ("tracker.detection.max_spots=5",), Fidelity.COVARIANCE),
    "slew": Design("noise_only", ("instrument.motion.rate_y=1 deg/s",), Fidelity.SPOTS),
    "nanosatellite": Design("nanosatellite", (), Fidelity.SPOTS),
    "faint stars": Design("noise_only", ("instrument.detector.exposure=30 ms",), Fidelity.WINDOW),
    "frames": Design("noise_only", (), Fidelity.FRAME),
}
SHARE = {Fidelity.FRAME: 20, Fidelity.WINDOW: 10}  # divisor of the pool for slower fidelities


Coverage = dict[str, dict[str, dict[str, float]]]


def coverage(repeats: int, pool: int, quick: bool) -> dict[str, Any]:
    """Fractions of repeats whose interval contains the truth, by figure, design and number of
    trials."""
    held: Coverage = {}
    below, said = 0.0, True
    for name, design in list(DESIGNS.items())[: 2 if quick else None]:
        first, second = pools(design, pool)
        for count in COUNTS[:2] if quick else COUNTS:
            shares, low, open_ended = repeated(first, second, count, repeats)
            below, said = max(below, low), said and open_ended
            note(held, name, count, shares)
    return {"coverage": held, "missed_low": below, "open_ended_said": int(said)}


def note(held: Coverage, name: str, count: int, shares: dict[str, float]) -> None:
    """Keep and print the fractions of a design and a number."""
    for figure, share in shares.items():
        held.setdefault(figure, {}).setdefault(name, {})[str(count)] = share
    words = ", ".join(f"{figure} {share:.3f}" for figure, share in shares.items())
    print(f"{name}, {count}: {words}", flush=True)


def totals(repeats: int, pool: int, quick: bool) -> dict[str, Any]:
    """As `coverage`, for the total of `budget --montecarlo` over members of several frames.

    Frames of an attitude have common errors: a member is one value.
    """
    held: Coverage = {}
    for name, design in list(DESIGNS.items())[: 1 if quick else 3]:
        case = load_design(shipped(f"designs/{design.file}.toml"), design.changes).case
        members = max(pool // TIMES, 60)
        attitudes = random_attitudes(1, [member for member in range(members) for _ in range(TIMES)])
        rows = run_trials(case, 1, range(members * TIMES), design.fidelity, attitudes)
        error = np.stack([rows[f"error_{axis}"] for axis in "xyz"], axis=-1)
        error[rows["false"]] = np.nan
        error = error.reshape(members, TIMES, 3)
        error = error[np.isfinite(error).all(axis=(1, 2))]
        truth, rng = SkySample(error), np.random.default_rng(1)
        for count in COUNTS[:2] if quick else COUNTS:
            holds = dict.fromkeys(("total across", "total about"), 0)
            for _ in range(repeats):
                drawn = SkySample(error[rng.integers(0, len(error), count)])
                for figure, axes in zip(holds, ((0, 1), (2,)), strict=True):
                    interval = drawn.rms_interval(axes)
                    value = truth.rms_interval(axes).value
                    holds[figure] += interval.low <= value <= interval.high
            note(held, name, count, {figure: many / repeats for figure, many in holds.items()})
    return {"coverage": held}


def pools(design: Design, size: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Solved trials of a design, and the same trials of a design with more blur."""
    made = []
    for changes in (design.changes, (*design.changes, BLUR)):
        case = load_design(shipped(f"designs/{design.file}.toml"), changes).case
        numbers = range(max(size // SHARE.get(design.fidelity, 1), 200))
        made.append(run_trials(case, 1, numbers, design.fidelity))
    both = np.all([rows["solved"] & ~rows["false"] for rows in made], axis=0)
    return made[0][both], made[1][both]


def repeated(
    first: NDArray[Any], second: NDArray[Any], count: int, repeats: int
) -> tuple[dict[str, float], float, bool]:
    """Fraction of repeats that contain the truth of each figure; largest fraction below an rms;
    whether intervals of unbounded levels are open."""
    rng = np.random.default_rng((count, len(first)))
    objective = Objective()
    across, about = objective.squares(first), Objective("about").squares(first)
    other = objective.squares(second)
    sizes = np.sqrt(first["error_x"] ** 2 + first["error_y"] ** 2)
    truth = {
        "rms across": math.sqrt(across.mean()),
        "rms about": math.sqrt(about.mean()),
        "ratio": math.sqrt(across.mean() / other.mean()),
    }
    truth |= {
        f"level {level:g}": float(np.quantile(sizes, level, method="inverted_cdf"))
        for level in LEVELS
    }
    held, below = dict.fromkeys(truth, 0), dict.fromkeys(truth, 0)
    open_ended = True
    for _ in range(repeats):
        chosen = rng.integers(0, len(first), count)
        intervals = {
            "rms across": rms_interval(across[chosen]),
            "rms about": rms_interval(about[chosen]),
            "ratio": objective.ratio([across[chosen]], [other[chosen]]),
        }
        for level in LEVELS:
            intervals[f"level {level:g}"] = interval = level_interval(sizes[chosen], level)
            # The largest of n errors bounds a level with a tail of level^n.
            open_ended &= math.isinf(interval.high) or level**count <= 0.025
        for figure, interval in intervals.items():
            held[figure] += interval.low <= truth[figure] <= interval.high
            below[figure] += interval.high < truth[figure]
    most = max(below["rms across"], below["rms about"]) / repeats
    return {figure: number / repeats for figure, number in held.items()}, most, open_ended
