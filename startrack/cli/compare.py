"""`startrack compare`: two designs or campaigns side by side."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from startrack.cli import options as shared
from startrack.cli.not_known import AXES, DRAWS
from startrack.cli.options import Exit, Option, Options, WrongUse, fidelity, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack.cli.files import found_file
    from startrack.cli.not_known import draws_of, lost_text, over_unknowns, written
    from startrack.cli.terminal import print_result, progress, read_design
    from startrack.core import Rows
    from startrack.design import Campaign, Case, Fidelity
    from startrack.io import aligned, to_table
    from startrack.metrics import (
        ARCSEC,
        PERCENT,
        PURE,
        STATED_ALONE,
        Column,
        Table,
        trials_for_level,
        units_of,
    )
    from startrack.montecarlo import Difference as Found
    from startrack.montecarlo import Sampling, Store, differences, pool, run, warm
    from startrack.problem import ratios_answer

AVAILABILITY = "availability"
CHANGE = "second / first"
LEVEL = 0.9973  # level of the compared errors
WIDEST = 40  # largest number of letters of a value in the table of parameters


class ComparedSide(NamedTuple):
    """One side of the comparison: a design, or a campaign with its trials.

    outcomes  None for a design, whose trials are run by the command
    drawn     source of attitudes and noise: seed, kind of attitudes, and trials of each unit
    """

    case: Case
    campaign: Campaign | None
    outcomes: Rows | None
    drawn: tuple[int, str, int] | None


declare = Options(
    "Prints the parameters in which two designs differ, and their errors and availability side "
    "by side, with the ratio of the errors, the difference of the availability, and their 95 % "
    "intervals. Trials of the same seed have the same skies and noise. The ratios are then "
    "paired, with smaller intervals than the errors.",
    Option("first FIRST", "design file, or store of `montecarlo` (.sqlite)", Path),
    Option("second SECOND", "design file, or store of `montecarlo` (.sqlite)", Path),
    Option(
        "--trials N", "trials of each design file; campaigns use all trials", whole(2, 10**8), 200
    ),
    *shared.SET,
    DRAWS,
    fidelity("fidelity of the trials of design files (default: frame); see montecarlo"),
    shared.SEED,
    shared.WORKERS,
    problems=True,
)


def command(options: argparse.Namespace) -> int:
    """Print both side by side."""
    first, second = (_read(path, options.set) for path in (options.first, options.second))
    if (first.outcomes is None) != (second.outcomes is None):
        raise WrongUse("FIRST and SECOND must both be design files, or both campaigns")
    paired = first.drawn == second.drawn
    of_designs = first.outcomes is None
    tables = _trials(first, second, options) if of_designs else _common(first, second, paired)
    limits = tuple(
        side.campaign.requirements.limits if side.campaign else STATED_ALONE
        for side in (first, second)
    )
    statistics = differences(*tables, (limits[0], limits[1]), paired)
    changed = _changed(to_table(first.case), to_table(second.case))
    result = {
        "first": str(options.first),
        "second": str(options.second),
        "paired": paired,
        "trials": [*map(len, tables)],
        "parameters": {name: list(pair) for name, pair in changed.items()},
        "statistics": {difference.name: _row(difference).json()[0] for difference in statistics},
    }
    text = _text(options, changed, statistics, paired, tables)
    if of_designs:
        more, lines = _over_unknowns(options, statistics)
        result |= more
        text += [*lines, *_left_out({options.first: first, options.second: second})]
    print_result(options, result, *text)
    return Exit.DONE


def _read(path: Path, changes: list[str]) -> ComparedSide:
    with shared.as_wrong_use():
        path = found_file(path)
    if path.suffix == ".toml":
        design = read_design(path, changes)
        return ComparedSide(design.case, design.campaign, None, None)
    if changes:
        raise WrongUse(f"--set must be given with design files alone, got {path}")
    with shared.as_wrong_use(), Store(path) as store:
        sampling = store.sampling
        outcomes = store.outcomes()
        drawn = store.seed, sampling.attitudes, sampling.units.trials
        if not len(outcomes):
            raise WrongUse(f"{path} must hold trials, but holds none")
        return ComparedSide(store.case, store.campaign, outcomes, drawn)


def _trials(
    first: ComparedSide, second: ComparedSide, options: argparse.Namespace
) -> tuple[Rows, Rows]:
    """The same trials of two designs."""
    fidelity, made = Fidelity(options.fidelity), []
    for side in (first, second):
        warm(side.case, Sampling(fidelity))
    with pool(options.workers) as executor, progress("trials", 2 * options.trials) as advance:
        for side in (first, second):
            made.append(
                run(
                    side.case,
                    options.trials,
                    options.seed,
                    executor,
                    0,
                    options.workers,
                    advance,
                    fidelity,
                )
            )
    return made[0], made[1]


def _over_unknowns(
    options: argparse.Namespace, statistics: list[Found]
) -> tuple[dict[str, Any], list[str]]:
    """The ratios of errors over the unknown values of the designs: values for JSON, and lines.

    Unknowns of the same name have the same quantiles in both.
    """
    paths = options.first, options.second
    drawn = {str(path): draws for path in paths if (draws := draws_of(options, path))}
    if not drawn:
        return {}, []
    factors = [
        drawn[str(path)].factors if str(path) in drawn else np.ones((options.draws, 2))
        for path in paths
    ]
    ratios = [difference.change.value for difference in statistics[:2]]
    found = over_unknowns(ratios, factors[1] / factors[0])
    values = {"draws": options.draws, "unknowns": {n: d.unknowns for n, d in drawn.items()}}
    lines = [f"over the unknown values, {CHANGE} of the rms:"]
    for axis in AXES:
        if not found:
            continue
        least, most = found[axis]["95"]
        shown = least > 1 or most < 1
        better = "" if shown else "; the better design is not shown"
        lines.append(f"  {axis}: {written(found[axis])}{better}")
        values[axis] = found[axis] | {"shown": shown}
    lost = "".join(f"; of {name}{lost_text(one)}" for name, one in drawn.items() if one.lost)
    lines.append(
        f" {options.draws} draws, common to values of the same name in both, by the ratio above "
        f"and the formula{lost}"
    )
    return {"not_known": values}, lines


def _left_out(sides: Mapping[Path, ComparedSide]) -> Iterator[str]:
    """A sentence on designs whose units differ."""
    names = [path.stem for path, side in sides.items() if side.case.differs]
    if names:
        yield (
            f"noise only: what differs between the units of {' and '.join(names)} is left out; "
            "stores of startrack montecarlo --units N have it"
        )


def _common(first: ComparedSide, second: ComparedSide, paired: bool) -> tuple[Rows, Rows]:
    """The trials of two campaigns; for paired campaigns, only trials with the same numbers."""
    assert first.outcomes is not None
    assert second.outcomes is not None
    if not paired:
        return first.outcomes, second.outcomes
    both, a, b = np.intersect1d(
        first.outcomes["trial"], second.outcomes["trial"], return_indices=True
    )
    if not len(both):
        raise WrongUse("FIRST and SECOND must have trials of the same numbers")
    return first.outcomes[a], second.outcomes[b]


def _changed(first: Any, other: Any, place: str = "") -> dict[str, tuple[str, str]]:
    """The parameters that differ between two tables, and their values."""
    if isinstance(first, dict) and isinstance(other, dict):
        changed = dict[str, tuple[str, str]]()
        for key in dict.fromkeys([*first, *other]):
            inner = f"{place}.{key}" if place else key
            changed |= _changed(first.get(key), other.get(key), inner)
        return changed
    return {} if first == other else {place: (_short(first), _short(other))}


def _short(value: Any) -> str:
    text = "none" if value is None else str(value)
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 3]}..."


def _row(difference: Found) -> Table:
    """A statistic of both sides, and its difference."""
    fraction = difference.name == AVAILABILITY
    unit = PERCENT if fraction else ARCSEC
    change = (
        Column("difference", CHANGE, lambda row: row.change, unit, "+.3g")
        if fraction
        else Column("ratio", CHANGE, lambda row: row.change, PURE, ".4g")
    )
    return Table(
        [
            Column("", "statistic", lambda _: f"{difference.name} ({unit.name})"),
            Column("first", "first", lambda row: row.first, unit, ".4g"),
            Column("second", "second", lambda row: row.second, unit, ".4g"),
            change,
        ],
        [difference],
    )


def _text(
    options: argparse.Namespace,
    changed: dict[str, tuple[str, str]],
    statistics: list[Found],
    paired: bool,
    tables: tuple[Rows, Rows],
) -> list[str]:
    trials = len(tables[0]), len(tables[1])
    names = str(options.first), str(options.second)
    rows = [["", *names, CHANGE]]
    rows += [_row(difference).cells[0] for difference in statistics]
    rows += [[name, *pair, ""] for name, pair in changed.items()]
    how = (
        f"on the same skies and noise in {trials[0]} trials; errors of trials that both solved"
        if paired
        else f"on different skies: {trials[0]} and {trials[1]} trials"
    )
    lines = [f"{CHANGE}: of errors, {how}; of the availability, second minus first; brackets: 95 %"]
    open_ended = [
        found.name for found in statistics if found.change.value and math.isinf(found.change.high)
    ]
    if any(units_of(table) is not None for table in tables):
        lines.append("trials of units count as one value of each unit, and bound no level")
    elif open_ended:
        needed = trials_for_level(LEVEL)
        few, level = min(trials), 100 * LEVEL
        lines.append(f"{few} trials bound no level of {level:g} %; {needed} with an attitude would")
    ratios = dict(zip(AXES, (found.change for found in statistics), strict=False))
    return [ratios_answer(names, ratios), "", *aligned(rows), "", *lines]
