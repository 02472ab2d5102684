"""`startrack montecarlo`: many trials of one design."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.cli.exits import Exit, WrongUse
from startrack.cli.options import (
    add_design,
    add_seed,
    add_workers,
    decimal,
    describe,
    positive,
    whole,
)
from startrack.cli.terminal import (
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
from startrack.design import Case, Fidelity
from startrack.io import save_json
from startrack.metrics import summarise
from startrack.montecarlo import (
    STATISTICS,
    Precision,
    Sampling,
    Store,
    Watch,
    cluster,
    export,
    half_width,
    mean_square,
    pool,
    resume,
    warm,
)
from startrack.plots import draw_errors
from startrack.trial import OUTCOMES

STORE = "campaign.sqlite"
UNREACHED = 1e-6  # a precision that no campaign reaches, where none is asked for


def declare(parser: argparse.ArgumentParser) -> None:
    """Add the options of `startrack montecarlo`."""
    describe(
        parser,
        "Each trial is a random attitude with noise of its own. With --out it leaves trials.csv, "
        "errors.png, summary.json and campaign.sqlite, for `report` and `combine`. The status is 3 "
        "where a trial has no right attitude.",
    )
    add_design(parser)
    parser.add_argument(
        "--trials", type=whole(1, 10**9), default=200, metavar="N", help="(default: 200)"
    )
    add_seed(parser)
    add_workers(parser)
    parser.add_argument(
        "--fidelity", default="frame", choices=("frame", "window", "spots", "covariance"),
        help="render whole frames (default); only windows around the stars, with the same law, at "
        "a fifth of the time; draw the spots from their covariance, without any image, and "
        "identify them; or draw them and take it as known which star each of them is",
    )  # fmt: skip
    parser.add_argument(
        "--sobol", action="store_true",
        help="look at points that fill the sphere evenly; 16 scrambles of them give the interval",
    )  # fmt: skip
    parser.add_argument(
        "--control", action="store_true",
        help="compute each frame's linearised error, too, whose exact mean is known; 2 times fewer "
        "trials by itself, 5 times with a campaign of covariance (see `combine`)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="DIR", help="for store, table and picture")
    parser.add_argument(
        "--store", type=Path, metavar="FILE", help="keeps each trial; a run that was cut short "
        "goes on from it (default: campaign.sqlite in the folder of --out)",
    )  # fmt: skip
    parser.add_argument(
        "--precision", type=decimal(1e-6, 1), metavar="SHARE",
        help="stop when half the interval of the statistic is below this fraction of its value; "
        "--trials are the most, then",
    )  # fmt: skip
    parser.add_argument(
        "--statistic", default="across", choices=STATISTICS,
        help="of --precision and --log: rms across (default) or about the boresight, the angle "
        "that 99.73 %% of the errors across do not exceed, or the fraction of right attitudes",
    )  # fmt: skip
    parser.add_argument(
        "--confidence", type=decimal(0.5, 0.9999), default=0.95, metavar="SHARE",
        help="of that interval (default: 0.95)",
    )  # fmt: skip
    parser.add_argument(
        "--seconds", type=positive, metavar="SECONDS", help="begin no trial after this time"
    )
    parser.add_argument(
        "--scheduler", type=address, metavar="ADDRESS",
        help="take workers from a Dask cluster (tcp://host:port), or from MPI (mpi)",
    )  # fmt: skip
    parser.add_argument(
        "--log", type=Path, metavar="FILE",
        help="append rate, statistic with its interval and remaining time, a JSON object a line",
    )  # fmt: skip


def address(text: str) -> str:
    """Read the address of a scheduler."""
    if text != "mpi" and "://" not in text:
        raise argparse.ArgumentTypeError(f"must be tcp://host:port or mpi, got {text!r}")
    return text


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
