"""The commands on campaigns for problems other than star trackers: scenes, moving objects."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from startrack import optimise, plots, verification
from startrack.cli import pareto, sample, solve_for, terminal, what_matters
from startrack.cli.campaign import LEDGER, open_workers, stages
from startrack.cli.files import SCENE, SEARCH, STUDIES, kind_of
from startrack.cli.optimize import LOG
from startrack.cli.options import Exit, WrongUse, as_wrong_use
from startrack.core import Rows
from startrack.earth.retrieval import EarthProblem, load_earth_design
from startrack.io import aligned, finite, save_csv, save_json, save_text
from startrack.metrics import Interval, markdown
from startrack.moving import MovingProblem, load_moving_design
from startrack.optimise import Evaluation, Foresight
from startrack.problem import (
    Judgement,
    Margin,
    Problem,
    Words,
    beside_forecast,
    compare_problems,
    ratios_answer,
    require_one_objective,
    with_interval,
)
from startrack.report import write_problem_report

# Options for star trackers that a problem does not accept, by command.
REFUSED = {
    "montecarlo": (
        *("--fidelity", "--sobol", "--control", "--units", "--environments", "--age", "--table"),
        *("--store", "--precision", "--statistic", "--confidence", "--seconds", "--log"),
        "--sketch",
    ),
    "verify": ("--fidelity", "--units"),
    "compare": ("--fidelity",),
    "what-matters": ("--units",),
    "sweep": ("--fidelity",),
    "solve-for": ("--fidelity",),
    "report": ("--stars", "--slews", "--budget", "--fidelity-trials", "--worst", "--conditions"),
}
# Commands with a ledger in their folder.
FOLDERS = (
    *("optimize", "montecarlo", "verify", "sample", "what-matters", "pareto", "sweep"),
    "solve-for",
)
DESIGNS = 32  # designs for the sensitivities of a page
TRACKER = "a design of a star tracker"
APART = 1.5  # least reported factor between trials and formula
Command = Callable[[argparse.Namespace], int]


def command_of(options: argparse.Namespace, given: Iterable[str]) -> Command | None:
    """The action of a command on the given scenes of Earth cameras.

    given   names of the given options
    Returns None for other files
    Raises  WrongUse for options that only star trackers accept.
    """
    names = ("first", "second") if options.name == "compare" else ("campaign", "design")
    paths = [path for name in names if (path := getattr(options, name, None)) is not None]
    if options.name not in STUDIES or not any(kind_of(path) in (SCENE, SEARCH) for path in paths):
        return None
    if more := [name for name in given if name in REFUSED.get(options.name, ())]:
        raise WrongUse(
            f"{', '.join(more)} must be left out for a scene of an Earth camera or a search for "
            "moving objects"
        )
    kinds = dict(zip(paths, map(kind_of, paths), strict=True))
    if len(set(kinds.values())) > 1:
        words = (f"{path} is {kind.words if kind else TRACKER}" for path, kind in kinds.items())
        raise WrongUse(f"designs must be of one kind, but {' and '.join(words)}")
    study = ACTIONS[options.name]
    problems = [problem_of(path, getattr(options, "set", [])) for path in paths]
    return lambda options: study(options, *problems)


def problem_of(path: Path, changes: list[str]) -> Problem:
    """The problem of a file, or of a shipped file by name.

    Raises  WrongUse if the file is not a problem, or is a scene without a study.
    """
    with as_wrong_use(path=path):
        return _load(path, changes)


def _load(path: Path, changes: Sequence[str]) -> Problem:
    if kind_of(path) is SEARCH:
        return MovingProblem(load_moving_design(path, list(changes)))
    return EarthProblem(load_earth_design(path, changes))


@contextmanager
def opened(options: argparse.Namespace, problem: Problem) -> Iterator[optimise.ProblemSource]:
    """Workers and the ledger in the folder of --out, from which the same command continues."""
    path = getattr(options, "campaign", None) or getattr(options, "design", None)
    folder: Path | None = options.out if options.name in FOLDERS else None
    options.scheduler = getattr(options, "scheduler", None)
    options.tls = getattr(options, "tls", None)
    with open_workers(options) as executor, as_wrong_use(path=path):
        shared = executor if options.workers > 1 or options.scheduler else None
        with optimise.Ledger(folder / LEDGER if folder else None) as ledger:
            yield optimise.ProblemSource(problem, options.seed, shared, ledger)


def optimize(options: argparse.Namespace, problem: Problem) -> int:
    """Search a problem; print and write the result."""
    settings = problem.settings
    with (
        opened(options, problem) as source,
        terminal.progress("forecasts and designs", settings.analytic_evaluations) as advance,
        optimise.SearchLog(options.out / LOG, 1.0) as log,
    ):

        def forecast(values: Mapping[str, float], foresight: Foresight) -> None:
            log.forecast(values, foresight)
            advance(1)

        def tried(design: Evaluation) -> None:
            log.tried(design)
            advance(0, f"tried, {design.trials} trials")

        found = optimise.improve(
            problem,
            options.seed,
            source.executor,
            source.ledger,
            watch=tried,
            watch_forecast=forecast,
        )
    table = improved_table(problem, found)
    result = {"out": str(options.out), "seed": options.seed, **improved_values(problem, found)}
    save_text(options.out / "comparison.md", table + "\n")
    save_json(options.out / "result.json", finite(result))
    save_text(options.out / "best.json", json.dumps(found.best, indent=1) + "\n")
    plots.draw_improvement(options.out / "convergence.png", found, problem.text())
    ending = f"the search ended: {found.ending}; results are in {options.out}"
    terminal.print_result(options, result, f"{table}\n\n{ending}")
    return Exit.DONE if found.feasible else Exit.UNSOLVED


def montecarlo(options: argparse.Namespace, problem: Problem) -> int:
    """Run trials of a problem; print their results and the forecast."""
    numbers = range(options.first, options.first + options.trials)
    with opened(options, problem) as source, terminal.progress("trials", len(numbers)) as advance:
        rows = source.rows(problem, len(numbers), options.first, advance)
    judged, expected = problem.judge(rows), problem.expect()
    costs = problem.costs()
    verdicts = optimise.verdicts(costs, judged)
    lines = beside_forecast(problem.text(), judged, expected)
    head = ["", "by trials", "by formula"]
    table = "\n".join(
        [
            _answer(lines[0], len(rows), verdicts),
            "",
            *markdown(head, lines),
            "",
            *_verdict_lines(verdicts, costs, judged),
            *_not_counted(expected.left_out),
        ]
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
        save_json(options.out / "summary.json", finite(result))
        _write_rows(options.out / "trials.csv", rows, numbers)
    terminal.print_result(options, result, table)
    return Exit.DONE


def _answer(objective: Sequence[str], trials: int, verdicts: Mapping[str, str]) -> str:
    """The objective by trials beside the formula, and how many requirements are met.

    objective  name, value by trials, value by formula, in words
    """
    name, tried, formula = objective
    answer = f"{name} {tried} in {trials} trials, {formula} by formula"
    if not verdicts:
        return answer
    others = [f"{name}: {verdict}" for name, verdict in verdicts.items() if verdict != "met"]
    answer += f"; {len(verdicts) - len(others)} of {len(verdicts)} requirements met"
    return answer + (f" ({', '.join(others)})" if others else "")


def verify(options: argparse.Namespace, problem: Problem) -> int:
    """Judge each limit of a problem; print the verdicts and, with --out, write them."""
    with as_wrong_use():
        looks = verification.Looks(min(options.first, options.trials), options.trials)
    with opened(options, problem) as source, terminal.progress("trials", looks.most) as advance:
        verified = verification.verify_problem(
            problem,
            lambda count: source.rows(problem, count, optimise.VERIFYING, advance),
            looks,
            lambda number: advance(0, f"{number} trials"),
        )
    table = verification.problem_verdict_table(verified)
    lines = [
        f"verdict: {verified.answer.in_capitals}",
        "",
        *table.text((0, 1)),
        "",
        *dict.fromkeys(row.note for row in verified.verdicts if row.note),
        f"{looks.words}, within the accuracy of intervals. Values are in SI; margins are "
        "fractions of the limits.",
        *_not_counted(problem.expect().left_out),
    ]
    text, result = "\n".join(lines), {"design": str(options.campaign), "seed": options.seed}
    result |= verification.verification_values(verified, table)
    if options.out:
        save_text(options.out / "verdict.md", f"```\n{text}\n```\n")
        save_json(options.out / "verdict.json", finite(result))
        result["out"] = str(options.out)
    terminal.print_result(options, result, text)
    passed = verified.answer is verification.Answer.PASS
    return Exit.DONE if passed else Exit.UNSOLVED


def sample_around(options: argparse.Namespace, problem: Problem) -> int:
    """Print the tolerance of each variable, and write it."""
    with opened(options, problem) as source:
        count = optimise.designs_needed(len(source.variables))
        with terminal.progress("designs", count) as advance:
            tolerance = optimise.sample(source, advance)
    return sample.write_tolerance(
        options, tolerance, {"limit": tolerance.limit, "unit": source.unit.name}
    )


def forecast_what_matters(options: argparse.Namespace, problem: Problem) -> int:
    """Print and write the sensitivities of the objective and the margins, by forecast."""
    with opened(options, problem) as source:
        found = what_matters.forecast(options, source)
        region = what_matters.sampled_region(source) if options.full else None
    words = problem.text()
    return what_matters.write_what_matters(options, source, found, words.value, region=region)


def trade_off(options: argparse.Namespace, problem: Problem) -> int:
    """Print and write the Pareto front of two goals."""
    first = optimise.OBJECTIVE if options.first == pareto.FIRST else options.first
    second = options.second
    if second == pareto.SECOND:
        costs = problem.costs().items()
        second = next((name for name, margin in costs if margin.most), second)
    with opened(options, problem) as source, stages("trading off") as show:
        goals = optimise.ProblemGoals(problem, first, second)
        points = optimise.problem_front(source, goals, options.points, options.method, show)
    named = goals.first, goals.second
    return pareto.write_front(
        options,
        points,
        named,
        [goals.title(goal) for goal in named],
        [goals.unit(goal) for goal in named],
        [source.shown(np.array(point.coordinates)) for point in points],
        list(source.labels().values()),
        problem.settings.most_trials,
    )


def sweep_keys(options: argparse.Namespace, problem: Problem) -> int:
    """Print the objective and the margins at each value of one or two keys, and write them."""
    with as_wrong_use():
        count = optimise.swept_designs(options.keys, options.points)
    with opened(options, problem) as source, terminal.progress("designs", count) as advance:
        swept = optimise.sweep_problem(
            lambda changes: _load(options.design, [*options.set, *changes]),
            options.keys,
            source,
            options.points,
            options.log,
            options.trials,
            advance,
        )
    table = swept.columns
    save_csv(options.out / "sweep.csv", *optimise.csv_of(table))
    plots.draw_problem_sweep(options.out / "sweep.png", swept, options.design.stem)
    result: dict[str, Any] = {"design": str(options.design), "out": str(options.out)}
    result |= {"seed": options.seed, "by": swept.how, "rows": table.json()}
    result |= {"answer": swept.answer, "not_counted": list(swept.left_out)}
    save_json(options.out / "result.json", finite(result))
    refused = [f"{', '.join(row.values)}: {row.note}" for row in swept.rows if row.note]
    text = [swept.answer, "", *table.text(), "", *refused, *_not_counted(swept.left_out)]
    text.append(f"by {swept.how}")
    terminal.print_result(options, result, *text, f"results are in {options.out}")
    return Exit.UNSOLVED if refused else Exit.DONE


def solve_for_margin(options: argparse.Namespace, problem: Problem) -> int:
    """Print the values of a key at which a margin is zero, and write them."""
    with (
        opened(options, problem) as source,
        terminal.progress("designs", options.points) as advance,
    ):
        solution = optimise.solve_problem_for(
            lambda changes: _load(options.design, [*options.set, *changes]),
            options.key,
            options.until,
            source,
            options.points,
            options.log,
            options.trials,
            advance,
            lambda value: advance(0, f"trials at {value}"),
        )
    return solve_for.write_solution(options, solution, options.design)


def compare(options: argparse.Namespace, first: Problem, second: Problem) -> int:
    """Print two problems side by side, on the same trials."""
    rows = []
    with as_wrong_use():
        require_one_objective((first, second))
    with terminal.progress("trials", 2 * options.trials) as advance:
        for problem in (first, second):
            with opened(options, problem) as source:
                rows.append(source.rows(problem, options.trials, 0, advance))
    with as_wrong_use():
        found = compare_problems((first, second), (rows[0], rows[1]), options.seed)
    head = ["", str(options.first), str(options.second), "second / first"]
    lines = [
        [
            f"{row.name} ({row.unit})" if row.unit else row.name,
            f"{row.first:.4g}",
            f"{row.second:.4g}",
            with_interval(row.ratio, ""),
        ]
        for row in found
    ]
    told = f"on the same {options.trials} trials; brackets: 95 %, by a paired bootstrap"
    result = {
        "first": str(options.first),
        "second": str(options.second),
        "trials": options.trials,
        "statistics": {
            row.name: {"first": row.first, "second": row.second, "ratio": _interval(row.ratio)}
            for row in found
        },
    }
    names = str(options.first), str(options.second)
    answer = ratios_answer(names, {row.name: row.ratio for row in found[:1]})
    terminal.print_result(options, result, answer, "", *aligned([head, *lines]), "", told)
    return Exit.DONE


def report(options: argparse.Namespace, problem: Problem) -> int:
    """Write the page of a problem."""
    path = options.out or Path(f"{options.campaign.stem}.html")
    count = options.trials
    with opened(options, problem) as source, terminal.progress("trials", count) as advance:
        rows = source.rows(problem, count, 0, advance)
        studied = optimise.sensitivities(source, DESIGNS) if problem.variables else []
    title = options.title or f"{options.campaign.stem}: {problem.text().value}"
    html = write_problem_report(problem, rows, studied, title, options.author)
    save_text(path, html)
    size = len(html.encode())
    result = {"report": str(path), "trials": count, "bytes": size}
    terminal.print_result(options, result, f"{path}: {count} trials, {size / 1e6:.1f} MB")
    return Exit.DONE


# Each takes the problems of the command's files.
ACTIONS: dict[str, Callable[..., int]] = {
    "optimize": optimize,
    "montecarlo": montecarlo,
    "verify": verify,
    "sample": sample_around,
    "what-matters": forecast_what_matters,
    "sweep": sweep_keys,
    "solve-for": solve_for_margin,
    "pareto": trade_off,
    "compare": compare,
    "report": report,
}


def _write_rows(path: Path, rows: Rows, numbers: range) -> None:
    names = rows.dtype.names or ()
    lines = [",".join(["trial", *(f'"{name}"' for name in names)])]
    for number, row in zip(numbers, rows, strict=True):
        lines.append(",".join([str(number), *(f"{row[name]:.9g}" for name in names)]))
    save_text(path, "\n".join(lines) + "\n")


def _interval(value: Interval) -> list[float]:
    return [value.value, value.low, value.high]


def improved_table(problem: Problem, found: optimise.Improved) -> str:
    """Start and best design, as Markdown."""
    words, (first, last) = problem.text(), found.judged
    head = ["", "start", "best", f"range within {100 * problem.settings.precision:g} % of the best"]
    spans, lines = found.landscape.spans, list[list[str]]()
    for variable in problem.variables:
        span = spans[variable.name]
        low, high = (variable.shown(variable.value(end)) for end in (span.low, span.high))
        name = variable.name
        values = variable.shown(found.start[name]), variable.shown(found.best[name])
        lines.append([name, *values, f"{low} to {high}"])
    lines.append(
        [
            words.value,
            with_interval(first.value, words.unit),
            with_interval(last.value, words.unit),
            "",
        ]
    )
    for name, (title, unit) in words.parts.items():
        lines.append(
            [
                title,
                with_interval(first.parts[name], unit),
                with_interval(last.parts[name], unit),
                "",
            ]
        )
    lines.append(["start over best", "", with_interval(found.factor, ""), ""])
    formula = f"{found.expected.value:.4g} {words.unit}".strip()
    more = [f"By formula the best has {formula}."]
    if found.apart > APART:
        more.append(
            f"Trials and formula differ by a factor of up to {found.apart:.2g} in tried designs: "
            "the search may have missed a better design where the formula fails."
        )
    if found.landscape.prices:
        limits = ", ".join(
            f"{name} (1 % of it is worth {100 * price:.2g} %)"
            for name, price in found.landscape.prices.items()
        )
        more.append(f"It is limited by {limits}.")
    more.append(
        "Each interval has 95 % confidence: among several limits, one may be met by chance. The "
        "interval of the ratio is by a paired bootstrap: start and best have the same trials."
    )
    said = _verdict_lines(found.verdicts, found.costs, last)
    return "\n".join(
        [
            _improved_answer(words, found),
            "",
            *markdown(head, lines),
            "",
            *said,
            *more,
            *_not_counted(found.expected.left_out),
        ]
    )


def _improved_answer(words: Words, found: optimise.Improved) -> str:
    """Improvement of the objective, and the limits that are not met."""
    first, last = (with_interval(judged.value, words.unit) for judged in found.judged)
    gain = f"Better by a factor of {with_interval(found.factor, '')} in the {words.value}"
    text = f"{gain}: {last} instead of {first}."
    if found.start == found.best:
        text = f"No design is better than the start: {words.value} {last}."
    short = [f"{name} {verdict}" for name, verdict in found.verdicts.items() if verdict != "met"]
    return f"{text} {'; '.join(short) or 'All limits are met'}."


def _not_counted(left_out: Sequence[str]) -> list[str]:
    """Sentence on effects that formulas or trials leave out."""
    return [f"Not counted: {'; '.join(left_out)}."] if left_out else []


def _verdict_lines(
    verdicts: Mapping[str, str], costs: Mapping[str, Margin], judged: Judgement
) -> list[str]:
    every = dict(costs) | {name: margins[0] for name, margins in judged.margins.items()}
    return [f"{name}: {verdict} ({every[name].text})" for name, verdict in verdicts.items()]


def improved_values(problem: Problem, found: optimise.Improved) -> dict[str, Any]:
    """Result of the search, for JSON."""
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
