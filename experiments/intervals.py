"""Do intervals have their stated coverage, and are ends of searches confirmed by trials?

    python experiments/intervals.py [--parts coverage totals units oracles searches]
        [--repeats N] [--pool N] [--units N] [--designs NAME ...] [--seeds N] [--first N]
        [--peers N] [--trials N] [--ends FILE] [--json FILE] [--quick]

Repeats with different numbers of trials are drawn from a pool of a design's trials, whose
statistics are the truth:

coverage          fraction of repeats whose 95 % interval contains the truth, by figure, design and
                  number of trials: rms across and about, levels of 95 and 99.73 % across, and the
                  ratio of the rms across to a second design on the same skies; the total of `budget
                  --montecarlo`; over units, by their number, the level of 95 % of the units, the
                  factor between two designs, and yields
coverage_least, coverage_most  over all designs and numbers, for an rms, a ratio, a total
coverage_over_units_least  for the figures over units, whose intervals may be conservative
missed_low        largest fraction of repeats whose interval of an rms is below the truth:
                  optimistic errors
open_ended_said   1 if every interval of a level without an upper bound by its trials is open above
sobol_error       largest difference of Sobol indices from those of SALib, on the same function
rare_ratio        a probability of 1e-3 by importance sampling, over the result of OpenTURNS
posterior_error   difference between emcee and a grid: means and deviations, in standard deviations
feasible_ends, regret, optimize_s  fraction of ends of complete searches that meet all limits by
                  fresh trials, their excess over the best known design, and seconds, by design
search_peers      ends of other searches with the same number of forecasts, without trials
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import command
import intervals_coverage
import intervals_oracles
import intervals_searches
import intervals_units

PARTS = ("coverage", "totals", "units", "oracles", "searches")
CLOSED = ("rms across", "rms about", "ratio", "total across", "total about")
OVER_UNITS = ("unit level", "unit factor", "yield", "yield of verify")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, metavar="PART")
    parser.add_argument(
        "--repeats", type=int, default=2000, help="number of repeats for each number of trials"
    )
    parser.add_argument(
        "--pool", type=int, default=20_000, help="number of trials in the pool of each design"
    )
    parser.add_argument(
        "--units", type=int, default=300, help="number of units in each pool of units"
    )
    designs = intervals_searches.DESIGNS
    parser.add_argument("--designs", nargs="+", choices=designs, default=designs, metavar="NAME")
    parser.add_argument("--seeds", type=int, default=20, help="number of searches of each design")
    parser.add_argument("--first", type=int, default=1, help="seed of the first search")
    parser.add_argument(
        "--peers", type=int, default=5, help="number of seeds of each other optimiser"
    )
    parser.add_argument(
        "--trials", type=int, default=2000, help="number of fresh trials that judge each result"
    )
    parser.add_argument("--ends", type=Path, default=Path("search-ends.jsonl"))
    options = command.read(
        parser,
        parts=PARTS[:4],
        repeats=50,
        pool=200,
        units=4,
        designs=designs[:1],
        seeds=1,
        peers=1,
        trials=20,
        ends=None,
    )
    parts: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
        "coverage": lambda asked: intervals_coverage.coverage(
            asked.repeats, asked.pool, asked.quick
        ),
        "totals": lambda asked: intervals_coverage.totals(asked.repeats, asked.pool, asked.quick),
        "units": lambda asked: intervals_units.unit_coverage(
            asked.repeats // 2, asked.units, asked.quick
        ),
        "oracles": lambda asked: intervals_oracles.oracles(asked.quick),
        "searches": intervals_searches.searches,
    }
    figures: dict[str, Any] = {"coverage": {}}
    for part in options.parts:
        found = parts[part](options)
        figures["coverage"] |= found.pop("coverage", {})
        figures |= found
    if closed := shares_of(figures["coverage"], CLOSED):
        figures |= {"coverage_least": min(closed), "coverage_most": max(closed)}
    if over := shares_of(figures["coverage"], OVER_UNITS):
        figures["coverage_over_units_least"] = min(over)
    command.save(options, figures, partial=set(options.parts) != set(PARTS))


def shares_of(coverage: intervals_coverage.Coverage, names: Sequence[str]) -> list[float]:
    """Fractions for some figures, over all designs and numbers."""
    return [
        share
        for name in names
        for shares in coverage.get(name, {}).values()
        for share in shares.values()
    ]


if __name__ == "__main__":
    command.run(main)
