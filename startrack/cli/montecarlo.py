"""`startrack montecarlo`: the error of one design over many trials."""

from __future__ import annotations

import argparse
import time
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from startrack.cli.imports import wanted
from startrack.cli.options import (
    Exit,
    WrongUse,
    add_design,
    add_fidelity,
    add_seed,
    add_workers,
    as_wrong_use,
    decimal,
    describe,
    positive,
    whole,
)
from startrack.cli.scheduler import add_scheduler

if wanted(__name__):
    import numpy as np
    from numpy.typing import NDArray

    from startrack.budget import noise_only
    from startrack.cli.merge import sketch_summary
    from startrack.cli.scheduler import open_workers
    from startrack.cli.terminal import (
        example,
        finite,
        in_arcsec,
        print_message,
        print_result,
        progress,
        read_design,
        summary_text,
        summary_values,
    )
    from startrack.cli.units import require_units, trials_of
    from startrack.core import arcsec, parse
    from startrack.design import Case, Fidelity, Requirements
    from startrack.io import save_json
    from startrack.metrics import STATED_ALONE, Limits, summarise
    from startrack.montecarlo import (
        Ending,
        Precision,
        Sampling,
        Store,
        Watch,
        endings,
        export,
        half_width,
        last_words,
        mean_square,
        resume,
        resume_sketch,
        warm,
        with_causes,
    )
    from startrack.plots import draw_errors
    from startrack.population import Units
    from startrack.trial import OUTCOMES, require_fidelity
    from startrack.verification import cases, claims_of, counted

STORE = "campaign.sqlite"
UNREACHED = 1e-6  # without --precision: one that no campaign reaches


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack montecarlo`."""
    describe(
        parser,
        "Each trial has a random attitude and independent noise. With --out it writes trials.csv, "
        "errors.png, summary.json and campaign.sqlite, for `report` and `combine`. The status is 3 "
        "if a trial has no correct attitude.",
    )
    parser.set_defaults(claims=True)
    add_design(parser)
    parser.add_argument(
        "--trials",
        type=whole(1, 10**9),
        default=200,
        metavar="N",
        help="number of trials (default: 200)",
    )
    parser.add_argument(
        "--first", type=whole(0, 2**62), default=0, metavar="K",
        help="number of the first trial (default: 0), so that the jobs of a cluster run parts of "
        "one campaign, which `startrack merge` puts together",
    )  # fmt: skip
    parser.add_argument(
        "--sketch", type=Path, metavar="FILE.json",
        help="keep moments, quantiles within 0.1 %% and the worst trial in a file of some 1 MB "
        "instead of all trials, from which an interrupted run continues; for up to 10^9 trials, "
        "best of fidelity covariance",
    )  # fmt: skip
    add_seed(parser)
    add_workers(parser)
    add_fidelity(
        parser,
        "frame: render whole frames (default); window: only the pixels around stars, with the "
        "same noise, in a fifth of the time; spots: draw the spots from their covariance, without "
        "an image, and identify them; covariance: draw the spots, identification is assumed to be "
        "perfect",
    )
    parser.add_argument(
        "--sobol", action="store_true",
        help="use attitudes from a Sobol sequence; 16 scrambled copies give the interval",
    )  # fmt: skip
    parser.add_argument(
        "--control", action="store_true",
        help="compute each frame's linearised error as a control variate; 2 times fewer trials for "
        "the same interval, 5 times with a campaign of fidelity covariance (see `combine`)",
    )  # fmt: skip
    parser.add_argument(
        "--units", type=whole(1, 10**6), metavar="N",
        help="N units of the design, drawn from its [[variation]] tables and calibrated, with "
        "--trials of each; the summary has the yield and explains the worst unit",
    )  # fmt: skip
    parser.add_argument(
        "--environments", type=whole(1, 10**6), default=10, metavar="N",
        help="environments of each unit, its trials shared among them (default: 10)",
    )  # fmt: skip
    parser.add_argument(
        "--age", metavar="TIME",
        help="age of the units, such as '5 yr' (default: the lifetime of the design)",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for store, table and picture"
    )
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="table of the trials: RA, Dec, roll, rate, "
        "angles to Sun, Moon and Earth, status, reason, errors; CSV or Parquet, as the name ends",
    )  # fmt: skip
    parser.add_argument(
        "--store", type=Path, metavar="FILE", help="store of all trials, from which an interrupted "
        "run continues (default: campaign.sqlite in the folder of --out)",
    )  # fmt: skip
    parser.add_argument(
        "--precision", type=decimal(1e-6, 1), metavar="FRACTION",
        help="stop when half the width of the interval of the statistic is below this fraction of "
        "its value; --trials is then the largest number of trials",
    )  # fmt: skip
    parser.add_argument(
        "--statistic", default="across",
        choices=("across", "about", "availability", "across-99.73"),
        help="statistic of --precision and --log: rms across (default) or about the boresight, the "
        "angle that 99.73 %% of the errors across do not exceed, or the availability",
    )  # fmt: skip
    parser.add_argument(
        "--confidence", type=decimal(0.5, 0.9999), default=0.95, metavar="FRACTION",
        help="confidence of that interval (default: 0.95)",
    )  # fmt: skip
    parser.add_argument(
        "--seconds", type=positive, metavar="SECONDS", help="start no trial after this time, s"
    )
    add_scheduler(parser)
    parser.add_argument(
        "--log", type=Path, metavar="FILE",
        help="append rate, statistic, interval and remaining time, one JSON object per line",
    )  # fmt: skip


def command(options: argparse.Namespace) -> int:
    """Print the summary; with --out, write trials.csv, errors.png and summary.json.

    With --out or --store each block of trials is on disk before the next, so that the same
    command continues an interrupted run.
    """
    path = options.design or example()
    design = read_design(path, options.set)
    case = design.case
    needs = design.campaign.requirements if design.campaign else None
    limits = needs.limits if needs else STATED_ALONE
    precision = (
        None if options.precision is None else _precision(options, options.precision, limits)
    )
    sampling = _sampling(options, case)
    _refuse_parts(options)
    if sampling.units:
        options.trials *= options.units
    with as_wrong_use(path=path):
        require_fidelity(case, sampling.fidelity)
        conditions, refused = cases(case, design.campaign) if design.campaign else ((), ())
    where: Path | None = options.store or (options.out / STORE if options.out else None)
    workers = open_workers(options)
    warm(case, sampling)  # what no trial can do is refused before the first
    began = time.perf_counter()
    if options.sketch:
        return _sketch(options, case, sampling, limits, workers)
    numbers = range(options.first, options.first + options.trials)
    with _open(where, case, options.seed, sampling) as store, workers as executor:
        held = sum(
            max(0, min(block.stop, numbers.stop) - max(block.start, numbers.start))
            for block in store.done()
        )
        if held:
            print_message(f"{where} holds {held} trials; continuing")
        watched = precision or _precision(options, UNREACHED, limits)
        with (
            progress("trials", options.trials) as advance,
            Watch(store, watched, options.trials, advance, options.log) as watch,
        ):
            advance(min(held, options.trials))
            outcomes = resume(
                store,
                executor,
                options.workers,
                options.trials,
                precision,
                options.seconds,
                watch,
                first=options.first,
            )
        if design.campaign:
            store.keep_campaign(design.campaign)
        failures, done = store.failures(), len(outcomes)
    attitudes = sampling.attitudes_of(options.seed, outcomes["trial"].tolist())
    found = endings(
        case, options.seed, outcomes, attitudes, limits, needs.min_keep_out if needs else None
    )
    rate = (done - held) / (time.perf_counter() - began)
    judged = outcomes
    if needs and sampling.attitudes == "random":
        judged = counted(needs, case, options.seed, outcomes)
    summary = summarise(judged, limits)
    result = {
        "design": str(path),
        "seed": options.seed,
        "fidelity": sampling.fidelity.value,
    } | summary_values(summary)
    result |= {"trials_per_s": rate}
    text = f"{summary_text(summary, limits)}"
    if design.campaign and needs and needs.accuracy:
        values, lines = _required(needs, judged, sampling, options.seed)
        others = [*(one.name for one in conditions[1:]), *refused]
        result |= {"required": values, "conditions_not_run": others}
        text += f"\n{lines}"
        if others:
            text += (
                f"\nthis is the design's own condition alone; `startrack verify` also judges: "
                f"{'; '.join(others)}"
            )
    if sampling.units:
        required = needs.accuracy if needs else ()
        values, lines = trials_of(case, options.seed, sampling, outcomes, required)
        result |= {"units": values}
        text += f"\n{lines}"
    else:
        text += f"\n{noise_only(case)}"
    result["noise_only"] = not sampling.units
    text += f"\n{rate:.1f} trials/s, seed {options.seed}"
    if sampling.control or options.sobol:
        values, lines = _reduced_variance(outcomes, options.sobol)
        result |= {"helped": values}
        text += f"\n{lines}"
    lost = {one.value: count for one, count in found.count().items() if count}
    result["endings"] = lost
    if set(lost) != {Ending.CORRECT.value}:
        text += "\ntrials by their end: " + ", ".join(f"{n} {name}" for name, n in lost.items())
    if precision:
        width = half_width(precision.interval(outcomes))
        result |= {"statistic": precision.statistic, "relative_half_width": width}
        result |= {"confidence": precision.confidence, "precise": width <= precision.relative}
        text += (
            f"\n{precision.statistic} is known to {100 * width:.2f} % with "
            f"{100 * precision.confidence:g} % confidence"
        )
    if failures:
        last = last_words(failures[-1][1])
        result["failed_trials"] = sum(len(numbers) for numbers, _ in failures)
        print_message(f"{result['failed_trials']} trials failed, the last with: {last}")
    if where:
        result["store"] = str(where)
    tables: list[Path | None] = [options.table, options.out / "trials.csv" if options.out else None]
    if any(tables):
        table = with_causes(case, outcomes, attitudes, found)
        with as_wrong_use(ValueError, ImportError):
            for wanted in filter(None, tables):
                export(wanted, table)
    if options.out:
        draw_errors(options.out / "errors.png", outcomes, path.stem)
        save_json(options.out / "summary.json", finite(result))
        result["out"] = str(options.out)
    print_result(options, result, text)
    return Exit.DONE if summary.availability.value == 1 and not failures else Exit.UNSOLVED


def _refuse_parts(options: argparse.Namespace) -> None:
    """Refuse what parts of a campaign, or sketches, cannot do."""
    if options.first and (options.precision or options.units):
        other = "precision" if options.precision else "units"
        raise WrongUse(f"--first must be left out beside --{other}")
    apart = ("out", "store", "table", "precision", "units", "control", "seconds", "log")
    for name in (name for name in apart if options.sketch and getattr(options, name)):
        raise WrongUse(f"--{name} must be left out beside --sketch, which keeps no single trial")


def _sketch(
    options: argparse.Namespace,
    case: Case,
    sampling: Sampling,
    limits: Limits,
    workers: AbstractContextManager[Executor],
) -> int:
    """Fill the file of --sketch, and print what it holds."""
    numbers = range(options.first, options.first + options.trials)
    with (
        as_wrong_use(),
        workers as executor,
        progress("trials", options.trials) as advance,
    ):
        sketch = resume_sketch(
            options.sketch, case, options.seed, sampling, numbers, executor, options.workers,
            limits, advance,
        )  # fmt: skip
    values, text = sketch_summary(sketch)
    head = {"sketch": str(options.sketch), "seed": options.seed, "fidelity": options.fidelity}
    print_result(options, head | values, text)
    return Exit.DONE if values["availability"] == 1 else Exit.UNSOLVED


def _precision(options: argparse.Namespace, relative: float, limits: Limits) -> Precision:
    return Precision(relative, options.statistic, options.confidence, options.sobol, limits)


def _required(
    needs: Requirements, outcomes: NDArray[np.void], sampling: Sampling, seed: int
) -> tuple[dict[str, Any], str]:
    """Each error that is limited, with the bounds of its confidence; no verdict, see `verify`."""
    result, lines, tail = {}, [], 1 - needs.confidence
    attitudes = sampling.attitudes_of(seed, outcomes["trial"].tolist())
    boresight = attitudes.inv().apply([0.0, 0.0, 1.0])
    for claim in claims_of(needs):
        if claim.accuracy is None:
            continue
        bounds = claim.bounds(outcomes, boresight, tail, tail)
        result[claim.name] = {
            "statistic": str(claim.accuracy.objective),
            "limit_arcsec": claim.limit / arcsec,
            **{f"{name}_arcsec": value for name, value in in_arcsec(bounds).items()},
        }
        shown = claim.answer(bounds).value
        value, low, high = (one / arcsec for one in (bounds.value, bounds.low, bounds.high))
        lines.append(
            f"required: {claim.accuracy.objective} at most {claim.limit / arcsec:g} arcsec, found "
            f"{value:.3f} [{low:.3f}, {high:.3f}]: {shown} with {100 * needs.confidence:g} %"
        )
    return result, "\n".join(lines)


def _sampling(options: argparse.Namespace, case: Case) -> Sampling:
    attitudes = "sobol" if options.sobol else "random"
    with as_wrong_use():
        units = None
        if options.units:
            require_units(case)
            age = case.end_of_life if options.age is None else parse(options.age, "s")
            units = Units(options.trials, min(options.environments, options.trials), age)
        elif options.age is not None:
            raise ValueError("--age needs --units")
        return Sampling(Fidelity(options.fidelity), attitudes, options.control, units)


def _reduced_variance(outcomes: NDArray[np.void], sobol: bool) -> tuple[dict[str, Any], str]:
    """The errors with Sobol points and controls, and the factor of trials that these save."""
    result: dict[str, Any] = {}
    lines = []
    for name, about in (("across", False), ("about", True)):
        plain, reduced = (
            mean_square(outcomes[list(OUTCOMES.names or ())], about),
            mean_square(outcomes, about, sobol),
        )
        bounds, fewer = in_arcsec(reduced.root()), (plain.error / reduced.error) ** 2
        result[f"{name}_rms_arcsec"] = bounds["value"]
        result[f"{name}_rms_arcsec_95"] = [bounds["low"], bounds["high"]]
        result[f"{name}_times_fewer"] = fewer
        lines.append(
            f"variance reduced, {name:6s} {bounds['value']:9.3f} arcsec rms [{bounds['low']:.3f}, "
            f"{bounds['high']:.3f}], as with {fewer:.1f} times as many trials"
        )
    return result, "\n".join(lines)


def _open(path: Path | None, case: Case, seed: int, sampling: Sampling) -> Store:
    with as_wrong_use():
        return Store(path, case, seed, sampling)
