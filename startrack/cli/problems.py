"""What the commands on campaigns do with a problem that is no star tracker: an Earth camera."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from startrack import optimise
from startrack.cli import terminal
from startrack.cli.campaign import open_workers
from startrack.cli.options import Exit, WrongUse, as_wrong_use
from startrack.core import Rows
from startrack.earth.retrieval import EarthProblem, load_earth_design
from startrack.io import save_json, save_text
from startrack.metrics import Interval, markdown
from startrack.plots import draw_improvement
from startrack.problem import Expectation, Judgement, Margin, Problem, run_problem

# Options of `montecarlo` that a problem takes.
TAKEN = {"design", "--set", "--trials", "--first", "--seed", "--workers", "--out"}
TAKEN |= {"--scheduler", "--tls"}
APART = 1.5  # factor between trials and formula, from which on it is said


def problem_of(path: Path | None, changes: list[str]) -> Problem | None:
    """The problem of a file, or of a shipped scene by its name; None where it is a design.

    Raises  WrongUse where it is a scene without a study.
    """
    if path is None or not terminal.is_scene(path):
        return None
    with as_wrong_use(path=path):
        return EarthProblem(load_earth_design(path, changes))


def refuse_options(given: Iterable[str]) -> None:
    """Refuse options that only trials of star trackers have."""
    if more := [name for name in given if name not in TAKEN]:
        raise WrongUse(f"{', '.join(more)} must be left out for a scene of an Earth camera")


def optimize(options: argparse.Namespace, problem: Problem) -> int:
    """Search a problem; print and write what was found."""
    settings = problem.settings
    with (
        open_workers(options) as executor,
        as_wrong_use(path=options.campaign),
        terminal.progress("forecasts and designs", settings.analytic_evaluations) as advance,
    ):
        known = 0

        def forecasts(count: int) -> None:
            nonlocal known
            advance(count - known)
            known = count

        found = optimise.improve(
            problem,
            options.seed,
            executor if options.workers > 1 or options.scheduler else None,
            watch=lambda design: advance(0, f"tried, {design.trials} trials"),
            watch_forecasts=forecasts,
        )
    table = improved_table(problem, found)
    result = {"out": str(options.out), "seed": options.seed, **improved_values(problem, found)}
    save_text(options.out / "comparison.md", table + "\n")
    save_json(options.out / "result.json", terminal.finite(result))
    save_text(options.out / "best.json", json.dumps(found.best, indent=1) + "\n")
    draw_improvement(options.out / "convergence.png", found, problem.text())
    ending = f"the search ended: {found.ending}; results are in {options.out}"
    terminal.print_result(options, result, f"{table}\n\n{ending}")
    return Exit.DONE if found.feasible else Exit.UNSOLVED


def montecarlo(options: argparse.Namespace, problem: Problem) -> int:
    """Run trials of a problem; print what they show beside the forecast."""
    numbers = range(options.first, options.first + options.trials)
    with (
        open_workers(options) as executor,
        as_wrong_use(path=options.design),
        terminal.progress("trials", len(numbers)) as advance,
    ):
        shared = executor if options.workers > 1 or options.scheduler else None
        rows = run_problem(problem, options.seed, numbers, shared, advance)
    judged, expected = problem.judge(rows), problem.expect()
    words = problem.text()
    lines = [
        [words.value, _shown(judged.value, words.unit), f"{expected.value:.4g}"],
        *(
            [
                words.parts[name][0],
                _shown(part, words.parts[name][1]),
                f"{expected.parts[name]:.4g}",
            ]
            for name, part in judged.parts.items()
        ),
    ]
    head = ["", "by trials", "by formula"]
    costs = problem.costs()
    verdicts = optimise.verdicts(costs, judged)
    table = "\n".join(
        [*markdown(head, lines), "", *_verdict_lines(verdicts, costs, judged), *_left_out(expected)]
    )
    result = {
        "trials": len(rows),
        "value": _interval(judged.value),
        "expected": expected.value,
        "parts": {name: _interval(part) for name, part in judged.parts.items()},
        "verdicts": verdicts,
        "not_counted": list(expected.left_out),
    }
    if options.out:
        save_json(options.out / "summary.json", terminal.finite(result))
        _write_rows(options.out / "trials.csv", rows, numbers)
    terminal.print_result(options, result, table)
    return Exit.DONE


def _write_rows(path: Path, rows: Rows, numbers: range) -> None:
    names = rows.dtype.names or ()
    lines = [",".join(["trial", *(f'"{name}"' for name in names)])]
    for number, row in zip(numbers, rows, strict=True):
        lines.append(",".join([str(number), *(f"{row[name]:.9g}" for name in names)]))
    save_text(path, "\n".join(lines) + "\n")


def _interval(value: Interval) -> list[float]:
    return [value.value, value.low, value.high]


def _shown(value: Interval, unit: str) -> str:
    return f"{value.value:.4g} [{value.low:.4g}, {value.high:.4g}] {unit}".strip()


def improved_table(problem: Problem, found: optimise.Improved) -> str:
    """Start beside best, as Markdown."""
    words, (first, last) = problem.text(), found.judged
    head = ["", "start", "best", f"range within {100 * problem.settings.precision:g} % of the best"]
    spans, lines = found.landscape.spans, list[list[str]]()
    for variable in problem.variables:
        span = spans[variable.name]
        low, high = (variable.shown(variable.value(end)) for end in (span.low, span.high))
        name = variable.name
        values = variable.shown(found.start[name]), variable.shown(found.best[name])
        lines.append([name, *values, f"{low} to {high}"])
    lines.append([words.value, _shown(first.value, words.unit), _shown(last.value, words.unit), ""])
    for name, (title, unit) in words.parts.items():
        lines.append([title, _shown(first.parts[name], unit), _shown(last.parts[name], unit), ""])
    lines.append(["start over best", "", _shown(found.factor, ""), ""])
    more = [f"By formula the best has {found.expected.value:.4g} {words.unit}."]
    if found.apart > APART:
        more.append(
            f"Trials and formula differ by a factor of up to {found.apart:.2g} in the designs that "
            "were tried: where the formula fails, a better design may have been missed."
        )
    if found.landscape.prices:
        limits = ", ".join(
            f"{name} (1 % of it is worth {100 * price:.2g} %)"
            for name, price in found.landscape.prices.items()
        )
        more.append(f"It is limited by {limits}.")
    more.append(
        "Intervals hold 95 %, each alone: of several limits, one may be wrongly met. That of the "
        "ratio takes both designs as independent, which is too wide."
    )
    said = _verdict_lines(found.verdicts, found.costs, last)
    return "\n".join([*markdown(head, lines), "", *said, *more, *_left_out(found.expected)])


def _left_out(expected: Expectation) -> list[str]:
    """What neither trials nor formula know."""
    return [f"Not counted: {'; '.join(expected.left_out)}."] if expected.left_out else []


def _verdict_lines(
    verdicts: Mapping[str, str], costs: Mapping[str, Margin], judged: Judgement
) -> list[str]:
    every = dict(costs) | {name: margins[0] for name, margins in judged.margins.items()}
    return [
        f"{name}: {verdict} ({every[name].value:.4g} {every[name].unit}, "
        f"{'at most' if every[name].most else 'at least'} {every[name].limit:.4g})"
        for name, verdict in verdicts.items()
    ]


def improved_values(problem: Problem, found: optimise.Improved) -> dict[str, Any]:
    """What was found, for JSON."""
    first, last = found.judged
    return {
        "objective": problem.text().value,
        "unit": problem.text().unit,
        "start": _interval(first.value),
        "best": _interval(last.value),
        "factor": _interval(found.factor),
        "expected": found.expected.value,
        "not_counted": list(found.expected.left_out),
        "start_si": found.start,
        "best_si": found.best,
        "verdicts": found.verdicts,
        "prices": found.landscape.prices,
        "forecasts": len(found.landscape.forecasts),
        "evaluations": len(found.evaluations),
        "rounds": found.rounds,
        "trials_over_formula": found.apart,
        "feasible": found.feasible,
        "ending": found.ending,
    }
