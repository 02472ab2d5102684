"""`startrack montecarlo`: the error of one design over many trials."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

from startrack.cli import options as shared
from startrack.cli.not_known import DRAWS
from startrack.cli.options import Exit, Option, Options, fidelity, positive, wanted, whole

if wanted(__name__):
    import numpy as np
    from scipy.spatial.transform import Rotation

    from startrack import metrics, montecarlo, plots
    from startrack.budget import noise_only
    from startrack.cli import terminal
    from startrack.cli.campaign import open_workers
    from startrack.cli.merge import sketch_rows
    from startrack.cli.not_known import draws_of, errors_over_unknowns, units_over_unknowns
    from startrack.cli.units import require_units, trials_of
    from startrack.core import Floats, Rows, arcsec
    from startrack.design import Accuracy, Case, Design, Fidelity, Requirements
    from startrack.io import finite, save_json
    from startrack.metrics import ARCSEC, ErrorLimits, Row
    from startrack.montecarlo import Endings, Precision, Sampling
    from startrack.observation import out_of_step
    from startrack.population import AS_DESIGNED, AsDesigned, Units
    from startrack.trial import OUTCOMES, require_fidelity
    from startrack.verification import (
        bounds_of_errors,
        cases,
        counted,
        number_of_claims,
        with_bounds,
    )

Workers = AbstractContextManager[Executor]
STORE = "campaign.sqlite"
GAMMA = "for squares with nearly a gamma distribution"
UNREACHED = 1e-6  # without --precision: a precision that no campaign reaches


declare = Options(
    "Each trial has a random attitude and independent noise. With --out it writes trials.csv, "
    "errors.png, summary.json and campaign.sqlite, for `report` and `combine`. The status is 3 if "
    "a trial has no correct attitude.",
    *shared.DESIGN,
    Option("--trials N", "number of trials", whole(1, 10**9), 200),
    Option(
        "--first K",
        "number of the first trial (default: 0): jobs of a cluster run parts of a campaign, "
        "which `startrack montecarlo merge` joins",
        whole(0, 2**62),
        0,
    ),
    Option(
        "--sketch FILE.json",
        "keep moments, quantiles within 0.1 %% and the worst trial instead of all trials, in a "
        "file of some 1 MB from which an interrupted run continues; for up to 10^9 trials, best "
        "of fidelity covariance",
        Path,
    ),
    shared.SEED,
    shared.WORKERS,
    fidelity(
        "frame: render whole frames (default); window: render only the pixels around stars, with "
        "the same noise, in a fifth of the time (slower than frame for units behind a lens "
        "table, which need a plan for each unit); spots: draw the spots from their covariance, "
        "without an image, and identify them; covariance: draw the spots, identification is "
        "assumed to be perfect"
    ),
    Option("--sobol", "use attitudes from a Sobol sequence; 16 scrambled copies give the interval"),
    Option(
        "--control",
        "compute each frame's linearised error as a control variate; 2 times "
        "fewer trials for the same interval, 5 times with a campaign of fidelity covariance "
        "(see `combine`)",
    ),
    Option(
        "--units N",
        "number of units of the design, drawn from its [[variation]] tables and calibrated, with "
        "--trials of each; the summary has the yield and explains the worst unit",
        whole(1, 10**6),
    ),
    Option(
        "--environments N",
        "environments of each unit, which share its trials, at most one per trial (default: 10, "
        "or --trials if fewer)",
        whole(1, 10**6),
    ),
    Option("--age TIME", "age of the units, such as '5 yr' (default: the lifetime of the design)"),
    DRAWS,
    Option("--out DIR", "folder for store, table and picture", Path),
    Option(
        "--table FILE",
        "table of the trials: RA, Dec, roll, rate, angles to Sun, Moon and Earth, status, "
        "reason, errors; CSV or Parquet by the name's ending",
        Path,
    ),
    Option(
        "--store FILE",
        "store of all trials, from which an interrupted run continues "
        "(default: campaign.sqlite in the folder of --out)",
        Path,
    ),
    Option(
        "--precision FRACTION",
        "stop when half the width of the statistic's interval is below this fraction of its "
        "value; --trials is then the largest number of trials",
        shared.decimal(1e-6, 1),
    ),
    Option(
        "--statistic",
        "statistic of --precision and --log: rms across (default) or about the "
        "boresight, the angle that 99.73 %% of the errors across do not exceed, or the "
        "availability",
        ("across", "about", "availability", "across-99.73"),
        "across",
    ),
    Option(
        "--confidence FRACTION", "confidence of the interval", shared.decimal(0.5, 0.9999), 0.95
    ),
    Option("--seconds SECONDS", "time limit for the start of a trial, s", positive),
    *shared.SCHEDULER,
    Option(
        "--log FILE",
        "append rate, statistic, interval and remaining time, one JSON object per line",
        Path,
    ),
    claims=True,
    problems=True,
)


class TriedDesign(NamedTuple):
    """A design, and its current trials in the store.

    outcomes   a row of each trial
    attitudes  attitudes of the trials, as drawn
    ends       outcome of each trial, and its reason
    failures   blocks of trials that failed, and the error of each
    rate       new trials per second
    """

    design: Design
    outcomes: Rows
    attitudes: Rotation
    ends: Endings
    failures: list[tuple[range, str]]
    rate: float

    @property
    def needs(self) -> Requirements | None:
        """The requirements of the design's campaign."""
        return self.design.campaign.requirements if self.design.campaign else None

    @property
    def accuracy(self) -> tuple[Accuracy, ...]:
        """Limits of errors."""
        return self.needs.accuracy if self.needs else ()


Section = tuple[dict[str, Any], list[str]]  # part of the result: values for JSON, and lines of text


def command(options: argparse.Namespace) -> int:
    """Print the summary; with --out, write trials.csv, errors.png and summary.json.

    With --out or --store each block of trials is on disk before the next starts, so that the same
    command continues an interrupted run.
    """
    path = options.design or terminal.example()
    design = terminal.read_design(path, options.set)
    case, campaign = design.case, design.campaign
    limits = campaign.requirements.limits if campaign else metrics.STATED_ALONE
    watched = Precision(
        options.precision or UNREACHED,
        options.statistic,
        options.confidence,
        options.sobol and not options.units,
        limits,
    )
    sampling = _sampling(options, case)
    _refuse_parts(options)
    options.trials *= options.units or 1
    with shared.as_wrong_use(path=path):
        require_fidelity(case, sampling.fidelity)
        conditions, refused = cases(case, campaign) if campaign else ((), ())
    workers = open_workers(options)
    with terminal.stage("first trial, and inputs of all"):
        montecarlo.warm(case, sampling)  # refuses impossible trials before the first
    if options.sketch:
        return _sketch(options, case, sampling, limits, workers)
    tried = _run(options, design, sampling, watched, workers)
    claims = number_of_claims(conditions)
    others = [*(condition.name for condition in conditions[1:]), *refused]
    summary, required, verdicts = _judged(options, tried, sampling, limits, claims, others)
    rows = metrics.summary_rows(summary, limits)
    result = {"design": str(path), "seed": options.seed, "fidelity": sampling.fidelity.value}
    result |= metrics.to_json(rows) | {"trials_per_s": tried.rate} | required
    doubt = f"{summary.doubt}; `startrack budget` names effects that the tracker does not know"
    text = [_answer(summary), *([doubt] if summary.doubt else [])]
    text += [*metrics.to_lines(rows), *verdicts]
    for values, lines in (
        _of_units(options, tried, sampling),
        _over_unknowns(options, tried, path, sampling, summary),
        ({"noise_only": not options.units}, [_pace(options, tried)]),
        _details(options, tried, watched),
    ):
        result |= values
        text += lines
    _save(options, tried, summary, result, path.stem)
    terminal.print_result(options, result, *text)
    done = summary.availability.value == 1 and not tried.failures
    return Exit.DONE if done else Exit.UNSOLVED


def _store_of(options: argparse.Namespace) -> Path | None:
    where: Path | None = options.store or (options.out / STORE if options.out else None)
    return where


def _pace(options: argparse.Namespace, tried: TriedDesign) -> str:
    return f"{tried.rate:.1f} trials/s, seed {options.seed}"


def _judged(
    options: argparse.Namespace,
    tried: TriedDesign,
    sampling: Sampling,
    limits: ErrorLimits,
    claims: int,
    others: Sequence[str],
) -> tuple[metrics.Summary, dict[str, Any], list[str]]:
    """The summary of the trials that count, and each limited error with its limit.

    claims  number of all claims that `verify` judges together
    others  conditions of the design that only `verify` runs
    """
    needs, judged = tried.needs, tried.outcomes
    if needs and sampling.attitudes == "random":
        judged = counted(needs, tried.design.case, options.seed, tried.outcomes)
    summary = metrics.summarise(judged, limits)
    if not (needs and needs.accuracy):
        return summary, {}, []
    kept = np.isin(tried.outcomes["trial"], judged["trial"])
    boresight = tried.attitudes[kept].inv().apply([0, 0, 1])
    summary, errors, verdicts = _required(needs, judged, boresight, summary, claims)
    if others:
        verdicts.append(
            "only the design's own condition; `startrack verify` also judges: " + "; ".join(others)
        )
    return summary, {"required": errors, "conditions_not_run": list(others)}, verdicts


def _of_units(options: argparse.Namespace, tried: TriedDesign, sampling: Sampling) -> Section:
    """Units of the design, or a note that the trials are of the unit as designed."""
    case = tried.design.case
    if not options.units:
        return {}, [*filter(None, [out_of_step(case.instrument)]), noise_only(case)]
    values, lines = trials_of(case, options.seed, sampling, tried.outcomes, tried.accuracy)
    return {"units": values}, lines


def _over_unknowns(
    options: argparse.Namespace,
    tried: TriedDesign,
    path: Path,
    sampling: Sampling,
    summary: metrics.Summary,
) -> Section:
    """Intervals over the unknown values of the design."""
    if not (tried.design.unknowns and options.draws):
        return {}, []
    if isinstance(sampling.units, Units):
        values, lines = units_over_unknowns(options, path, sampling.units.age)
        return {"not_known": values}, lines
    if drawn := draws_of(options, path):
        values, lines = errors_over_unknowns(drawn, (summary.across.value, summary.about.value))
        return {"not_known": values}, lines
    return {}, []


def _answer(summary: metrics.Summary) -> str:
    """The errors, and the fraction of trials with a correct attitude."""
    errors = "no trial has a correct attitude, so that no error is known"
    if math.isfinite(summary.across.value):
        across = metrics.bracketed(summary.across, ".3f", arcsec)
        about = metrics.bracketed(summary.about, ".3f", arcsec)
        errors = f"error {across} arcsec across and {about} about the boresight, rms per axis"
    return (
        f"{errors}; an attitude is correct in {100 * summary.availability.value:.2f} % of "
        f"{summary.trials} trials"
    )


def _save(
    options: argparse.Namespace,
    tried: TriedDesign,
    summary: metrics.Summary,
    result: dict[str, Any],
    name: str,
) -> None:
    """Write the table of the trials to --table; table, picture and result to the folder of --out.

    The result has their paths.
    """
    if where := _store_of(options):
        result["store"] = str(where)
    paths: list[Path | None] = [options.table, options.out and options.out / "trials.csv"]
    if any(paths):
        table = montecarlo.with_causes(
            tried.design.case, tried.outcomes, tried.attitudes, tried.ends
        )
        with shared.as_wrong_use(ValueError, ImportError):
            for path in filter(None, paths):
                montecarlo.export(path, table)
    if options.out:
        picture = options.out / "errors.png"
        plots.draw_errors(picture, tried.outcomes, name, summary, tried.accuracy)
        save_json(options.out / "summary.json", finite(result))
        result["out"] = str(options.out)


def _run(
    options: argparse.Namespace,
    design: Design,
    sampling: Sampling,
    watched: Precision,
    workers: Workers,
) -> TriedDesign:
    """Run the trials that are not yet in the store."""
    where = _store_of(options)
    began, precision = time.perf_counter(), watched if options.precision else None
    numbers = range(options.first, options.first + options.trials)
    with shared.as_wrong_use():
        opened = montecarlo.Store(where, design.case, options.seed, sampling)
    with opened as store, workers as executor:
        before = sum(
            max(0, min(block.stop, numbers.stop) - max(block.start, numbers.start))
            for block in store.done()
        )
        if before:
            terminal.print_message(f"{where} has {before} of these trials; continuing")
        with (
            terminal.progress("trials", options.trials) as advance,
            montecarlo.Watch(store, watched, options.trials, advance, options.log) as watch,
        ):
            advance(min(before, options.trials))
            outcomes = montecarlo.resume(
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
        failures = store.failures()
    rate = (len(outcomes) - before) / (time.perf_counter() - began)
    attitudes = sampling.attitudes_of(options.seed, outcomes["trial"].tolist())
    needs = design.campaign.requirements if design.campaign else None
    keep_out = needs.min_keep_out if needs else None
    ends = montecarlo.endings(
        design.case, options.seed, outcomes, attitudes, watched.limits, keep_out
    )
    return TriedDesign(design, outcomes, attitudes, ends, failures, rate)


def _details(options: argparse.Namespace, tried: TriedDesign, precision: Precision) -> Section:
    """Gain of the variance reduction, ends of the trials, and uncertainty of the statistic."""
    result: dict[str, Any] = {}
    text = []
    if options.control or (options.sobol and not options.units):
        rows = _reduced_variance(tried.outcomes, options.sobol)
        result["helped"] = metrics.to_json(rows)
        text += metrics.to_lines(rows)
    lost = {end.value: count for end, count in tried.ends.count().items() if count}
    result["endings"] = lost
    if set(lost) != {montecarlo.Ending.CORRECT.value}:
        text.append("trials by outcome: " + ", ".join(f"{n} {name}" for name, n in lost.items()))
    if options.precision:
        width = montecarlo.half_width(precision.interval(tried.outcomes))
        result |= {"statistic": precision.statistic, "relative_half_width": width}
        result |= {"confidence": precision.confidence, "precise": width <= precision.relative}
        text.append(
            f"{precision.statistic} is known to {100 * width:.2f} % with "
            f"{100 * precision.confidence:g} % confidence"
        )
    if tried.failures:
        result["failed_trials"] = sum(len(numbers) for numbers, _ in tried.failures)
        last = montecarlo.last_words(tried.failures[-1][1])
        terminal.print_message(f"{result['failed_trials']} trials failed, the last with: {last}")
    return result, text


def _refuse_parts(options: argparse.Namespace) -> None:
    """Refuse options that do not fit parts of a campaign or sketches."""
    if options.first and (options.precision or options.units):
        other = "precision" if options.precision else "units"
        raise shared.WrongUse(f"--first must be left out with --{other}")
    apart = ("out", "store", "table", "precision", "units", "control", "seconds", "log")
    for name in (name for name in apart if options.sketch and getattr(options, name)):
        raise shared.WrongUse(
            f"--{name} must be left out with --sketch, which does not keep single trials"
        )


def _sketch(
    options: argparse.Namespace,
    case: Case,
    sampling: Sampling,
    limits: ErrorLimits,
    workers: Workers,
) -> int:
    """Fill the file of --sketch, and print its results."""
    numbers = range(options.first, options.first + options.trials)
    with (
        shared.as_wrong_use(),
        workers as executor,
        terminal.progress("trials", options.trials) as advance,
    ):
        sketch = montecarlo.resume_sketch(
            options.sketch,
            case,
            options.seed,
            sampling,
            numbers,
            executor,
            options.workers,
            limits,
            advance,
        )
    rows = [Row("sketch", str(options.sketch)), Row("seed", options.seed)]
    terminal.print_rows(options, [*rows, Row("fidelity", options.fidelity), *sketch_rows(sketch)])
    return Exit.DONE if sketch.counts["correct"] == sketch.trials else Exit.UNSOLVED


def _required(
    needs: Requirements,
    outcomes: Rows,
    boresight: Floats,
    summary: metrics.Summary,
    claims: int = 1,
) -> tuple[metrics.Summary, dict[str, Any], list[str]]:
    """Each limited error with the bounds that judge it; for a verdict see `verify`.

    boresight  (n, 3) of the outcomes, ICRS
    claims     number of all claims that `verify` judges together
    """
    required, lines = {}, []
    every = bounds_of_errors(needs, outcomes, boresight, claims)
    known = with_bounds(summary, needs, every)
    for claim, bounds in every:
        assert claim.accuracy
        shown = metrics.bracketed(bounds, ".3f", arcsec)
        if math.isfinite(bounds.low) and not math.isfinite(bounds.high):
            least = f", at least {bounds.low / arcsec:.3f}" if bounds.low else ""
            few = "trials" if metrics.units_of(outcomes) is None else "units"
            shown = f"{bounds.value / arcsec:.3f}{least} (too few {few} for an upper bound)"
        alike = claim.accuracy.objective.rms_per_axis
        if alike and getattr(known, claim.accuracy.name) == bounds:
            shown = f"{bounds.value / arcsec:.3f} with the interval above ({GAMMA})"
        required[claim.name] = {
            "statistic": str(claim.accuracy.objective),
            "limit_arcsec": claim.limit / arcsec,
            **{f"{n}_arcsec": v for n, v in metrics.bounds_json(bounds, ARCSEC).items()},
        }
        lines.append(
            f"required: {claim.accuracy.objective} at most {claim.limit / arcsec:g} arcsec, found "
            f"{shown}: {claim.answer(bounds).value} with {100 * needs.confidence:g} %"
        )
    return known, required, lines


def _sampling(options: argparse.Namespace, case: Case) -> Sampling:
    attitudes = "sobol" if options.sobol else "random"
    with shared.as_wrong_use():
        units: AsDesigned | Units = AS_DESIGNED
        if options.units:
            require_units(case)
            given = terminal.age_of(options)
            age = case.end_of_life if given is None else given
            environments = options.environments or min(Units.environments, options.trials)
            if environments > options.trials:
                raise shared.WrongUse(
                    f"--environments must be at most --trials, the {options.trials} trials of each "
                    f"unit, got {environments}"
                )
            units = Units(options.trials, environments, age)
        for name in ("age", "environments"):
            if not options.units and getattr(options, name) is not None:
                raise shared.WrongUse(f"--{name} needs --units")
        return Sampling(Fidelity(options.fidelity), attitudes, options.control, units)


def _reduced_variance(outcomes: Rows, sobol: bool) -> list[Row]:
    """The errors with Sobol points and controls, and the factor of saved trials."""
    rows = []
    for name, about in (("across", False), ("about", True)):
        plain = montecarlo.mean_square(outcomes[list(OUTCOMES.names or ())], about)
        reduced = montecarlo.mean_square(outcomes, about, sobol)
        fewer, label = (plain.error / reduced.error) ** 2, f"variance reduced, {name}"
        note = f"rms, as with {fewer:.1f} times as many trials"
        rows.append(Row(f"{name}_rms_arcsec", reduced.root(), label, ARCSEC, note=note))
        rows.append(Row(f"{name}_times_fewer", fewer))
    return rows
