"""How fast are the cheaper fidelities, and do their results have the distribution of whole frames?

Two designs have a quarter of the example's pixels: a bright design, and a marginal design with few
stars and with false spots by noise. Whole frames and windows, with different seeds, are compared by
two-sample tests of the number of spots, the number of false spots, the centroid of a star, and the
error of the attitude. The smallest p-value times their number must exceed 0.01, which fails by
chance once in 100 runs. For spots drawn from their covariance, identified or with known matches,
the rms error of the attitude is compared with that of frames. For a third design, with too few
stars in most skies, the fraction of solved trials is compared.

    python experiments/fidelities.py [--trials N] [--json FILE] [--picture FILE] [--quick]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import command
import numpy as np
from scipy import stats
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from startrack import (
    Case,
    Fidelity,
    Spots,
    Streams,
    identify_and_solve,
    load_design,
    observe,
    random_attitude,
    run_trials,
    shipped,
)
from startrack.catalog import open_sky
from startrack.core import Floats
from startrack.detection import DarkMap
from startrack.detector import Defects
from startrack.identification import PatternIndexes
from startrack.metrics import judge
from startrack.plots import LINES, legend_below, save_picture, styled
from startrack.plots import picture as blank
from startrack.trial import plan_spots, plan_windows, spots_in_windows

Drawn = dict[str, list[Floats]]  # errors of each fidelity by the design's name, radian

EXAMPLE = load_design(shipped("designs/noise_only.toml")).case
TRIALS = 5000
DRAWN = 20_000  # trials of fidelity covariance
ROUNDS = 60  # rounds of each time; the shortest counts
LOST = 2.5e-3  # second, exposure that leaves five stars of the marginal design
NEAR = 3.0  # pixel; a spot farther from all stars is false
ALONE = 12.0  # pixel, distance of a compared star from the next star
ARCSEC = math.pi / 180 / 3600


def with_detector(case: Case, **changes: object) -> Case:
    detector = replace(case.instrument.detector, **changes)  # type: ignore[arg-type]
    return replace(case, instrument=replace(case.instrument, detector=detector))


def designs() -> dict[str, Case]:
    """The example with a quarter of its pixels; then with a sixth of its light as well."""
    small = with_detector(EXAMPLE, columns=256, rows=256, pixel_pitch=22e-6)
    optics = replace(small.instrument.optics, blur=10e-6)
    small = replace(small, instrument=replace(small.instrument, optics=optics))
    detection = replace(small.tracker.detection, threshold=4.6)
    faint = replace(small, tracker=replace(small.tracker, detection=detection))
    return {"bright": small, "marginal": with_detector(faint, exposure=0.013)}


class Sample(NamedTuple):
    """For each trial: spots, false spots, centroid error (pixel) of a star, attitude error
    (rad)."""

    spots: Floats
    false: Floats
    centroid: Floats
    across: Floats


def spots_in_frame(case: Case, attitude: Rotation, streams: Streams) -> Spots:
    return observe(case, attitude, streams).spots


def sample(
    case: Case, search: Callable[[Case, Rotation, Streams], Spots], seed: int, count: int
) -> Sample:
    """Trials with one way to obtain spots."""
    camera, indexes = case.believed_camera, PatternIndexes(open_sky(case.catalog).stars)
    rows = []
    for number in range(count):
        streams = Streams(seed, number)
        attitude = random_attitude(streams)
        spots = search(case, attitude, streams)
        _, estimate = identify_and_solve(spots, camera, indexes, case.tracker)
        outcome = judge(estimate, attitude, len(spots))
        pixel = camera.project(attitude.apply(indexes.stars.direction))
        pixel = pixel[camera.holds(pixel, NEAR)]
        found = np.column_stack([spots.x, spots.y])
        away, star = cKDTree(pixel).query(found)
        next_away = cKDTree(pixel).query(pixel[star], k=2)[0][:, 1]
        alone = np.flatnonzero((away < NEAR) & (next_away > ALONE))
        one = streams("one of the stars").choice(alone) if len(alone) else -1
        centroid = found[one, 0] - pixel[star[one], 0] if one >= 0 else np.nan
        across = math.nan if outcome.false else outcome.error_x
        rows.append((len(spots), (away > NEAR).sum(), centroid, across))
    return Sample(*np.array(rows, float).T)


def known(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def right(sample: Sample) -> tuple[int, int]:
    """Number of trials with a right attitude, and number with none."""
    solved = int(np.isfinite(sample.across).sum())
    return solved, len(sample.across) - solved


def p_values(one: Sample, other: Sample) -> dict[str, float]:
    """Rank tests for counts, Kolmogorov-Smirnov tests for measured values."""
    return {
        "spots": float(stats.mannwhitneyu(one.spots, other.spots).pvalue),
        "false": float(stats.mannwhitneyu(one.false, other.false).pvalue),
        "centroid": float(stats.ks_2samp(known(one.centroid), known(other.centroid)).pvalue),
        "across": float(stats.ks_2samp(known(one.across), known(other.across)).pvalue),
        "solved": float(stats.fisher_exact([right(one), right(other)])[1]),
    }


def laws(count: int, many: int) -> tuple[dict[str, float], Drawn]:
    figures: dict[str, float] = {}
    drawn: Drawn = {}
    worst = 1.0
    print(f"{'':10} {'':12} {'frame':>9} {'window':>9} {'spots':>9} {'covariance':>10} {'p':>8}")
    for name, case in designs().items():
        frames = sample(case, spots_in_frame, 21, count)
        windows = sample(case, spots_in_windows, 22, count)
        spots = run_trials(case, 24, range(count), Fidelity.SPOTS)
        known = run_trials(case, 23, range(many), Fidelity.COVARIANCE)
        others = spots, known
        errors = [np.where(each["false"], np.nan, each["error_x"]) for each in others]
        p = p_values(frames, windows)
        worst = min(worst, *p.values())
        both, told = (frames, windows), plan_spots(case).false
        errors = [frames.across, windows.across, *errors]
        table = {
            "spots": [each.spots.mean() for each in both]
            + [each["spots"].mean() for each in others],
            "false": [each.false.mean() for each in both] + [told, told],
            "centroid": [rms(each.centroid) for each in both] + [math.nan, math.nan],
            "across": [rms(each) / ARCSEC for each in errors],
            "solved": [float(np.isfinite(each).mean()) for each in errors],
        }
        for key, values in table.items():
            row = "".join(f" {value:9.4f}" for value in values)
            print(f"{name:10} {key:12}{row}   {p[key]:8.4f}", flush=True)
            figures[f"{name}_{key}_p"] = p[key]
        for fidelity, each in zip(list(Fidelity)[1:], errors[1:], strict=True):
            figures[f"{name}_{fidelity}_vs_frame_rms_ratio"] = rms(each) / rms(frames.across)
        drawn[name] = errors
    figures["window_vs_frame_p"] = min(1.0, worst * 10)
    figures["covariance_vs_frame_rms_ratio"] = figures["bright_covariance_vs_frame_rms_ratio"]
    return figures, drawn


def lost(count: int) -> dict[str, float]:
    """Fraction of correct attitudes in a design that loses most skies, and Fisher's test against
    frames."""
    case = with_detector(designs()["marginal"], exposure=LOST)
    found = {each: run_trials(case, 25, range(count), each) for each in Fidelity}
    solved = {kind: int((each["solved"] & ~each["false"]).sum()) for kind, each in found.items()}
    figures: dict[str, float] = {}
    for kind, each in solved.items():
        pair = [[solved[Fidelity.FRAME], count - solved[Fidelity.FRAME]], [each, count - each]]
        figures |= {f"few_{kind}_solved": each / count}
        figures |= {f"few_{kind}_solved_p": float(stats.fisher_exact(pair)[1])}
    print("\n" + "\n".join(f"{name:30} {value:8.4f}" for name, value in figures.items()))
    return figures


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(known(values) ** 2)))


def least(call: Callable[[int], object], count: int) -> float:
    """Shortest CPU time of a call, second."""
    return min(seconds(call, number) for number in range(count))


def seconds(call: Callable[[int], object], number: int) -> float:
    """CPU time of a call."""
    start = time.process_time()
    call(number)
    return time.process_time() - start


def rate(case: Case, fidelity: Fidelity, rounds: int) -> float:
    """Trials per second of CPU time, without the one-time cost of a design."""
    size, repeats = (1024, -(-rounds // 8)) if fidelity is Fidelity.COVARIANCE else (1, rounds)
    run_trials(case, 1, range(3), fidelity)
    return size / least(
        lambda n: run_trials(case, 1, range(n % 20, n % 20 + size), fidelity), repeats
    )


def look(case: Case, number: int) -> int:
    """Render and search the windows of a trial. Returns the number of spots."""
    streams = Streams(1, number)
    return len(spots_in_windows(case, random_attitude(streams), streams))


def speeds(rounds: int, side: int) -> dict[str, float]:
    """Time of a trial of each fidelity, and of rendering and searching 30 windows on a megapixel.

    side  1024 pixels of a megapixel
    """
    big = with_detector(EXAMPLE, columns=side, rows=side)
    thirty = replace(big, catalog=replace(big.catalog, limit_g=5.5))
    figures = {
        f"{name}_{fidelity}_trials_per_s": rate(case, fidelity, rounds)
        for name, case in (("example", EXAMPLE), ("megapixel", big))
        for fidelity in Fidelity
    }
    figures["covariance_trials_per_s"] = figures["example_covariance_trials_per_s"]
    fields = range(min(rounds, 20))
    figures["window_30_spots"] = float(np.mean([look(thirty, number) for number in fields]))
    # Alternately, because a field used twice in a row is still in the caches.
    times = [[seconds(partial(look, thirty), n) for n in fields] for _ in range(rounds // 20 + 1)]
    figures["window_30_ms"] = 1e3 * float(np.min(times, axis=0).mean())
    figures |= hot_pixels(rounds)
    plan_windows.cache_clear()
    plan_spots.cache_clear()
    figures["first_window_ms"] = 1e3 * least(lambda _: look(thirty, 0), 1)
    figures["first_covariance_ms"] = 1e3 * least(lambda _: plan_spots(EXAMPLE), 1)
    print("\n" + "\n".join(f"{name:38} {value:10.2f}" for name, value in figures.items()), "\n")
    return figures


def hot_pixels(rounds: int) -> dict[str, float]:
    """Time and error of a trial of the example with hot pixels, and with a dark map of them."""
    hot = with_detector(EXAMPLE, defects=Defects(dsnu=60.0, hot=1e-3, hot_current=3e3))
    known = replace(
        EXAMPLE.tracker, detection=replace(EXAMPLE.tracker.detection, dark_map=DarkMap())
    )
    cases = {"clean": EXAMPLE, "hot": hot, "hot_map": replace(hot, tracker=known)}
    figures: dict[str, float] = {}
    for name, case in cases.items():
        for fidelity in (Fidelity.FRAME, Fidelity.WINDOW):
            figures[f"{name}_{fidelity}_ms"] = 1e3 / rate(case, fidelity, rounds)
        errors = run_trials(case, 3, range(2 * rounds), Fidelity.WINDOW)
        good = errors["solved"] & ~errors["false"]
        figures[f"{name}_across_arcsec"] = rms(np.where(good, errors["error_x"], np.nan)) / ARCSEC
    return figures


@styled
def picture(path: Path, drawn: Drawn, figures: dict[str, float]) -> None:
    """Draw distributions of the attitude's error, and time against error."""
    plot = blank(10.5, "Errors of the fidelities on the same designs, and their cost")
    axes = plot.subplots(3, 1)
    for axis, (name, errors) in zip(axes, drawn.items(), strict=False):
        for fidelity, each, line in zip(Fidelity, errors, LINES, strict=False):
            size = np.sort(np.abs(known(each))) / ARCSEC
            beyond = 1 - np.arange(len(size)) / len(size)
            axis.plot(size, beyond, ls=line, label=f"{fidelity}, {len(size)} trials")
        axis.set(
            yscale="log",
            ylim=(1e-3, 1.2),
            ylabel="trials beyond (fraction)",
            xlabel="error across the boresight, one axis (arcsec)",
            title=f"{name} design",
        )
        legend_below(axis, 2)
    for marker, name in (("o", "example"), ("s", "megapixel")):
        rates = np.array([figures[f"{name}_{each}_trials_per_s"] for each in Fidelity])
        axes[2].semilogx(1e3 / rates, range(len(rates)), marker + "-", label=name)
    axes[2].set(
        yticks=range(len(Fidelity)),
        yticklabels=list(Fidelity),
        xlabel="CPU time of a trial (ms)",
        title="cost",
    )
    legend_below(axes[2], 2)
    save_picture(path, plot)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_options(parser)
    options = command.read(parser, trials=4)
    command.save(options, measure(options))


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--trials", type=int, default=TRIALS, help=f"number of trials (default: {TRIALS})"
    )
    parser.add_argument("--picture", type=Path, help="file for the picture of the fidelities")


def measure(options: argparse.Namespace) -> dict[str, float]:
    """All figures, and the picture."""
    figures = speeds(*(1, 256) if options.quick else (ROUNDS, 1024))
    more, drawn = laws(options.trials, 20 if options.quick else DRAWN)
    figures |= more | lost(options.trials)
    print(f"\nwindow_vs_frame_p {figures['window_vs_frame_p']:.3f}")
    if options.picture:
        picture(options.picture, drawn, figures)
    return figures


if __name__ == "__main__":
    command.run(main)
