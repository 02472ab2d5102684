"""`startrack budget`: the error of a design cause by cause."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import (
    Exit,
    WrongUse,
    add_design,
    add_seed,
    add_workers,
    describe,
    positive,
    whole,
)

if wanted(__name__):
    import numpy as np

    from startrack.budget import (
        INDICES,
        Budget,
        Check,
        Line,
        Spread,
        Term,
        analytic,
        caveats,
        check,
        indices_of,
        measured,
        survey,
    )
    from startrack.cli.terminal import (
        example,
        finite,
        print_result,
        progress,
        read_design,
        read_sequence,
        summary_values,
    )
    from startrack.cli.units import budgets_of, tolerances_of
    from startrack.core import arcsec
    from startrack.design import Case
    from startrack.io import save_json
    from startrack.metrics import LEVELS, Interpretation
    from startrack.montecarlo import pool
    from startrack.plots import draw_budget, draw_curves, draw_sky, rates_drawn
    from startrack.sequence import Sequence
    from startrack.trial import TYPICAL, errors, lasting

UNITS = 6  # where a design varies and no number is asked for
FAR = 0.1  # relative difference of the two columns from which on it is printed


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack budget`."""
    describe(
        parser,
        "Prints the analytic budget, what of this design it does not count, and whether some "
        "trials agree with it; with --montecarlo also the measured one, and a note where "
        "the two differ by more than 10 %. With --out it writes budget.json, budget.png, sky.png "
        "(stars and error over the sky) and curves.png (error over rate, magnitude and field). "
        "The status is 3 if a part of the sky has no attitude.",
    )
    parser.set_defaults(claims=True)
    add_design(parser)
    parser.add_argument(
        "--montecarlo", type=whole(1), metavar="N",
        help="measure it on N random attitudes by switching causes (default: analytic only)",
    )  # fmt: skip
    parser.add_argument(
        "--times", type=whole(1), default=1, metavar="N",
        help="with --montecarlo: frames per attitude, to separate constant from varying errors "
        "(default: 1)",
    )  # fmt: skip
    parser.add_argument(
        "--units", type=whole(2), metavar="N",
        help="add classes of error, levels and yield of N units of the design, drawn from its "
        "[[variation]] tables and calibrated, at the begin and the end of its lifetime (default: "
        f"{UNITS} where it has such tables)",
    )  # fmt: skip
    parser.add_argument(
        "--tolerances", action="store_true",
        help="with --units: what halving the scale of each [[variation]] buys at the end of life, "
        "the one that buys most first",
    )  # fmt: skip
    parser.add_argument(
        "--profile", type=Path, metavar="PROFILE.toml",
        help="simulate sequences along a profile; print absolute, mean, relative and drift errors",
    )  # fmt: skip
    parser.add_argument(
        "--sequences", type=whole(1), default=8, metavar="N",
        help="with --profile: number of sequences, from random attitudes (default: 8)",
    )  # fmt: skip
    parser.add_argument(
        "--window", type=positive, default=1.0, metavar="SECONDS",
        help="with --profile: time window of the mean errors, s (default: 1)",
    )  # fmt: skip
    add_seed(parser)
    add_workers(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for budget.json and pictures"
    )


def command(options: argparse.Namespace) -> int:
    """Print the budget; with --out, write budget.json and pictures."""
    path = options.design or example()
    design = read_design(path, options.set)
    case, campaign = design.case, design.campaign
    if options.tolerances and not (options.units and case.variation):
        raise WrongUse("--tolerances needs --units and a design with [[variation]] tables")
    sequence = read_sequence(options.profile) if options.profile else None
    expected = analytic(case)
    options.units = options.units or (UNITS if case.variation else None)
    found = _measured(case, options) if options.montecarlo else None
    result: dict[str, Any] = {"design": str(path), "analytic": _values(expected)}
    floor, stated = float(lasting(errors(case))), case.tracker.attitude.centroid_floor
    result |= {"star_without_noise_px": floor, "centroid_floor_px": stated}
    result |= {"star_without_noise_g": TYPICAL}
    assumed = "this, star by star" if stated is None else f"{stated:g} pixel for all stars"
    checked = check(case, expected, options.seed)
    result |= {"not_counted": expected.left_out, "refused_as_hot_pixels": expected.refused}
    result["check"] = {"fidelity": checked.fidelity.value, "differs": checked.differs}
    result["check"] |= summary_values(checked.summary)
    alone = "the unit as designed, noise only; units follow\n" if options.units else ""
    text = [
        f"{alone}{_table(expected, found)}\n"
        f"centroid error of a star of G {TYPICAL:g} without noise {floor:.4f} pixel; the tracker "
        f"assumes {assumed}",
        "\n".join([*caveats(case, expected.left_out, expected.refused), *_checked(checked)]),
    ]
    if found:
        result |= {"seed": options.seed, "measured": _values(found)}
        result |= {"members": options.montecarlo, "times": options.times}
    if options.units:
        required = campaign.requirements.accuracy if campaign else ()
        result["units"], lines = budgets_of(case, required, options)
        text.append(lines)
    if options.tolerances:
        result["tolerances"], lines = tolerances_of(case, campaign, options)
        text.append(lines)
    if sequence:
        result["indices"] = _indices(case, sequence, options)
        text.append(_index_table(result["indices"], options))
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        required = campaign.requirements.accuracy if campaign else ()
        draw_budget(options.out / "budget.png", expected, found, Path(path).stem, required)
        draw_sky(options.out / "sky.png", survey(case), case, Path(path).stem)
        with progress("slew rates", rates_drawn(case)) as advance:
            draw_curves(options.out / "curves.png", case, options.seed, Path(path).stem,
                        advance=advance)  # fmt: skip
        save_json(options.out / "budget.json", finite(result))
        result["out"] = str(options.out)
    print_result(options, result, "\n\n".join(text))
    whole = (found or expected).availability
    return Exit.DONE if whole > 0.9999 else Exit.UNSOLVED


def _checked(found: Check) -> list[str]:
    """What the check by trials says, a line each."""
    doubt = [found.summary.doubt] if found.summary.doubt else []
    trials = f"{found.summary.trials} trials ({found.fidelity})"
    if not found.differs:
        return [*doubt, f"{trials} agree with the formula"]
    return [*doubt, *(f"FORMULA AND TRIALS DIFFER: {one}" for one in found.differs)]


def _measured(case: Case, options: argparse.Namespace) -> Budget[Any]:
    with (
        pool(options.workers) as executor,
        progress("members", options.montecarlo) as advance,
    ):
        return measured(
            case, options.montecarlo, options.seed, executor, options.times, options.workers,
            advance,
        )  # fmt: skip


def _indices(case: Case, sequence: Sequence, options: argparse.Namespace) -> dict[str, Any]:
    count, window = options.sequences, options.window
    with pool(min(options.workers, count)) as executor, progress("sequences", count) as advance:
        found = indices_of(case, sequence, count, options.seed, window, executor, advance)
    return {name: _line(line, tuple(Interpretation)) for name, line in found.items()}


def _values(budget: Budget[Any]) -> dict[str, Any]:
    """A budget for JSON, arcsecond per axis; levels are not exceeded in that fraction of cases."""
    simulated = hasattr(budget.whole.spread, "error")
    many = simulated and budget.whole.spread.error.shape[1] > 1
    ways = tuple(Interpretation) if many else (Interpretation.MIXED,)
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


def _line(line: Line[Spread], ways: Iterable[Interpretation]) -> dict[str, Any]:
    values: dict[str, Any] = {} if line.term is None else {"term": line.term.value}
    values |= {"across": line.across / arcsec, "about": line.about / arcsec}
    values["levels"] = {
        way.value: {
            f"{100 * fraction:g} %": {
                "across": line.spread.level((0, 1), fraction, way) / arcsec,
                "about": line.spread.level((2,), fraction, way) / arcsec,
            }
            for fraction in LEVELS
        }
        for way in ways
    }
    return values


def _table(expected: Budget[Any], found: Budget[Any] | None) -> str:
    """One line per cause, analytic beside measured."""
    beside = {line.name: line for line in found.lines} if found else {}
    head = f"{'arcsec rms per axis':<20}{'term':<18}{'across':>9}{'about':>9}"
    if found:
        head += f"   {'measured':>9}{'':>9}"
    rows = [head]
    named = {line.name: line for line in expected.lines}
    for name in [*named, *(name for name in beside if name not in named)]:
        rows.append(_row(named.get(name), beside.get(name), found))
    rows.append("-" * len(head))
    rows.append(_pair("root sum square", "", expected.sum, found.sum if found else None))
    rows.append(_row(expected.whole, found.whole if found else None, found))
    for fraction in LEVELS:
        sizes = [_levels(one, fraction) for one in (expected, found) if one]
        rows.append(_pair(f"  {100 * fraction:g} % below", "", *sizes))
    rows.append("")
    available = [
        f"{100 * one.availability:.2f} %, {one.stars:.1f} stars" for one in (expected, found) if one
    ]
    rows.append(f"available{'':<11}{' | measured '.join(available)}")
    return "\n".join(rows)


def _levels(budget: Budget[Any], fraction: float) -> tuple[float, float]:
    spread = budget.whole.spread
    across, about = (spread.level(axes, fraction, Interpretation.MIXED) for axes in ((0, 1), (2,)))
    return across, about


def _row(line: Line[Any] | None, other: Line[Any] | None, found: Budget[Any] | None) -> str:
    known = line or other
    assert known
    here = (line.across, line.about) if line else None
    there = (other.across, other.about) if other else None
    row = _pair(known.name, known.term.value if known.term else "", here, there)
    if here and there and found:
        # A cause that is a small part of the whole may differ.
        off = [
            abs(a - b) / b
            for a, b, all_ in zip(here, there, (found.across, found.about), strict=True)
            if max(a, b) > FAR * all_
        ]
        if max(off, default=0) > FAR:
            row += f"   differs by {100 * max(off):.0f} %"
    return row


def _pair(
    name: str, term: str, here: tuple[float, float] | None, there: tuple[float, float] | None = None
) -> str:
    row = f"{name:<20}{term:<18}"
    row += "".join(f"{value / arcsec:9.3f}" for value in here) if here else f"{'':>18}"
    if there:
        row += "   " + "".join(f"{value / arcsec:9.3f}" for value in there)
    return row


def _index_table(indices: dict[str, Any], options: argparse.Namespace) -> str:
    rows = [
        f"{options.profile}, {options.sequences} sequences, windows of {options.window:g} s; "
        "arcsec per axis: rms, and 99.73 % as temporal, ensemble, mixed"
    ]
    for name, meaning in INDICES.items():
        values = indices[name]
        for axis in ("across", "about"):
            levels = [values["levels"][way.value]["99.73 %"][axis] for way in Interpretation]
            rows.append(
                f"{name:<5}{axis:<8}{values[axis]:9.3f}   "
                + "".join(f"{value:9.3f}" for value in levels)
                + (f"   {meaning}" if axis == "across" else "")
            )
    return "\n".join(rows)
