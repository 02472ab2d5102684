"""`startrack budget`: the error of a design cause by cause."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from startrack.cli import options as shared
from startrack.cli.options import DESIGN, Exit, Option, Options, WrongUse, positive, wanted, whole

if wanted(__name__):
    import numpy as np

    from startrack import metrics
    from startrack.budget import (
        ADVICE,
        INDICES,
        Budget,
        Check,
        Line,
        Spread,
        Term,
        advice,
        analytic,
        caveats,
        check,
        curve_steps,
        error_curves,
        indices_of,
        measured,
        refusal,
        single_stars,
        survey,
        unseen,
    )
    from startrack.cli import terminal
    from startrack.cli.units import budgets_of, gains_of
    from startrack.core import Refused, arcsec
    from startrack.design import Campaign, Case, found_at, replaced
    from startrack.io import aligned, save_json
    from startrack.montecarlo import pool
    from startrack.optimise import halved, levers
    from startrack.plots import draw_budget, draw_curves, draw_sky
    from startrack.sequence import Sequence
    from startrack.trial import TYPICAL, SingleStars, errors, lasting

Pair = tuple[float, float]  # across, about
UNITS = 6  # where a design varies and no number is asked for
MOST_ROWS = 12  # of single stars in text; JSON has all
STARS = (
    "single stars, rms per axis: as the tracker states, from exposure to exposure, by the centroid "
    "method, in all, and without the few that hot pixels move far"
)
MUCH_BETTER, LESS_OFTEN = 0.05, 1e-3  # relative error and availability of what is suggested
FAR = 0.1  # relative difference of the two columns from which on it is printed


declare = Options(
    "Prints the analytic budget, what of this design it does not count, and whether some trials "
    "agree with it; with --montecarlo also the measured one, and a note where the two differ by "
    "more than 10 %. With --out it writes budget.json, budget.png, sky.png (stars and error over "
    "the sky) and curves.png (error over rate, magnitude and field). The status is 3 if a part of "
    "the sky has no attitude.",
    *DESIGN,
    Option("--montecarlo N", "measure it on N random attitudes by switching causes (default: "
           "analytic only)", whole(1)),
    Option("--times N", "with --montecarlo: frames per attitude, to separate constant from "
           "varying errors", whole(1), 1),
    Option("--units N", "add classes of error, levels and yield of N units of the design, drawn "
           "from its [[variation]] tables and calibrated, at the begin and the end of its "
           f"lifetime (default: {UNITS} where it has such tables)", whole(2)),
    Option("--tolerances", "with --units: what halving the scale of each [[variation]] buys at "
           "the end of life, the one that buys most first"),
    Option("--levers", "with --units: what a step of each lever buys and costs at the end of life "
           "(tracked stars, catalogue, calibration, causes of the residual, structure, lens), the "
           "one that buys most first"),
    Option("--profile PROFILE.toml", "simulate sequences along a profile; print absolute, mean, "
           "relative and drift errors", Path),
    Option("--sequences N", "with --profile: number of sequences, from random attitudes", whole(1),
           8),
    Option("--window SECONDS", "with --profile: time window of the mean errors, s", positive, 1.0),
    shared.SEED,
    shared.WORKERS,
    Option("--out DIR", "folder for budget.json and pictures", Path),
    claims=True,
)  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Print the budget; with --out, write budget.json and pictures."""
    path = options.design or terminal.example()
    design = terminal.read_design(path, options.set)
    case, campaign = design.case, design.campaign
    if options.tolerances and not (options.units and case.variation):
        raise WrongUse("--tolerances needs --units and a design with [[variation]] tables")
    if options.levers and not options.units:
        raise WrongUse("--levers needs --units")
    # First, as a profile may ask for what the design cannot do.
    indices = None
    if options.profile:
        indices = _indices(case, terminal.read_sequence(options.profile), options)
    with terminal.stage("error budget"):
        expected = analytic(case)
    options.units = options.units or (UNITS if case.varying else None)
    by_trials = _measured(case, options) if options.montecarlo else None
    result: dict[str, Any] = {"design": str(path), "analytic": _values(expected)}
    with terminal.stage("single stars"):
        floor, stated = float(lasting(errors(case))), case.tracker.attitude.centroid_floor
    result |= {"star_without_noise_px": floor, "centroid_floor_px": stated}
    result |= {"star_without_noise_g": TYPICAL}
    assumed = "this, star by star" if stated is None else f"{stated:g} pixel for all stars"
    with terminal.stage("single stars over magnitude"):
        stars = _star_table(case, single_stars(case))
    result["single_stars"] = stars.json()
    with terminal.stage("other centroids, more stars"):
        better = result["better"] = _better(case, expected)
    with terminal.stage("trials beside the formula"):
        checked = check(case, expected, options.seed)
    result |= {"not_counted": expected.left_out, "refused_as_hot_pixels": expected.refused}
    result["check"] = {"fidelity": checked.fidelity.value, "differs": checked.differs}
    result["check"] |= metrics.to_json(metrics.summary_rows(checked.summary))
    alone = "the unit as designed, noise only; units follow\n" if options.units else ""
    text = [
        *refusal(case, expected.refused),  # why the error below is large comes first
        f"{alone}{_table(expected, by_trials)}\n"
        f"centroid error of a star of G {TYPICAL:g} without noise {floor:.4f} pixel; the tracker "
        f"assumes {assumed}",
        "\n".join([STARS, *_shown(stars).text(())]),
        "\n".join([*advice(expected), *(_better_text(change, case) for change in better)]),
        "\n".join([*caveats(case, expected.left_out), *_checked(checked, expected)]),
    ]
    if by_trials:
        result |= {"seed": options.seed, "measured": _values(by_trials)}
        result |= {"members": options.montecarlo, "times": options.times}
    required, units = campaign.requirements.accuracy if campaign else (), None
    if options.units:
        result["units"], lines, units = budgets_of(case, required, options)
        text.append(lines)
    if options.tolerances:
        changes = list(halved(case))
        result["tolerances"], lines = gains_of(case, campaign or Campaign(), changes, options)
        text.append(lines)
    if options.levers:
        changes = list(levers(case))
        result["levers"], lines = gains_of(case, campaign or Campaign(), changes, options)
        text.append(lines)
    if indices:
        result["indices"] = indices
        text.append(_index_table(indices, options))
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        picture = options.out / "budget.png"
        draw_budget(picture, expected, by_trials, Path(path).stem, required, units)
        with terminal.stage("the sky"):
            draw_sky(options.out / "sky.png", survey(case), case, Path(path).stem)
        with terminal.progress("slew rates and stars", curve_steps(case)) as advance:
            curves = error_curves(case, options.seed, advance=advance)
        draw_curves(options.out / "curves.png", curves, case, Path(path).stem)
        save_json(options.out / "budget.json", terminal.finite(result))
        result["out"] = str(options.out)
    terminal.print_result(options, result, "\n\n".join(text))
    availability = (by_trials or expected).availability
    return Exit.DONE if availability > 0.9999 else Exit.UNSOLVED


def _better(case: Case, expected: Budget[Any]) -> list[dict[str, Any]]:
    """The other centroid, and twice as many stars, where they lower the error by the formula."""
    detection, gains = case.tracker.detection, list[dict[str, Any]]()
    other = "likelihood" if detection.centroid != "likelihood" else "gravity"
    for name, value in (("centroid", other), ("max_spots", 2 * detection.max_spots)):
        key = f"tracker.detection.{name}"
        try:
            budget = analytic(replaced(case, key, value))
        except Refused:  # another method has limits of its own
            continue
        across, about = budget.sum
        as_often = budget.availability > expected.availability - LESS_OFTEN
        if as_often and across < (1 - MUCH_BETTER) * expected.sum[0]:
            gains.append({
                "key": key, "value": value, "across_arcsec": across / arcsec,
                "about_arcsec": about / arcsec,
            })  # fmt: skip
    return gains


def _better_text(better: dict[str, Any], case: Case) -> str:
    key, value = better["key"], better["value"]
    return (
        f"better: {key} = {value!r} instead of {found_at(case, key)!r}, by the formula "
        f"{better['across_arcsec']:.3f} arcsec across, {better['about_arcsec']:.3f} about"
    )


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


def _shown(table: metrics.Table) -> metrics.Table:
    """Not more rows than are read at a glance."""
    return replace(table, records=table.records[:: 1 + len(table.records) // MOST_ROWS])


def _checked(checked: Check, expected: Budget[Any]) -> list[str]:
    """What the check by trials says, a line each."""
    doubt = [checked.summary.doubt, unseen(expected)] if checked.summary.doubt else []
    trials = f"{checked.summary.trials} trials ({checked.fidelity})"
    if not checked.differs:
        return [*doubt, f"{trials} agree with the formula"]
    return [*doubt, *(f"FORMULA AND TRIALS DIFFER: {difference}" for difference in checked.differs)]


def _measured(case: Case, options: argparse.Namespace) -> Budget[Any]:
    with (
        pool(options.workers) as executor,
        terminal.progress("members", options.montecarlo) as advance,
    ):
        return measured(
            case, options.montecarlo, options.seed, executor, options.times, options.workers,
            advance,
        )  # fmt: skip


def _indices(case: Case, sequence: Sequence, options: argparse.Namespace) -> dict[str, Any]:
    count, window = options.sequences, options.window
    with (
        pool(min(options.workers, count)) as executor,
        terminal.progress("sequences", count) as advance,
    ):
        lines = indices_of(case, sequence, count, options.seed, window, executor, advance)
    return {name: _line(line, tuple(metrics.Interpretation)) for name, line in lines.items()}


def _values(budget: Budget[Any]) -> dict[str, Any]:
    """A budget for JSON, arcsecond per axis; levels are not exceeded in that fraction of cases."""
    simulated = hasattr(budget.whole.spread, "error")
    many = simulated and budget.whole.spread.error.shape[1] > 1
    ways = tuple(metrics.Interpretation) if many else (metrics.Interpretation.MIXED,)
    across, about = budget.sum
    return {
        "causes": {line.name: _line(line, ways) for line in budget.lines},
        "terms": {
            term.value: dict(
                zip(("across", "about"), np.array(budget.term(term)) / arcsec, strict=True)
            )
            for term in Term
        },
        "sum": {"across": across / arcsec, "about": about / arcsec},
        "end to end": _line(budget.whole, ways),
        "availability": budget.availability,
        "stars": budget.stars,
    }


def _line(line: Line[Spread], ways: Iterable[metrics.Interpretation]) -> dict[str, Any]:
    values: dict[str, Any] = {} if line.term is None else {"term": line.term.value}
    name = getattr(line, "name", "")
    values |= {"advice": ADVICE[name]} if name in ADVICE else {}
    values |= {"across": line.across / arcsec, "about": line.about / arcsec}
    values["levels"] = {
        way.value: {
            f"{100 * fraction:g} %": {
                "across": line.spread.level((0, 1), fraction, way) / arcsec,
                "about": line.spread.level((2,), fraction, way) / arcsec,
            }
            for fraction in metrics.LEVELS
        }
        for way in ways
    }
    return values


def _table(expected: Budget[Any], by_trials: Budget[Any] | None) -> str:
    """A row for each cause, analytic beside measured."""
    both = [budget for budget in (expected, by_trials) if budget]
    measured_head = ["measured", "", ""] if by_trials else []
    rows = [["arcsec rms per axis", "term", "across", "about", *measured_head]]

    def add(name: str, term: str, pairs: Iterable[Pair | None], note: str = "") -> None:
        cells = [cell for pair in pairs for cell in _cells(pair)]
        rows.append([name, term, *cells, *([note] if by_trials else [])])

    named = {line.name: line for line in expected.lines}
    beside = {line.name: line for line in by_trials.lines} if by_trials else {}
    for name in dict.fromkeys([*named, *beside]):
        line, other = named.get(name), beside.get(name)
        term = next(cause.term.value if cause.term else "" for cause in (line, other) if cause)
        pairs = [(cause.across, cause.about) if cause else None for cause in (line, other)]
        add(name, term, pairs[: len(both)], _difference(line, other, by_trials))
    add("root sum square", "", [budget.sum for budget in both])
    add("end to end", "", [(budget.whole.across, budget.whole.about) for budget in both],
        _difference(expected.whole, by_trials.whole if by_trials else None, by_trials))  # fmt: skip
    for fraction in metrics.LEVELS:
        add(f"  {100 * fraction:g} % below", "", [_levels(budget, fraction) for budget in both])
    available = [f"{100 * budget.availability:.2f} %, {budget.stars:.1f} stars" for budget in both]
    return "\n".join([*aligned(rows, (0, 1)), "", f"available  {' | measured '.join(available)}"])


def _cells(pair: Pair | None) -> list[str]:
    return [f"{value / arcsec:.3f}" for value in pair] if pair else ["", ""]


def _levels(budget: Budget[Any], fraction: float) -> Pair:
    spread = budget.whole.spread
    across, about = (
        spread.level(axes, fraction, metrics.Interpretation.MIXED) for axes in ((0, 1), (2,))
    )
    return across, about


def _difference(
    line: Line[Any] | None, other: Line[Any] | None, by_trials: Budget[Any] | None
) -> str:
    """By how much the two differ, where that is much; a cause that is a small part may differ."""
    if not (line and other and by_trials):
        return ""
    off = [
        abs(a - b) / b
        for a, b, end_to_end in (
            (line.across, other.across, by_trials.across),
            (line.about, other.about, by_trials.about),
        )
        if max(a, b) > FAR * end_to_end
    ]  # fmt: skip
    return f"differs by {100 * max(off):.0f} %" if max(off, default=0) > FAR else ""


def _index_table(indices: dict[str, Any], options: argparse.Namespace) -> str:
    rows = [
        [
            name, axis, f"{values[axis]:.3f}",
            *(
                f"{values['levels'][way.value]['99.73 %'][axis]:.3f}"
                for way in metrics.Interpretation
            ),
            INDICES[name] if axis == "across" else "",
        ]
        for name, values in indices.items()
        for axis in ("across", "about")
    ]  # fmt: skip
    head = (
        f"{options.profile}, {options.sequences} sequences, windows of {options.window:g} s; "
        "arcsec per axis: rms, and 99.73 % as temporal, ensemble, mixed"
    )
    return "\n".join([head, *aligned(rows, (0, 1, 6))])
