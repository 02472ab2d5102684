"""`startrack montecarlo`: many trials of one design."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.campaign.export import export
from startrack.campaign.precision import Precision, half_width
from startrack.campaign.resume import resume
from startrack.campaign.store import Store
from startrack.campaign.watch import Watch
from startrack.case import Case, Fidelity
from startrack.commands.terminal import (
    example,
    finite,
    in_arcsec,
    progress,
    read_design,
    say,
    summary_text,
    summary_values,
    tell,
)
from startrack.draw import draw_errors
from startrack.error import summarise
from startrack.exits import Exit, WrongUse
from startrack.saving import save_json
from startrack.study.cluster import cluster
from startrack.study.montecarlo import OUTCOMES, pool, warm
from startrack.variance.mean_square import mean_square
from startrack.variance.sampling import Sampling

STORE = "campaign.sqlite"
UNREACHED = 1e-6  # a precision that no campaign reaches, where none is asked for


def command(options: argparse.Namespace) -> int:
    """Print the summary; with --out, leave trials.csv, errors.png and summary.json.

    With --out or --store each block of trials is on disk before the next: the same command
    goes on where another was cut short.
    """
    path = options.design or example()
    case = read_design(path).case
    precision = None if options.precision is None else _asked(options, options.precision)
    sampling = _sampling(options)
    where: Path | None = options.store or (options.out / STORE if options.out else None)
    workers = cluster(options.scheduler) if options.scheduler else pool(options.workers)
    if options.workers > 1 and not options.scheduler:
        warm(case, sampling)
    began = time.perf_counter()
    with _open(where, case, options.seed, sampling) as store, workers as executor:
        held = sum(len(block) for block in store.done())
        if held:
            say(f"{where} holds {held} trials; going on")
        watched = precision or _asked(options, UNREACHED)
        with (
            progress("trials", options.trials) as advance,
            Watch(store, watched, options.trials, advance, options.log) as watch,
        ):
            advance(min(held, options.trials))
            outcomes = resume(
                store, executor, options.workers, options.trials, precision, options.seconds, watch
            )
        failures, done = store.failures(), len(store.outcomes())
    rate = (done - held) / (time.perf_counter() - began)
    summary = summarise(outcomes)
    result = {
        "design": str(path),
        "seed": options.seed,
        "fidelity": sampling.fidelity.value,
    } | summary_values(summary)
    result |= {"trials_per_s": rate}
    text = f"{summary_text(summary)}\n{rate:.1f} trials/s, seed {options.seed}"
    if sampling.control or options.sobol:
        told, words = _helped(outcomes, options.sobol)
        result |= {"helped": told}
        text += f"\n{words}"
    if precision:
        width = half_width(precision.interval(outcomes))
        result |= {"statistic": precision.statistic, "relative_half_width": width}
        result |= {"confidence": precision.confidence, "precise": width <= precision.relative}
        text += (
            f"\n{precision.statistic} is known to {100 * width:.2f} % with "
            f"{100 * precision.confidence:g} % confidence"
        )
    if failures:
        last = failures[-1][1].strip().splitlines()[-1]
        result["failed_trials"] = sum(len(numbers) for numbers, _ in failures)
        say(f"{result['failed_trials']} trials failed, the last with: {last}")
    if where:
        result["store"] = str(where)
    if options.out:
        export(options.out / "trials.csv", outcomes)
        draw_errors(options.out / "errors.png", outcomes, path.stem)
        save_json(options.out / "summary.json", finite(result))
        result["out"] = str(options.out)
    tell(options, result, text)
    return Exit.DONE if summary.availability.value == 1 and not failures else Exit.UNSOLVED


def _asked(options: argparse.Namespace, relative: float) -> Precision:
    return Precision(relative, options.statistic, options.confidence, options.sobol)


def _sampling(options: argparse.Namespace) -> Sampling:
    attitudes = "sobol" if options.sobol else "random"
    try:
        return Sampling(Fidelity(options.fidelity), attitudes, options.control)
    except ValueError as error:
        raise WrongUse(str(error)) from None


def _helped(outcomes: NDArray[np.void], sobol: bool) -> tuple[dict[str, Any], str]:
    """The errors with the help of Sobol's points and controls, and how many trials that saves."""
    result: dict[str, Any] = {}
    lines = []
    for name, about in (("across", False), ("about", True)):
        alone, helped = (
            mean_square(outcomes[list(OUTCOMES.names or ())], about),
            mean_square(outcomes, about, sobol),
        )
        told, fewer = in_arcsec(helped.root()), (alone.error / helped.error) ** 2
        result[f"{name}_rms_arcsec"] = told["value"]
        result[f"{name}_rms_arcsec_95"] = [told["low"], told["high"]]
        result[f"{name}_times_fewer"] = fewer
        lines.append(
            f"helped, {name:6s} {told['value']:16.3f} arcsec rms [{told['low']:.3f}, "
            f"{told['high']:.3f}], as from {fewer:.1f} times as many"
        )
    return result, "\n".join(lines)


def _open(path: Path | None, case: Case, seed: int, sampling: Sampling) -> Store:
    try:
        return Store(path, case, seed, sampling)
    except ValueError as error:
        raise WrongUse(str(error)) from None
