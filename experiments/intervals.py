"""Do intervals hold what they promise, of few trials and of many?

    python experiments/intervals.py [--repeats N] [--pool N] [--json FILE] [--quick]

Trials of a design are drawn from a pool of its trials, whose statistics are then the truth, by the
thousand and in small numbers:

coverage          share of repeats in which the 95 % interval holds the truth, by figure, design and
                  number of trials: rms across and about, levels of 95 and 99.73 % across, and the
                  ratio of the rms across to that of a second design on the same skies
coverage_least, coverage_most  of an rms and a ratio over all designs and numbers of trials
missed_low        share of repeats whose interval lies below the truth, the most of an rms: errors
                  that look better than they are
open_ended_said   1 where every interval of a level that its trials cannot bound is open above
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import math
from typing import Any, NamedTuple

import command
import numpy as np
from numpy.typing import NDArray

from startrack import Fidelity, load_design, run_trials, shipped
from startrack.design import Objective
from startrack.metrics import level_interval, rms_interval

COUNTS = (20, 50, 200, 1000)
LEVELS = (0.95, 0.9973)
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
SHARE = {Fidelity.FRAME: 20, Fidelity.WINDOW: 10}  # of the pool, one part of slower fidelities


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=2000, help="of each number of trials")
    parser.add_argument("--pool", type=int, default=20_000, help="trials of each design")
    options = command.read(parser, repeats=50, pool=200)
    designs = dict(list(DESIGNS.items())[: 2 if options.quick else None])
    coverage: dict[str, dict[str, dict[str, float]]] = {}
    below, said = 0.0, True
    for name, design in designs.items():
        first, second = pools(design, options.pool)
        for count in COUNTS[:2] if options.quick else COUNTS:
            held, low, open_ended = repeated(first, second, count, options.repeats)
            below, said = max(below, low), said and open_ended
            for figure, share in held.items():
                coverage.setdefault(figure, {}).setdefault(name, {})[str(count)] = share
            words = ", ".join(f"{figure} {share:.3f}" for figure, share in held.items())
            print(f"{name}, {count} trials: {words}", flush=True)
    closed = [
        share
        for figure in ("rms across", "rms about", "ratio")
        for shares in coverage[figure].values()
        for share in shares.values()
    ]
    figures = {
        "coverage": coverage,
        "coverage_least": min(closed),
        "coverage_most": max(closed),
        "missed_low": below,
        "open_ended_said": int(said),
    }
    command.save(options, figures)


def pools(design: Design, size: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Solved trials of a design, and the same trials of one with more blur."""
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
    """Share of repeats that hold the truth of each figure; the most that lie below an rms; whether
    intervals of levels that are not bounded are open."""
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


if __name__ == "__main__":
    command.run(main)
