"""`startrack budget`: the error of a design cause by cause."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import (
    DESIGN,
    Exit,
    Option,
    Options,
    WrongUse,
    as_wrong_use,
    positive,
    wanted,
    whole,
)

if wanted(__name__):
    from startrack import budget as budgets
    from startrack import metrics, plots
    from startrack.budget import (
        INDICES,
        Budget,
        BudgetLine,
        SkySample,
        Spread,
        Term,
        UnitBudgets,
        analytic,
    )
    from startrack.cli import terminal
    from startrack.cli.not_known import units_over_unknowns
    from startrack.cli.units import (
        AXES,
        budgets_of,
        gains_of,
        require_units,
        units_answer,
        units_text,
    )
    from startrack.core import Refused, arcsec
    from startrack.design import Accuracy, Campaign, Case, found_at, replaced
    from startrack.io import aligned, finite, recalled, save_json
    from startrack.metrics import Interval
    from startrack.montecarlo import pool
    from startrack.optimise import halved, levers
    from startrack.response import TYPICAL, errors, lasting
    from startrack.sequence import Sequence as Profiled
    from startrack.trial import SingleStars

UNITS = 6  # default number of units for a design with variations
MOST_ROWS = 12  # rows of single stars in text; JSON has all
FEW_CAUSES = 3  # largest causes explained without --full
STARS = (
    "single stars, rms per axis: stated by the tracker, noise between exposures, error of the "
    "centroid method, sum, and sum without the few stars that hot pixels displace far"
)
# least relative gain in error, largest loss of availability of a suggestion
MUCH_BETTER, LESS_OFTEN = 0.05, 1e-3
FAR = 0.1  # least relative difference of both columns that is printed


declare = Options(
    "Prints the error with its limits and largest cause, the analytic budget cause by cause, "
    "effects that it does not count, and a check by trials. --full adds single stars, "
    "explanations of causes, improvements, and all levels of units. --montecarlo adds the "
    "measured budget, and a note where both differ by more than 10 %. --out writes budget.json, "
    "budget.png, sky.png (stars and error over the sky) and curves.png (error over rate, "
    "magnitude and field). The status is 3 if a part of the sky has no attitude.",
    *DESIGN,
    Option(
        "--full",
        "print all tables: single stars over magnitude, every cause and its keys, other "
        "centroids and more stars, all levels of the units",
    ),
    Option(
        "--montecarlo N",
        "measure the budget on N random attitudes by switching causes (default: analytic only)",
        whole(1),
    ),
    Option(
        "--times N",
        "with --montecarlo: frames per attitude, to separate constant from varying errors",
        whole(1),
        1,
    ),
    Option(
        "--units N",
        "add classes of error, levels and yield of N units of the design, drawn "
        "from its [[variation]] tables and calibrated, at the begin and the end of its "
        f"lifetime (default: {UNITS} where it has such tables)",
        whole(2),
    ),
    Option(
        "--draws N",
        "draws of unknown values, which give the accuracy an interval; each draw takes a budget "
        "of three units (default: none)",
        whole(0, 10**4),
        0,
    ),
    Option(
        "--tolerances",
        "with --units: gain by halving the scale of each [[variation]], at the end of life "
        "(until version 0.3; then what-matters)",
    ),
    Option(
        "--levers",
        "with --units: gain and cost of a step of each lever, at the end of life (until version "
        "0.3; then what-matters)",
    ),
    Option(
        "--profile PROFILE.toml",
        "simulate sequences along a profile; print absolute, mean, relative and drift errors",
        Path,
    ),
    Option(
        "--sequences N", "with --profile: number of sequences, from random attitudes", whole(1), 8
    ),
    Option("--window SECONDS", "with --profile: time window of the mean errors, s", positive, 1.0),
    shared.SEED,
    shared.WORKERS,
    Option("--out DIR", "folder for budget.json and pictures", Path),
    claims=True,
)


def command(options: argparse.Namespace) -> int:
    """Print each part of the budget when it is known; with --out, write budget.json and then
    pictures."""
    path = options.design or terminal.example()
    design = terminal.read_design(path, options.set)
    case, campaign = design.case, design.campaign
    _check_options(options, case)
    # The profile comes first, because the design may be unable to follow it.
    indices = None
    if options.profile:
        indices = _indices(case, terminal.read_sequence(options.profile), options)
    with terminal.stage("error budget"):
        expected, floor = recalled(_as_designed)(case)
    options.units = options.units or (UNITS if case.varying else None)
    by_trials = _measured(options, case)
    result = dict[str, Any]()
    show = terminal.sections(options)
    required, units = campaign.requirements.accuracy if campaign else (), None
    if options.units:
        result["units"], units = budgets_of(case, required, options)
    show(budgets.answer(expected, required) if units is None else units_answer(units, required))
    for sentence in budgets.refusal(case, expected.refused):  # reasons for a large error
        show(sentence)
    star, sentence = _typical_star(case, floor)
    result |= star
    alone = "the unit as designed, noise only\n" if units else ""
    show(f"{alone}{_table(expected, by_trials)}\n{sentence}")
    if units:
        show(units_text(result["units"], options.full))
    show("\n".join(budgets.advice(expected)[: None if options.full else FEW_CAUSES]))
    if options.full:
        result |= _in_full(case, expected, show)
    result |= _trials_beside(options, case, expected, show)
    if by_trials:
        result |= {"seed": options.seed, "measured": _values(by_trials)}
        result |= {"members": options.montecarlo, "times": options.times}
    result |= _gains(options, case, campaign, show)
    if indices:
        result["indices"], lines = indices
        show(lines)
    if design.unknowns and options.draws:
        result["not_known"], sentences = units_over_unknowns(options, path)
        show("\n".join(sentences))
    _save(options, {"design": str(path), "analytic": _values(expected)} | result)
    if options.out:
        _draw(options, case, Path(path).stem, expected, by_trials, required, units)
    availability = (by_trials or expected).availability
    return Exit.DONE if availability > 0.9999 else Exit.UNSOLVED


def _save(options: argparse.Namespace, result: dict[str, Any]) -> None:
    """Write budget.json with --out; print the result with --json."""
    if options.out:
        save_json(options.out / "budget.json", finite(result))
        result["out"] = str(options.out)
    if options.json:
        terminal.print_result(options, result)


def _check_options(options: argparse.Namespace, case: Case) -> None:
    """Refuse options that do not fit the design; report options that will be removed."""
    if options.tolerances and not (options.units and case.variation):
        raise WrongUse("--tolerances needs --units and a design with [[variation]] tables")
    if options.levers and not options.units:
        raise WrongUse("--levers needs --units")
    if options.levers or options.tolerances:
        terminal.print_message(
            "startrack: levers and tolerances are part of startrack what-matters; the options of "
            "budget work until version 0.3"
        )
    if options.units:
        with as_wrong_use():
            require_units(case)


def _as_designed(case: Case) -> tuple[Budget[Any], float]:
    """Budget by the formula, and centroid error (pixel) of a typical star without noise."""
    return analytic(case), float(lasting(errors(case)))


def _measured(options: argparse.Namespace, case: Case) -> Budget[SkySample] | None:
    """The measured budget of --montecarlo, by switching causes in trials."""
    members = options.montecarlo
    if not members:
        return None
    with pool(options.workers) as executor, terminal.progress("members", members) as advance:
        return budgets.measured(
            case, members, options.seed, executor, options.times, options.workers, advance
        )


def _trials_beside(
    options: argparse.Namespace, case: Case, expected: Budget[Any], show: Callable[[str], None]
) -> dict[str, Any]:
    """Print effects that the budget does not count, and a check by trials. Returns their values for
    JSON."""
    with terminal.stage("trials beside the formula"):
        checked = recalled(_check)(case, options.seed, expected=expected)
    show("\n".join([*budgets.caveats(case, expected.left_out), *_checked(checked, expected)]))
    check = {"fidelity": checked.fidelity.value, "differs": checked.differs}
    return {
        "not_counted": expected.left_out,
        "refused_as_hot_pixels": expected.refused,
        "check": check | metrics.to_json(metrics.summary_rows(checked.summary)),
    }


def _check(case: Case, seed: int, *, expected: Budget[Any]) -> budgets.TrialCheck:
    return budgets.check(case, expected, seed)


def _gains(
    options: argparse.Namespace, case: Case, campaign: Campaign | None, show: Callable[[str], None]
) -> dict[str, Any]:
    """Print the results of --tolerances and --levers. Returns their values for JSON."""
    values = dict[str, Any]()
    for name, changes in (("tolerances", halved), ("levers", levers)):
        if getattr(options, name):
            values[name], lines = gains_of(
                case, campaign or Campaign(), list(changes(case)), options
            )
            show(lines)
    return values


def _typical_star(case: Case, floor: float) -> tuple[dict[str, Any], str]:
    """Centroid error (pixel) of a typical star without noise: for JSON, and as text."""
    stated = case.tracker.attitude.centroid_floor
    assumed = "this, star by star" if stated is None else f"{stated:g} pixel for all stars"
    values = {"star_without_noise_px": floor, "centroid_floor_px": stated}
    return values | {"star_without_noise_g": TYPICAL}, (
        f"centroid error of a star of G {TYPICAL:g} without noise {floor:.4f} pixel; the tracker "
        f"assumes {assumed}"
    )


def _in_full(case: Case, expected: Budget[Any], show: Callable[[str], None]) -> dict[str, Any]:
    """Print single stars over magnitude, and improvements. Returns their values for JSON."""
    with terminal.stage("single stars over magnitude"):
        stars = _star_table(case, budgets.single_stars(case))
    # Only a few rows in text.
    shown = replace(stars, records=stars.records[:: 1 + len(stars.records) // MOST_ROWS])
    show("\n".join([STARS, *shown.text(())]))
    with terminal.stage("other centroids, more stars"):
        gains, better = _better(case, expected)
    show("\n".join(better or ["neither another centroid nor twice as many stars is better"]))
    return {"single_stars": stars.json(), "better": gains}


def _draw(
    options: argparse.Namespace,
    case: Case,
    title: str,
    expected: Budget[Any],
    by_trials: Budget[Any] | None,
    required: Sequence[Accuracy],
    units: UnitBudgets | None,
) -> None:
    """Write budget.png, sky.png and curves.png."""
    plots.draw_budget(options.out / "budget.png", expected, by_trials, title, required, units)
    with terminal.stage("the sky"):
        plots.draw_sky(options.out / "sky.png", budgets.survey(case), case, title)
    with terminal.progress("slew rates and stars", budgets.curve_steps(case)) as advance:
        curves = budgets.error_curves(case, options.seed, advance=advance)
    plots.draw_curves(options.out / "curves.png", curves, case, title)


def _better(case: Case, expected: Budget[Any]) -> tuple[list[dict[str, Any]], list[str]]:
    """Another centroid, and twice the number of stars, if they reduce the error by the formula."""
    detection, gains, lines = case.tracker.detection, list[dict[str, Any]](), list[str]()
    other = "likelihood" if detection.centroid != "likelihood" else "gravity"
    for name, value in (("centroid", other), ("max_spots", 2 * detection.max_spots)):
        key = f"tracker.detection.{name}"
        try:
            changed = analytic(replaced(case, key, value))
        except Refused:  # another method has other limits
            continue
        across, about = (error / arcsec for error in changed.sum)
        as_often = changed.availability > expected.availability - LESS_OFTEN
        if as_often and changed.sum[0] < (1 - MUCH_BETTER) * expected.sum[0]:
            gains.append(
                {"key": key, "value": value, "across_arcsec": across, "about_arcsec": about}
            )
            lines.append(
                f"better: {key} = {value!r} instead of {found_at(case, key)!r}, by the formula "
                f"{across:.3f} arcsec across, {about:.3f} about"
            )
    return gains, lines


def _star_table(case: Case, stars: SingleStars) -> metrics.Table:
    """Errors of single stars, a row for each magnitude."""
    pixel = 1 / case.instrument.camera.focal_length_px

    def column(name: str, title: str) -> metrics.Column:
        values = getattr(stars, name) * pixel
        return metrics.Column(name, title, lambda row: float(values[row]), metrics.ARCSEC, ".4f")

    return metrics.Table(
        [
            metrics.Column("magnitude_g", "G", lambda row: float(stars.magnitude[row]), form=".1f"),
            metrics.Column("measured", "measured", lambda row: float(stars.measured[row])),
            column("stated", "stated"),
            column("temporal", "in time"),
            column("method", "method"),
            column("total", "in all"),
            column("usual", "usual"),
        ],
        range(len(stars.magnitude)),
    )


def _checked(checked: budgets.TrialCheck, expected: Budget[Any]) -> list[str]:
    """Results of the check by trials, one line each."""
    doubt = [checked.summary.doubt, budgets.unseen(expected)] if checked.summary.doubt else []
    trials = f"{checked.summary.trials} trials ({checked.fidelity})"
    if not checked.differs:
        return [*doubt, f"{trials} agree with the formula"]
    return [*doubt, *(f"FORMULA AND TRIALS DIFFER: {difference}" for difference in checked.differs)]


def _values(budget: Budget[Any]) -> dict[str, Any]:
    """A budget for JSON, arcsecond per axis; a level is not exceeded in the given fraction of
    cases."""
    simulated = hasattr(budget.whole.spread, "error")
    many = simulated and budget.whole.spread.error.shape[1] > 1
    ways = tuple(metrics.Interpretation) if many else (metrics.Interpretation.MIXED,)
    return {
        "causes": {line.name: _line(line, ways) for line in budget.lines},
        "terms": {term.value: _pair(budget.term(term)) for term in Term},
        "sum": _pair(budget.sum),
        "end to end": _line(budget.whole, ways) | _bounds(budget.whole.spread),
        "availability": budget.availability,
        "stars": budget.stars,
    }


def _bounds(spread: Spread) -> dict[str, Any]:
    """Intervals of simulated values, for JSON."""
    if not isinstance(spread, SkySample):
        return {}
    bounds = {name: spread.rms_interval(axes) for name, axes in AXES.items()}
    return {
        f"{name}_95": [interval.low / arcsec, interval.high / arcsec]
        for name, interval in bounds.items()
    }


def _pair(errors: Iterable[float]) -> dict[str, float]:
    """Values across and about (radian) for JSON."""
    return {name: error / arcsec for name, error in zip(AXES, errors, strict=True)}


def _line(line: BudgetLine[Spread], ways: Iterable[metrics.Interpretation]) -> dict[str, Any]:
    values: dict[str, Any] = {} if line.term is None else {"term": line.term.value}
    name = getattr(line, "name", "")
    values |= {"advice": budgets.ADVICE[name]} if name in budgets.ADVICE else {}
    values |= _pair((line.across, line.about))
    values["levels"] = {
        way.value: {
            f"{100 * fraction:g} %": _pair(_levels(line.spread, fraction, way))
            for fraction in metrics.LEVELS
        }
        for way in ways
    }
    return values


def _levels(spread: Spread, fraction: float, way: metrics.Interpretation) -> list[float]:
    return [spread.level(axes, fraction, way) for axes in AXES.values()]


def _table(expected: Budget[Any], by_trials: Budget[Any] | None) -> str:
    """A row for each cause, analytic and measured."""
    both = [budget for budget in (expected, by_trials) if budget]
    head = ["measured", "", ""] if by_trials else []
    rows = [["arcsec rms per axis", "term", "across", "about", *head]]

    def add(
        name: str, term: str, pairs: Iterable[Iterable[float | Interval] | None], note: str = ""
    ) -> None:
        cells = [
            cell
            for pair in pairs
            for cell in ([_cell(value) for value in pair] if pair else ["", ""])
        ]
        rows.append([name, term, *cells, *([note] if by_trials else [])])

    named = {line.name: line for line in expected.lines}
    beside = {line.name: line for line in by_trials.lines} if by_trials else {}
    for name in dict.fromkeys([*named, *beside]):
        line, other = named.get(name), beside.get(name)
        term = next(cause.term.value if cause.term else "" for cause in (line, other) if cause)
        pairs = [(cause.across, cause.about) if cause else None for cause in (line, other)]
        add(name, term, pairs[: len(both)], _difference(line, other, by_trials))
    add("root sum square", "", [budget.sum for budget in both])
    add(
        "end to end",
        "",
        [_rms_of(budget.whole) for budget in both],
        _difference(expected.whole, by_trials.whole if by_trials else None, by_trials),
    )
    for fraction in metrics.LEVELS:
        levels = [_bounded_levels(budget.whole.spread, fraction) for budget in both]
        add(f"  {100 * fraction:g} % below", "", levels)
    available = [f"{100 * budget.availability:.2f} %, {budget.stars:.1f} stars" for budget in both]
    lines = [*aligned(rows, (0, 1)), "", f"available  {' | measured '.join(available)}"]
    return "\n".join([*lines, *(_open_ended(by_trials) if by_trials else [])])


def _cell(value: float | Interval) -> str:
    if isinstance(value, Interval):
        return metrics.bracketed(value, ".3f", arcsec)
    return f"{value / arcsec:.3f}"


def _rms_of(line: BudgetLine[Spread]) -> list[float | Interval]:
    """Rms across and about, with intervals of simulated values."""
    if isinstance(line.spread, SkySample):
        return [line.spread.rms_interval(axes) for axes in AXES.values()]
    return [line.across, line.about]


def _bounded_levels(spread: Spread, fraction: float) -> list[float | Interval]:
    """Mixed levels across and about; values from trials have intervals."""
    if isinstance(spread, SkySample):
        return [spread.level_interval(axes, fraction) for axes in AXES.values()]
    return [*_levels(spread, fraction, metrics.Interpretation.MIXED)]


def _open_ended(by_trials: Budget[SkySample]) -> list[str]:
    """Explanation of the brackets, and the levels without bounds because of too few members."""
    members = len(by_trials.whole.spread.error)
    needed = {fraction: metrics.trials_for_level(fraction) for fraction in metrics.LEVELS}
    unbounded = [
        f"{members} members bound no level of {100 * fraction:g} %; {count} would"
        for fraction, count in needed.items()
        if count > members
    ]
    return ["brackets: 95 %", *unbounded]


def _difference(
    line: BudgetLine[Any] | None, other: BudgetLine[Any] | None, by_trials: Budget[Any] | None
) -> str:
    """Difference of both columns if it is large; small causes may differ."""
    if not (line and other and by_trials):
        return ""
    off = [
        abs(a - b) / b
        for a, b, end_to_end in (
            (line.across, other.across, by_trials.across),
            (line.about, other.about, by_trials.about),
        )
        if max(a, b) > FAR * end_to_end
    ]
    return f"differs by {100 * max(off):.0f} %" if max(off, default=0) > FAR else ""


def _indices(
    case: Case, sequence: Profiled, options: argparse.Namespace
) -> tuple[dict[str, Any], str]:
    """The error indices of sequences along a profile: values for JSON, and a table."""
    count, window, ways = options.sequences, options.window, tuple(metrics.Interpretation)
    with (
        pool(min(options.workers, count)) as executor,
        terminal.progress("sequences", count) as advance,
    ):
        lines = budgets.indices_of(case, sequence, count, options.seed, window, executor, advance)
    indices = {name: _line(line, ways) for name, line in lines.items()}
    rows = [
        [
            name,
            axis,
            f"{values[axis]:.3f}",
            *(f"{values['levels'][way.value]['99.73 %'][axis]:.3f}" for way in ways),
            INDICES[name] if axis == "across" else "",
        ]
        for name, values in indices.items()
        for axis in AXES
    ]
    head = (
        f"{options.profile}, {count} sequences, windows of {window:g} s; arcsec per axis: rms, and "
        "99.73 % as temporal, ensemble, mixed"
    )
    return indices, "\n".join([head, *aligned(rows, (0, 1, 6))])
