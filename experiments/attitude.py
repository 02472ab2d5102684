"""How exact and how fast are the attitude solvers, and do bounds and budgets agree with trials?

Seven tables:

1. Cases that each solver misses by more than 50 eps sqrt(condition), of 98 that have a solution
   with 60 digits.
2. CPU time of each solver per star and per attitude, and its error, in double and in single
   precision, beside scipy's `align_vectors`.
3. Errors in the scenarios of Markley and Mortari (2000).
4. Analytic attitude error of random fields, beside trials.
5. Normalised error squared of the covariance that a tracker states for rendered frames, of several
   designs; it is 3 if the covariance agrees with the errors.
6. Analytic error budget of five published trackers, beside trials: the total by many windows, each
   cause by fewer frames.
7. Predictions for trackers that flew, beside published figures.

    python experiments/attitude.py [--trials N] [--members N] [--json FILE] [--quick]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from startrack.core import Floats

import one_thread  # noqa: F401  # isort: skip
import command
import numpy as np
from markley_mortari import SCENARIOS, scenario
from scipy.spatial.transform import Rotation
from validation import show, validation

from startrack import Case, Fidelity, arcsec, deg, load_design, shipped
from startrack import run_trials as outcomes_of
from startrack.attitude import Observability, align
from startrack.benchmark import solving as solving_cases
from startrack.budget import analytic, measured
from startrack.metrics import attitude_bound
from startrack.montecarlo import Serial

ORACLE = Path(__file__).parents[1] / "tests/oracle/wahba_cases.json"
EPS = 2.0**-52
STARS = 15
BATCH, REPEATS = 4000, 7  # attitudes at once, and how often
BOUNDED = 20_000  # fields of a row of the bounds
NOISE = 6 * arcsec
TRACKERS = ("rigel-l", "st5000", "apst", "rufino-2013", "altair-hb")


def scipy_one_by_one(b: Floats, r: Floats, w: Floats) -> Rotation:
    """The solver that users of scipy have, with one attitude per call."""
    if b.ndim == 2:
        return Rotation.align_vectors(b, r, w)[0]
    return Rotation.concatenate(
        [Rotation.align_vectors(*each)[0] for each in zip(b, r, w, strict=True)]
    )


SOLVERS: dict[str, solving_cases.Solver] = solving_cases.SOLVERS | {"scipy": scipy_one_by_one}


def hard_cases() -> dict[str, Any]:
    """Cases that each solver misses, its worst error over eps sqrt(condition), and flagged
    cases."""
    cases = json.loads(ORACLE.read_text())["cases"]
    missed, worst = {}, {}
    for name, solver in SOLVERS.items():
        ratios = []
        for case in (case for case in cases if case["observable"]):
            try:
                got = solver(*(np.array(case[key]) for key in ("b", "r", "weight")))
            except ValueError:
                ratios.append(np.inf)
                continue
            error = (got * Rotation.from_matrix(case["A"]).inv()).magnitude()
            ratios.append(error / (EPS * np.sqrt(case["info_cond"])))
        missed[name] = int((np.array(ratios) > 50).sum())
        worst[name] = float(max(ratios))
    flagged = sum(
        align(*(np.array(case[key])[None] for key in ("b", "r", "weight"))).observability[0]
        != Observability.OBSERVED
        for case in cases
        if not case["observable"]
    )
    return {"missed": missed, "worst": worst, "flagged": int(flagged)}


def speed(batch: int, repeats: int) -> list[dict[str, Any]]:
    """Time for each star and attitude, and error without noise, for each solver and precision.

    Solvers alternate in each repeat; the shortest of the repeats counts.
    """
    truth, b, r = solving_cases.fields(batch, STARS, 10 * deg, 0.0, 1)
    w = np.full((batch, STARS), NOISE**-2)
    runs = []
    for kind in (np.float64, np.float32):
        vectors = tuple(each.astype(kind) for each in (b, r, w))
        for name, solver in SOLVERS.items():
            if kind is np.float64 or name not in ("align", "scipy"):  # these compute in double
                runs.append((name, kind.__name__, solver, vectors))
    best, errors = [np.inf] * len(runs), [0.0] * len(runs)
    for _ in range(repeats):
        for k, (_, _, solver, vectors) in enumerate(runs):
            start = time.process_time()
            got = solver(*vectors)
            best[k] = min(best[k], time.process_time() - start)
            errors[k] = float(np.sqrt(((got * truth.inv()).magnitude() ** 2).mean()))
    return [
        {
            "solver": name,
            "precision": kind,
            "us_per_star": best[k] / batch / STARS * 1e6,
            "us_per_attitude": best[k] / batch * 1e6,
            "error_rms_rad": errors[k],
            "covariance": name == "align",
        }
        for k, (name, kind, _, _) in enumerate(runs)
    ]


def bounds(trials: int) -> list[dict[str, Any]]:
    """Analytic attitude error of random square fields compared with trials, arcsec."""
    rows = []
    for field, stars in ((20, 10), (20, 20), (14, 15), (10, 8), (8, 5)):
        truth, b, r = solving_cases.fields(trials, stars, field * deg / 2, NOISE, field)
        got = align(b, r, np.full(b.shape[:2], NOISE**-2)).source_to_target
        error = np.sqrt(((got * truth.inv()).as_rotvec() ** 2).mean(axis=0))
        stated = np.array(attitude_bound(field * deg, field * deg, stars, NOISE))
        rows.append(
            {
                "field_deg": field,
                "stars": stars,
                "trials_arcsec": (error / arcsec).tolist(),
                "analytic_arcsec": (stated / arcsec).tolist(),
                "difference": float(np.abs(stated / error - 1).max()),
            }
        )
    return rows


def rendered(case: Case, trials: int) -> dict[str, float]:
    """For rendered windows of a design: normalised error squared and its standard error; errors
    across and about, arcsec, with the relative standard error of each; and the stated errors."""
    outcomes = outcomes_of(case, 5, range(trials), Fidelity.WINDOW)
    good = outcomes["solved"] & ~outcomes["false"]
    nees = outcomes["nees"][good]
    square, stated = (
        np.stack([outcomes[f"{kind}_{axis}"][good] for axis in "xyz"]) ** 2 / arcsec**2
        for kind in ("error", "sigma")
    )
    across, about = square[:2].mean(axis=0), square[2]
    return {
        "across_arcsec": float(np.sqrt(across.mean())),
        "across_sigma": float(across.std() / across.mean() / np.sqrt(4 * len(nees))),
        "about_arcsec": float(np.sqrt(about.mean())),
        "about_sigma": float(about.std() / about.mean() / np.sqrt(4 * len(nees))),
        "stated_across_arcsec": float(np.sqrt(stated[:2].mean())),
        "stated_about_arcsec": float(np.sqrt(stated[2].mean())),
        "trials": trials,
        "solved": int(good.sum()),
        "nees": float(nees.mean()),
        "nees_sigma": float(nees.std(ddof=1) / np.sqrt(len(nees))),
        "nees_median": float(np.median(nees)),
    }


def designs(published: Sequence[str]) -> dict[str, Case]:
    """The example, and published trackers."""
    files = {"nanosatellite": "designs/noise_only.toml"}
    files |= {name: f"trackers/{name}.toml" for name in published}
    return {name: load_design(shipped(file)).case for name, file in files.items()}


def budgets(cases: Mapping[str, Case], members: int) -> list[dict[str, Any]]:
    """The analytic budget of each design against trials: each cause, and end to end, arcsec.

    A cause counts if it makes a tenth of the total or more.
    """
    rows = []
    for name, case in cases.items():
        start = time.process_time()
        expected = analytic(case)
        spent = time.process_time() - start
        found = measured(case, members, 1, Serial())
        beside = {one.name: one for one in expected.lines} | {"end to end": expected.whole}
        for one in (*found.lines, found.whole):
            mine = beside[one.name]
            pairs = [(mine.across, one.across, found.across), (mine.about, one.about, found.about)]
            counts = [abs(a / b - 1) for a, b, all_ in pairs if max(a, b) > 0.1 * all_]
            rows.append(
                {
                    "design": name,
                    "cause": one.name,
                    "analytic_arcsec": [mine.across / arcsec, mine.about / arcsec],
                    "measured_arcsec": [one.across / arcsec, one.about / arcsec],
                    "difference": max(counts, default=0.0),
                    "sigma": uncertainty(one.spread.error[:, 0]),
                    "sum_over_whole": found.sum[0] / found.across,
                    "analytic_s": spent,
                }
            )
    return rows


def uncertainty(error: Floats) -> float:
    """Relative standard error of an rms about the boresight, where it is larger than across."""
    square = error[:, 2] ** 2
    return float(square.std() / max(square.mean(), 1e-300) / np.sqrt(4 * len(square)))


def difference(frame: dict[str, float]) -> float:
    """The larger difference, across or about, between the analytic error and the error of
    windows."""
    return max(
        abs(frame[f"analytic_{way}_arcsec"] / frame[f"{way}_arcsec"] - 1)
        for way in ("across", "about")
    )


def largest(rows: list[dict[str, Any]], cause: str | None) -> float:
    """The largest difference of the published trackers, of one cause or of all."""
    return max(
        row["difference"]
        for row in rows
        if row["design"] in TRACKERS and (cause is None or row["cause"] == cause)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument(
        "--trials", type=int, default=5000, help="number of rendered windows (default: 5000)"
    )
    parser.add_argument(
        "--members", type=int, default=250, help="trials of each budget (default: 250)"
    )
    options = command.read(parser, trials=6, members=2)
    quick = options.quick
    cases = designs(TRACKERS[:1] if quick else TRACKERS)
    _, b, r = solving_cases.fields(2, 3, 0.1, 0.0, 0)
    solving_cases.aligned(b, r, np.ones((2, 3)))  # compile
    hard, rows = hard_cases(), speed(*((20, 1) if quick else (BATCH, REPEATS)))
    near = bounds(50 if quick else BOUNDED)
    runs = {name: scenario(name) for name in SCENARIOS}

    print("solver     missed of 98   worst error / (eps sqrt(condition))")
    for name in SOLVERS:
        print(f"{name:10} {hard['missed'][name]:8}      {hard['worst'][name]:14.3g}")
    print(f"unobservable cases flagged by align: {hard['flagged']} of 4\n")
    print(f"{STARS} stars in 20 degrees, no noise, one thread")
    print("solver     precision   us / star   us / attitude   error rms, rad")
    for row in rows:
        print(
            f"{row['solver']:10} {row['precision']:9} {row['us_per_star']:11.3f}"
            f"{row['us_per_attitude']:16.2f}{row['error_rms_rad']:17.2g}"
            f"{'   with covariance' if row['covariance'] else ''}"
        )
    print("\nMarkley and Mortari   rms, arcsec   stated, arcsec   loss (expected)   NEES")
    for name, run in runs.items():
        print(
            name,
            "  ".join(f"{value:.5g}" for value in run["rms_arcsec"]),
            "|",
            "  ".join(f"{value:.5g}" for value in run["stated_arcsec"]),
            f"| {run['loss']:.3f} ({run['expected_loss']}) | {run['nees']:.3f}",
        )
    print("\nfield, stars   trials x y z, arcsec   analytic x y z, arcsec   largest difference")
    for row in near:
        print(
            f"{row['field_deg']:3} deg {row['stars']:3}   ",
            "  ".join(f"{value:.4g}" for value in row["trials_arcsec"]),
            "|",
            "  ".join(f"{value:.4g}" for value in row["analytic_arcsec"]),
            f"| {row['difference']:.2%}",
        )
    print("\nrendered windows    solved   normalised error squared (3)   median (2.37)")
    frames = {}
    for name, case in cases.items():
        frame = frames[name] = rendered(case, options.trials)
        expected = analytic(case)
        frame["analytic_across_arcsec"] = expected.across / arcsec
        frame["analytic_about_arcsec"] = expected.about / arcsec
        print(
            f"{name:18}{frame['solved']:5} of {frame['trials']:<5}{frame['nees']:8.3f} +- "
            f"{frame['nees_sigma']:.3f}{frame['nees_median']:20.3f}",
            flush=True,
        )
    print("\nend to end, arcsec   analytic across, about   windows             ratio")
    for name, frame in frames.items():
        ratios = (
            f"{frame[f'analytic_{way}_arcsec'] / frame[f'{way}_arcsec']:8.3f} +- "
            f"{frame[f'{way}_sigma']:.3f}"
            for way in ("across", "about")
        )
        print(
            f"{name:20}{frame['analytic_across_arcsec']:10.3f}{frame['analytic_about_arcsec']:10.3f}"
            f"{frame['across_arcsec']:13.3f}{frame['about_arcsec']:10.3f}{''.join(ratios)}"
        )
    print("\nbudget, arcsec        cause             analytic across, about   measured")
    table = budgets(cases, options.members)
    for row in table:
        told = (
            f"   {row['difference']:.0%} +- {row['sigma']:.0%}" if row["difference"] > 0.1 else ""
        )
        print(
            f"{row['design']:20}{row['cause']:20}"
            + "".join(
                f"{value:10.3f}" for value in (*row["analytic_arcsec"], *row["measured_arcsec"])
            )
            + told
        )
    whole = max(difference(frames[name]) for name in cases if name in TRACKERS)
    print(f"largest difference of the published trackers end to end, over all windows {whole:.1%}")
    print(f"over the members of the measured budgets {largest(table, 'end to end'):.1%}\n")
    known = validation(quick)
    show(known)
    figures = {
        "wahba_cases_missed": hard["missed"]["align"],
        "wahba_cases_missed_by_solver": hard["missed"],
        "wahba_unobservable_flagged": hard["flagged"],
        "mm1_sigma_arcsec": runs["1"]["rms_arcsec"],
        "mm1_loss": runs["1"]["loss"],
        "nees": frames["nanosatellite"]["nees"],
        "nees_sigma": frames["nanosatellite"]["nees_sigma"],
        "nees_by_design": frames,
        "budget_max_relative_difference": whole,
        "budget_max_relative_difference_of_members": largest(table, "end to end"),
        "budget_max_relative_difference_of_a_cause": largest(table, None),
        "budgets": table,
        "sky_20deg_v6_mean": next(row["predicted"] for row in known if row["name"] == "sky"),
        "validation": known,
        "nees_of_vectors": runs["1"]["nees"],
        "markley_mortari": runs,
        "batch_us_per_star": rows[0]["us_per_star"],
        "solvers": rows,
        "attitude_bound": near,
    }
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
