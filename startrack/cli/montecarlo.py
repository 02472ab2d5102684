"""`startrack montecarlo`: the error of one design over many trials."""

from __future__ import annotations

import argparse
import time
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from startrack.cli.imports import deferred
from startrack.cli.options import (
    DESIGN,
    SCHEDULER,
    SEED,
    WORKERS,
    Exit,
    Option,
    Options,
    WrongUse,
    as_wrong_use,
    decimal,
    fidelity,
    positive,
    whole,
)

with deferred():
    import numpy as np
    from numpy.typing import NDArray

    from startrack.budget import noise_only
    from startrack.cli.campaign import open_workers
    from startrack.cli.merge import sketch_summary
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


declare = Options(
    "Each trial has a random attitude and independent noise. With --out it writes trials.csv, "
    "errors.png, summary.json and campaign.sqlite, for `report` and `combine`. The status is 3 if "
    "a trial has no correct attitude.",
    *DESIGN,
    Option("--trials N", "number of trials", whole(1, 10**9), 200),
    Option("--first K", "number of the first trial (default: 0), so that the jobs of a cluster "
           "run parts of one campaign, which `startrack merge` puts together", whole(0, 2**62),
           0),
    Option("--sketch FILE.json", "keep moments, quantiles within 0.1 %% and the worst trial in a "
           "file of some 1 MB instead of all trials, from which an interrupted run continues; for "
           "up to 10^9 trials, best of fidelity covariance", Path),
    SEED,
    WORKERS,
    fidelity("frame: render whole frames (default); window: only the pixels around stars, with "
             "the same noise, in a fifth of the time; spots: draw the spots from their "
             "covariance, without an image, and identify them; covariance: draw the spots, "
             "identification is assumed to be perfect"),
    Option("--sobol", "use attitudes from a Sobol sequence; 16 scrambled copies give the interval"),
    Option("--control", "compute each frame's linearised error as a control variate; 2 times "
           "fewer trials for the same interval, 5 times with a campaign of fidelity covariance "
           "(see `combine`)"),
    Option("--units N", "N units of the design, drawn from its [[variation]] tables and "
           "calibrated, with --trials of each; the summary has the yield and explains the worst "
           "unit", whole(1, 10**6)),
    Option("--environments N", "environments of each unit, its trials shared among them",
           whole(1, 10**6), 10),
    Option("--age TIME", "age of the units, such as '5 yr' (default: the lifetime of the design)"),
    Option("--out DIR", "folder for store, table and picture", Path),
    Option("--table FILE", "table of the trials: RA, Dec, roll, rate, angles to Sun, Moon and "
           "Earth, status, reason, errors; CSV or Parquet, as the name ends", Path),
    Option("--store FILE", "store of all trials, from which an interrupted run continues "
           "(default: campaign.sqlite in the folder of --out)", Path),
    Option("--precision FRACTION", "stop when half the width of the interval of the statistic is "
           "below this fraction of its value; --trials is then the largest number of trials",
           decimal(1e-6, 1)),
    Option("--statistic", "statistic of --precision and --log: rms across (default) or about the "
           "boresight, the angle that 99.73 %% of the errors across do not exceed, or the "
           "availability", ("across", "about", "availability", "across-99.73"), "across"),
    Option("--confidence FRACTION", "confidence of that interval", decimal(0.5, 0.9999), 0.95),
    Option("--seconds SECONDS", "start no trial after this time, s", positive),
    *SCHEDULER,
    Option("--log FILE", "append rate, statistic, interval and remaining time, one JSON object "
           "per line", Path),
    claims=True,
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
