"""How often are skies identified, how often falsely, and how fast, by startrack and by others?

Centroids of random skies have noise, missing stars and false spots. They are given to startrack
and, if installed, to tetra3rs, with its defaults and with tolerances tuned to the noise, and to
cedar-solve, through the interpreter STARTRACK_CEDAR, for the fields of its database, 10 deg and
more. All programs have a focal length that is wrong by up to one percent. `within_reach` is the
fraction of skies where the evidence of the true attitude with the true stars reaches startrack's
threshold; other skies do not contain enough information.

    python experiments/identification.py [--json FILE] [--plot FILE] [--regimes few|all] [--quick]

`real_solved` needs STARTRACK_DATA, a folder of real images.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import command
import numpy as np
from scipy.spatial.transform import Rotation

from startrack import Spots, deg
from startrack.attitude import SolverSettings, solve
from startrack.benchmark import solving as cases
from startrack.core import Floats
from startrack.identification import (
    Agreed,
    build_index,
    cached_index,
    identify,
    keep_brightest,
    log_evidence_of_match,
    see,
    track,
    usable,
)
from startrack.plots import CYCLE, MARKERS, picture, save_picture, styled

CEDAR_SKIES = 20  # skies per regime: cedar-solve takes up to a second for a sky
SOLVERS = ("startrack", "tetra3rs", "tetra3rs tuned", "cedar-solve")


ALL = [
    cases.Regime(*r) for r in product(cases.LIMIT_G, (0.05, 0.2, 0.5, 1.0), (0, 5, 20), (0.0, 0.2))
]
FEW = [regime for regime in ALL if regime[1:] in ((0.2, 0, 0.0), (0.2, 20, 0.2), (1.0, 20, 0.2))]


def bound(seen: cases.BenchmarkView, regime: cases.Regime) -> Floats:
    """Standard deviations (3,), radian, of the best attitude from all stars, focal length known."""
    camera, stars, _ = cases.design(regime.field)
    x, y, z = seen.icrs_to_camera.apply(stars.direction[seen.star[seen.star >= 0]]).T
    x, y = x / z, y / z
    rows = np.concatenate(
        [np.column_stack([-x * y, 1 + x * x, -y]), np.column_stack([-1 - y * y, x * y, x])]
    )
    sigma = regime.noise / camera.focal_length_px
    return np.sqrt(np.diag(np.linalg.pinv(rows.T @ rows))) * sigma


def within_reach(seen: cases.BenchmarkView, regime: cases.Regime) -> bool:
    """Whether the true attitude has enough evidence, with or without its faintest stars."""
    camera, stars, index = cases.design(regime.field)
    every = see(seen.spots, usable(seen.spots), camera, cases.SETTINGS)
    view = keep_brightest(every, cases.SETTINGS.verify_spots)
    voters = index.bright
    direction = seen.icrs_to_camera.apply(stars.direction[voters.sky.member])
    near = np.flatnonzero((direction[:, 2] > 0) & camera.holds(camera.project(direction)))
    place = {int(star): i for i, star in enumerate(voters.sky.member[near])}
    true = np.array([i for i in range(len(view.plane)) if int(seen.star[i]) in place], np.int64)
    taken = np.array([place[int(seen.star[i])] for i in true], np.int64)
    expected = (camera.project(direction[near[taken]]) - camera.centre) / camera.focal_length_px
    distance = np.linalg.norm(view.plane[true] - expected, axis=1)
    best = 0.0
    for fewest in range(4, len(true) + 1):
        matrix, some = seen.icrs_to_camera.as_matrix(), slice(fewest)
        match = Agreed(true[some], taken[some], distance[some], matrix, 1.0)
        evidence = log_evidence_of_match(view, voters, near, match)
        best = max(best, evidence)
    return best > -math.log(cases.SETTINGS.max_false_probability)


Solver = Callable[[cases.BenchmarkView], tuple[Rotation | None, float]]  # and CPU seconds


def timed(solve: Callable[[cases.BenchmarkView], Rotation | None]) -> Solver:
    def run(seen: cases.BenchmarkView) -> tuple[Rotation | None, float]:
        start = time.process_time()
        found = solve(seen)
        return found, time.process_time() - start

    return run


def ours(regime: cases.Regime) -> Callable[[cases.BenchmarkView], Rotation | None]:
    _, stars, index = cases.design(regime.field)

    def run(seen: cases.BenchmarkView) -> Rotation | None:
        return identify(seen.spots, seen.believed, stars, index, cases.SETTINGS).icrs_to_camera

    return run


def peers(regime: cases.Regime) -> Iterator[tuple[str, Solver]]:
    """tetra3rs with defaults, and with tolerances for the noise; cedar-solve."""
    interpreter = os.environ.get("STARTRACK_CEDAR")
    if interpreter and regime.field >= 10:
        yield "cedar-solve", cedar(interpreter)
    if command.missing("tetra3rs is", "tetra3rs"):
        return
    database = database_of(regime.field, cases.LIMIT_G[regime.field] + 1)
    tunings: dict[str, dict[str, float]] = {"tetra3rs": {}, "tetra3rs tuned": tuned(regime.noise)}
    for name, settings in tunings.items():
        yield name, timed(tetra3rs_solver(database, settings))


def tuned(noise: float) -> dict[str, float]:
    """Settings of tetra3rs for a noise of centroids, pixel; chosen on these regimes."""
    return {
        "match_radius": (4 * noise + 1) / cases.SIZE,
        "match_max_error": max(0.001, 6 * noise / cases.SIZE),
        "match_threshold": 1e-6,
    }


def tetra3rs_solver(
    database: Any, settings: dict[str, float]
) -> Callable[[cases.BenchmarkView], Rotation | None]:
    import tetra3rs

    def run(seen: cases.BenchmarkView) -> Rotation | None:
        centre = (cases.SIZE - 1) / 2
        spots = seen.spots
        field = seen.believed.fov_x / deg
        answer = database.solve_from_centroids(
            np.column_stack([spots.x - centre, spots.y - centre, spots.flux]),
            fov_estimate_deg=field,
            fov_max_error_deg=1.1 * cases.TOLERANCE * field,
            image_shape=(cases.SIZE, cases.SIZE),
            **settings,
        )
        if isinstance(answer, tetra3rs.SolveFailure):
            return None
        return Rotation.from_matrix(np.array(answer.rotation_matrix_icrs_to_camera))

    return run


@lru_cache
def cedar(interpreter: str) -> Solver:
    """A solver in another process; only its boresight is judged, so the true roll is used."""
    worker = subprocess.Popen(
        [interpreter, str(Path(__file__).with_name("cedar_worker.py"))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
    )

    def run(seen: cases.BenchmarkView) -> tuple[Rotation | None, float]:
        assert worker.stdin is not None
        assert worker.stdout is not None
        field = seen.believed.fov_x / deg
        asked = {
            "row_column": np.column_stack([seen.spots.y, seen.spots.x]).tolist(),
            "size": [cases.SIZE, cases.SIZE],
            "field_deg": field,
            "field_error_deg": 1.1 * cases.TOLERANCE * field,
        }
        print(json.dumps(asked), file=worker.stdin, flush=True)
        ra, dec, seconds = json.loads(worker.stdout.readline())
        if ra is None:
            return None, seconds
        return pointed(ra * deg, dec * deg, seen), seconds

    return run


def pointed(ra: float, dec: float, seen: cases.BenchmarkView) -> Rotation:
    """The attitude of a boresight, radian, with the true roll."""
    x, y, z = seen.icrs_to_camera.apply(toward(ra, dec))
    off = np.array([y, -x, 0.0])  # turns that direction onto the boresight
    off *= math.atan2(math.hypot(x, y), z) / max(math.hypot(x, y), 1e-300)
    return Rotation.from_rotvec(off) * seen.icrs_to_camera


def toward(ra: float, dec: float) -> Floats:
    return np.array([math.cos(dec) * math.cos(ra), math.cos(dec) * math.sin(ra), math.sin(dec)])


@lru_cache
def database_of(field: int, limit: float) -> Any:
    """tetra3rs's database for a field, degree, with stars to a magnitude."""
    import tetra3rs

    return tetra3rs.SolverDatabase.generate_from_gaia(max_fov_deg=field, star_max_magnitude=limit)


def measure(regime: cases.Regime, skies: int, seed: int) -> dict[str, Any]:
    """One row per regime: every solver gets every sky."""
    rng = np.random.default_rng(seed)
    solvers = {"startrack": timed(ours(regime)), **dict(peers(regime))}
    seconds: dict[str, list[float]] = {name: [] for name in solvers}
    solved, false = dict.fromkeys(solvers, 0), dict.fromkeys(solvers, 0)
    errors, squares = [], []
    _, stars, index = cases.design(regime.field)
    every = [cases.sky(rng, regime) for _ in range(skies)]
    reach = sum(within_reach(seen, regime) for seen in every)
    # One solver after the other: alternating solvers would empty each other's caches.
    for name, solver in solvers.items():
        solver(every[0])  # compiles
        for seen in every[: CEDAR_SKIES if name == "cedar-solve" else None]:
            found, spent = solver(seen)
            seconds[name].append(spent)
            if found is not None:
                mistaken = cases.wrong(found, seen, regime)
                false[name] += mistaken
                solved[name] += not mistaken
    for seen in every:
        matches = identify(seen.spots, seen.believed, stars, index, cases.SETTINGS)
        estimate = solve(seen.spots, matches, SolverSettings(centroid_floor=0.0))
        if estimate.icrs_to_camera is not None and not cases.wrong(
            estimate.icrs_to_camera, seen, regime
        ):
            error = cases.away(estimate.icrs_to_camera, seen)
            errors.append(error / bound(seen, regime))
            squares.append(error @ np.linalg.solve(estimate.covariance, error) / 3)
    row: dict[str, Any] = {**regime._asdict(), "skies": skies, "within_reach": reach / skies}
    if errors:
        across, about = np.array(errors)[:, :2], np.array(errors)[:, 2]
        # The median square of a Gaussian is 0.455 of its variance; few outliers do not matter.
        row["error_over_bound"] = {
            "across": math.sqrt(float(np.median(across**2)) / 0.4549),
            "about": math.sqrt(float(np.median(about**2)) / 0.4549),
        }
        # The median of chi-square over its three degrees of freedom is 0.789.
        row["error_square_over_variance"] = float(np.median(squares)) / 0.7887
    for name in solvers:
        tried = len(seconds[name])
        row[name] = {
            "success": solved[name] / tried,
            "false_solutions": false[name],
            "median_ms": 1e3 * float(np.median(seconds[name])),
            "p99_ms": 1e3 * float(np.percentile(seconds[name], 99)),
        }
    return row


def brightest(spots: Spots, count: int) -> Spots:
    return Spots(*(getattr(spots, name)[:count] for name in spots.__dataclass_fields__))


def few_stars(count: int, skies: int) -> float:
    """Fraction solved from a number of the brightest stars alone, at 12 deg, 0.2 pixel."""
    regime = cases.Regime(12, 0.2, 0, 0.0)
    rng, run = np.random.default_rng(count), ours(regime)
    good = tried = 0
    while tried < skies:
        seen = cases.sky(rng, regime)
        if len(seen.spots) >= count:
            tried += 1
            found = run(replace(seen, spots=brightest(seen.spots, count)))
            good += found is not None and not cases.wrong(found, seen, regime)
    return good / skies


def tracked(count: int, skies: int, sigma: float = 0.05 * deg) -> float:
    """Fraction solved from a number of stars, with an attitude predicted with this sigma about each
    " "axis."""
    regime = cases.Regime(12, 0.2, 0, 0.0)
    camera, stars, index = cases.design(12)
    rng = np.random.default_rng(count)
    good = tried = 0
    while tried < skies:
        seen = cases.sky(rng, regime)
        if len(seen.spots) < count:
            continue
        tried += 1
        predicted = Rotation.from_rotvec(sigma * rng.standard_normal(3)) * seen.icrs_to_camera
        spots = brightest(seen.spots, count)
        matches = track(
            spots, camera, stars, index, predicted, np.eye(3) * sigma**2, cases.SETTINGS
        )
        found = matches.icrs_to_camera
        good += found is not None and not cases.wrong(found, seen, regime)
    return good / skies


def random_points(frames: int) -> tuple[int, float]:
    """Number of solved images of 30 random points, and the longest time, ms."""
    camera, stars, index = cases.design(12)
    rng = np.random.default_rng(5)
    solved, longest = 0, 0.0
    for _ in range(frames):
        spots = cases.spots_at(
            cases.SIZE * rng.random((30, 2)) - 0.5, np.geomspace(1, 0.01, 30), 0.2
        )
        start = time.process_time()
        solved += identify(spots, camera, stars, index, cases.SETTINGS).icrs_to_camera is not None
        longest = max(longest, time.process_time() - start)
    return solved, 1e3 * longest


def index_figures(rounds: int) -> dict[str, float]:
    """Time to build, size, and time to load the index for 12 deg; shortest of some rounds."""
    _, stars, index = cases.design(12)

    def least(action: Callable[[], object]) -> float:
        times = []
        for _ in range(rounds):
            start = time.process_time()
            action()
            times.append(time.process_time() - start)
        return min(times)

    with tempfile.TemporaryDirectory() as folder:
        cached_index(stars, 12 * deg, Path(folder))
        return {
            "index_build_s": least(lambda: build_index(stars, 12 * deg)),
            "index_mb": index.size / 1e6,
            "index_load_ms": 1e3 * least(lambda: cached_index(stars, 12 * deg, Path(folder))),
        }


def show(row: dict[str, Any]) -> None:
    regime = (
        f"{row['field']:3} deg {row['noise']:4} px {row['false']:3} false "
        f"{row['missing']:3} missing"
    )
    cells = [
        f"{name} {100 * row[name]['success']:5.1f} % {row[name]['false_solutions']} false "
        f"{row[name]['median_ms']:5.2f} / {row[name]['p99_ms']:6.1f} ms"
        for name in SOLVERS
        if name in row
    ]
    print(f"{regime}  reach {100 * row['within_reach']:5.1f} %  " + "   ".join(cells), flush=True)


@styled
def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Success and time over the regimes, for each solver."""
    place = np.arange(len(rows))
    figure = picture(
        8.5, f"Identification from centroids, {rows[0]['skies']} random skies a regime"
    )
    above, below = figure.subplots(2, 1, sharex=True)
    for name, colour, mark in zip(SOLVERS, CYCLE, MARKERS, strict=False):
        at = np.array([i for i in place if name in rows[i]])
        if not len(at):
            continue
        answers = [rows[i][name] for i in at]
        above.plot(
            at, [100 * a["success"] for a in answers], f"{mark}-", ms=4, color=colour, label=name
        )
        below.plot(at, [a["median_ms"] for a in answers], f"{mark}-", ms=4, color=colour)
        below.plot(at, [a["p99_ms"] for a in answers], ":", color=colour)
    reach = [100 * row["within_reach"] for row in rows]
    above.plot(place, reach, "k_", label="the sky holds the information")
    above.set(ylabel="solved (%)", ylim=(0, 109))
    below.set(yscale="log", ylabel="processor time (ms)\nline: median, dots: 99 %")
    labels = [f"{r['noise']:g} px, {r['false']} false, {100 * r['missing']:g} %" for r in rows]
    below.set_xticks(place, labels, rotation=90, fontsize=7)
    below.set_xlabel("noise of the centroids, false spots, fraction of true ones missing")
    for field in {row["field"] for row in rows}:
        first = min(i for i in place if rows[i]["field"] == field)
        above.axvline(first - 0.5, color="0.7", lw=0.5)
        below.axvline(first - 0.5, color="0.7", lw=0.5)
        above.text(first - 0.3, 103, f"{field} deg", fontsize=9)
    figure.legend(*above.get_legend_handles_labels(), loc="outside lower left", ncols=3)
    save_picture(path, figure)


def real_solved(images: int | None) -> int | None:
    """Number of real images that `startrack solve` solves, of images solved by others; None without
    the images.

    images   number of tried images; None: all
    """
    folder = command.images("the real images are")
    if folder is None:
        return None
    from photographs import right

    return sum(right(folder, images))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="file for the picture of success and time"
    )
    parser.add_argument("--regimes", choices=("few", "all"), default="few")
    parser.add_argument(
        "--skies", type=int, default=200, help="number of skies of each regime (default: 200)"
    )
    options = command.read(parser, skies=2)
    rows = []
    regimes = ALL if options.regimes == "all" else FEW
    if options.quick:
        regimes = [regime for regime in FEW if regime.field == 12][:1]
    for number, regime in enumerate(regimes):
        rows.append(measure(regime, options.skies, number))
        show(rows[-1])
    solved, longest = random_points((1 if options.quick else 10) * options.skies)
    mine = [row["startrack"] for row in rows]
    over = [row["error_over_bound"]["across"] for row in rows if "error_over_bound" in row]
    figures = {
        "regimes": rows,
        "min_success": min(m["success"] for m in mine),
        "false_solutions": sum(m["false_solutions"] for m in mine),
        "random_points_solved": solved,
        "random_points_max_ms": longest,
        "max_median_ms": max(m["median_ms"] for m in mine),
        "max_p99_ms": max(m["p99_ms"] for m in mine),
        "four_star_success": few_stars(4, options.skies),
        "five_star_success": few_stars(5, options.skies),
        "track2_success": tracked(2, options.skies),
        "track3_success": tracked(3, options.skies),
        "error_over_bound_median": float(np.median(over)),
        **index_figures(1 if options.quick else 3),
        "real_solved": real_solved(1 if options.quick else None),
    }
    squares = [r["error_square_over_variance"] for r in rows if "error_square_over_variance" in r]
    figures["error_square_over_variance_median"] = float(np.median(squares))
    if options.plot:
        draw(rows, options.plot)
    print(json.dumps({k: v for k, v in figures.items() if k != "regimes"}, indent=1))
    command.save(options, figures)


if __name__ == "__main__":
    command.run(main)
