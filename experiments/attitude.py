"""How right and how fast are the attitude solvers, and how near do the bounds come to trials?

Five questions, each with one table: which of 98 solvable cases with 60-digit solutions each
solver misses (by more than 50 eps sqrt(condition)); what it costs for each star and attitude, and
its error, in double and in single precision, beside scipy's `align_vectors`; what errors the
scenarios of Markley and Mortari (2000) give; how near the analytic attitude error of random fields
comes to trials; whether the covariance that a tracker states of rendered frames is that of its
errors (normalised error squared, 3 where it is).

    python experiments/attitude.py [--trials N] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import one_thread  # noqa: F401  # isort: skip
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.attitude import Observability, align, davenport, foam, quest, svd
from startrack.catalog import shipped
from startrack.chain import trial
from startrack.design import load_design
from startrack.error import attitude_bound
from startrack.units import arcsec, deg

Floats = NDArray[np.float64]
Solver = Callable[[Any, Any, Any], Rotation]

ORACLE = Path(__file__).parents[1] / "tests/oracle/wahba_cases.json"
EPS = 2.0**-52
STARS = 15
BATCH = 4000
REPEATS = 7
NOISE = 6 * arcsec


def aligned(b: Floats, r: Floats, w: Floats) -> Rotation:
    """`align` with the face of the textbook solvers."""
    if b.ndim == 2:
        return align(b[None], r[None], w[None]).source_to_target[0]
    return align(b, r, w).source_to_target


def scipy_one_by_one(b: Floats, r: Floats, w: Floats) -> Rotation:
    """What users of scipy have."""
    if b.ndim == 2:
        return Rotation.align_vectors(b, r, w)[0]
    return Rotation.concatenate(
        [Rotation.align_vectors(*each)[0] for each in zip(b, r, w, strict=True)]
    )


SOLVERS: dict[str, Solver] = {
    "align": aligned,
    "svd": svd,
    "davenport": davenport,
    "quest": quest,
    "foam": foam,
    "scipy": scipy_one_by_one,
}


def hard_cases() -> dict[str, Any]:
    """Cases missed by each solver, the worst error over eps sqrt(condition), what is flagged."""
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


def fields(many: int, stars: int, half: float, noise: float, seed: int) -> tuple[Any, ...]:
    """True attitudes, and observed (with noise) and reference vectors, over square fields."""
    rng = np.random.default_rng(seed)
    truth = Rotation.from_quat(rng.standard_normal((many, 4)))
    plane = rng.uniform(-np.tan(half), np.tan(half), (many, stars, 2))
    seen = unit(np.concatenate([plane, np.ones((many, stars, 1))], axis=2))
    reference = np.einsum("mji,mnj->mni", truth.as_matrix(), seen)
    return truth, unit(seen + noise * rng.standard_normal(seen.shape)), reference


def unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def speed() -> list[dict[str, Any]]:
    """Time for each star and attitude, and error without noise, of each solver and precision.

    Solvers take turns in each repeat; the least of the repeats counts.
    """
    truth, b, r = fields(BATCH, STARS, 10 * deg, 0.0, 1)
    w = np.full((BATCH, STARS), NOISE**-2)
    runs = []
    for kind in (np.float64, np.float32):
        vectors = tuple(each.astype(kind) for each in (b, r, w))
        for name, solver in SOLVERS.items():
            if kind is np.float64 or name not in ("align", "scipy"):  # these compute in double
                runs.append((name, kind.__name__, solver, vectors))
    best, errors = [np.inf] * len(runs), [0.0] * len(runs)
    for _ in range(REPEATS):
        for k, (_, _, solver, vectors) in enumerate(runs):
            start = time.process_time()
            got = solver(*vectors)
            best[k] = min(best[k], time.process_time() - start)
            errors[k] = float(np.sqrt(((got * truth.inv()).magnitude() ** 2).mean()))
    return [
        {
            "solver": name,
            "precision": kind,
            "us_per_star": best[k] / BATCH / STARS * 1e6,
            "us_per_attitude": best[k] / BATCH * 1e6,
            "error_rms_rad": errors[k],
            "covariance": name == "align",
        }
        for k, (name, kind, _, _) in enumerate(runs)
    ]


def unequal(side: float) -> Floats:
    """Unit vectors of Markley and Mortari's second and third scenario."""
    return unit(np.array([[1, 0, 0], [side, 0.07584, 0], [side, -0.07584, 0]]))


CROSS = unit(
    np.array([[1, 0, 0], *([0.99712, *yz] for yz in 0.07584 * np.array([*np.eye(2), *-np.eye(2)]))])
)
SCENARIOS = {
    "1": (CROSS, np.full(5, 6 * arcsec), np.full(5, 6 * arcsec)),
    "2": (unequal(-0.99712), np.array([arcsec, deg, deg]), np.array([arcsec, deg, deg])),
    "3": (unequal(-0.99712), np.array([1, 0.1, 0.1]) * deg, np.full(3, 0.1 * deg)),
}


def scenario(name: str, trials: int = 5000) -> dict[str, Any]:
    """Errors (arcsec, about the body's axes, the first is the boresight) and loss."""
    body, noise, stated = SCENARIOS[name]
    rng = np.random.default_rng(int(name))
    truth = Rotation.from_quat(rng.standard_normal((trials, 4)))
    reference = np.einsum("mji,nj->mni", truth.as_matrix(), body)
    reference = unit(reference + noise[:, None] * rng.standard_normal(reference.shape))
    weight = np.broadcast_to(stated**-2, reference.shape[:2])
    got = align(np.broadcast_to(body, reference.shape), reference, weight)
    error = (got.source_to_target * truth.inv()).as_rotvec()
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(got.covariance), error)
    return {
        "rms_arcsec": (np.sqrt((error**2).mean(axis=0)) / arcsec).tolist(),
        "stated_arcsec": (np.sqrt(np.diagonal(got.covariance.mean(axis=0))) / arcsec).tolist(),
        "loss": float(got.loss.mean()),
        "expected_loss": len(body) - 1.5,
        "nees": float(nees.mean()),
    }


def bounds() -> list[dict[str, Any]]:
    """Analytic attitude error of random square fields beside trials, arcsec."""
    rows = []
    for field, stars in ((20, 10), (20, 20), (14, 15), (10, 8), (8, 5)):
        truth, b, r = fields(20_000, stars, field * deg / 2, NOISE, field)
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


def rendered(trials: int) -> dict[str, float]:
    """Normalised error squared of rendered frames of the nanosatellite's tracker."""
    case = load_design(shipped("designs/nanosatellite.toml")).case
    outcomes = [trial(case, 5, number) for number in range(trials)]
    nees = np.array([each.nees for each in outcomes if each.solved and not each.false])
    return {
        "trials": trials,
        "solved": len(nees),
        "nees": float(nees.mean()),
        "nees_sigma": float(nees.std(ddof=1) / np.sqrt(len(nees))),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--json", type=Path, help="write the numbers to this file")
    parser.add_argument("--trials", type=int, default=1000, help="rendered frames (1000)")
    arguments = parser.parse_args()
    _, b, r = fields(2, 3, 0.1, 0.0, 0)
    aligned(b, r, np.ones((2, 3)))  # compile
    hard, rows, near = hard_cases(), speed(), bounds()
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
    frames = rendered(arguments.trials)
    print(
        f"\nrendered frames: {frames['solved']} of {frames['trials']} solved, normalised error "
        f"squared {frames['nees']:.3f} +- {frames['nees_sigma']:.3f}"
    )
    if arguments.json:
        figures = {
            "wahba_cases_missed": hard["missed"]["align"],
            "wahba_cases_missed_by_solver": hard["missed"],
            "wahba_unobservable_flagged": hard["flagged"],
            "mm1_sigma_arcsec": runs["1"]["rms_arcsec"],
            "mm1_loss": runs["1"]["loss"],
            "nees": frames["nees"],
            "nees_sigma": frames["nees_sigma"],
            "nees_of_vectors": runs["1"]["nees"],
            "markley_mortari": runs,
            "batch_us_per_star": rows[0]["us_per_star"],
            "solvers": rows,
            "attitude_bound": near,
        }
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
