"""How often are skies identified, how often falsely, how fast, and by whom?

Centroids of random skies, displaced by noise, some missing, false ones among them, are given to
startrack and, where it is installed, to tetra3rs, as it comes and with its tolerances tuned to
the noise. Both believe a focal length that is wrong by up to one percent. `within_reach` is the
share of skies for which the evidence of the true attitude, matched to the true stars, reaches
what startrack asks for: beyond it the sky does not hold the information.

    python experiments/identification.py [--json FILE] [--regimes few|all] [--skies 200]
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.attitude import Attitude, solve
from startrack.camera import Camera
from startrack.catalog import Selection, open_sky
from startrack.identification import (
    Identification,
    PatternIndex,
    build_index,
    cached_index,
    identify,
    track,
)
from startrack.identification.seen import first, see, usable
from startrack.identification.verify import weigh
from startrack.units import deg
from startrack.values import Spots, Stars

Floats = NDArray[np.float64]

LIMIT_G = {8: 6.5, 12: 6.0, 20: 5.0}  # field, degree: faintest star seen
TOLERANCE = 0.01  # of the focal length
MAGNITUDE_NOISE = 0.3
SIZE = 1024  # pixel, of a side
RESOLUTION = 2.0  # pixel, between spots
SETTINGS = Identification(focal_tolerance=TOLERANCE)


class Regime(NamedTuple):
    field: int  # degree
    noise: float  # pixel
    false: int
    missing: float


ALL = [Regime(*r) for r in product(LIMIT_G, (0.05, 0.2, 0.5, 1.0), (0, 5, 20), (0.0, 0.2))]
FEW = [regime for regime in ALL if regime[1:] in ((0.2, 0, 0.0), (0.2, 20, 0.2), (1.0, 20, 0.2))]


@dataclass(frozen=True)
class Seen:
    spots: Spots
    star: NDArray[np.int64]  # index into the catalogue, -1 for none
    icrs_to_camera: Rotation
    believed: Camera


@lru_cache
def design(field: int) -> tuple[Camera, Stars, PatternIndex]:
    """The tracker's catalogue goes one magnitude deeper than it sees."""
    stars = open_sky(Selection(limit_g=LIMIT_G[field] + 1)).stars
    camera = Camera.from_field_of_view(SIZE, SIZE, field * deg)
    return camera, stars, build_index(stars, field * deg)


def spots_at(pixel: Floats, flux: Floats, noise: float) -> Spots:
    n = len(pixel)
    covariance = np.tile(np.eye(2) * noise**2, (n, 1, 1))
    x, y = pixel.T.copy()
    return Spots(x, y, flux, covariance, np.full(n, 50.0), np.full(n, 9))


def sky(rng: np.random.Generator, regime: Regime) -> Seen:
    """A random attitude; false spots as bright as the true ones are."""
    camera, stars, _ = design(regime.field)
    icrs_to_camera = Rotation.from_quat(rng.standard_normal(4))
    direction = icrs_to_camera.apply(stars.direction)
    pixel = camera.project(direction)
    star = np.flatnonzero((direction[:, 2] > 0) & camera.holds(pixel))
    magnitude = stars.magnitude_g[star] + MAGNITUDE_NOISE * rng.standard_normal(len(star))
    kept = (magnitude < LIMIT_G[regime.field]) & (rng.random(len(star)) >= regime.missing)
    star, magnitude = star[kept], magnitude[kept]
    star, magnitude = blended(pixel[star], star, magnitude)
    pixel = pixel[star] + regime.noise * rng.standard_normal((len(star), 2))
    pixel = np.concatenate([pixel, SIZE * rng.random((regime.false, 2)) - 0.5])
    like = rng.choice(magnitude, regime.false) if len(star) else np.zeros(regime.false)
    magnitude = np.concatenate([magnitude, like])
    star = np.concatenate([star, np.full(regime.false, -1)])
    order = np.argsort(magnitude, kind="stable")
    believed = camera.scaled(1 / rng.uniform(1 - TOLERANCE, 1 + TOLERANCE))
    flux = 10 ** (-0.4 * magnitude[order])
    return Seen(spots_at(pixel[order], flux, regime.noise), star[order], icrs_to_camera, believed)


def blended(
    pixel: Floats, star: NDArray[np.int64], magnitude: Floats
) -> tuple[NDArray[np.int64], Floats]:
    """Of stars that no detector tells apart the brightest alone, which is kind to every solver."""
    order = np.argsort(magnitude, kind="stable")
    apart = np.linalg.norm(pixel[order, None] - pixel[order], axis=2)
    alone = np.array([(apart[i, :i] > RESOLUTION).all() for i in range(len(order))], bool)
    return star[order[alone]], magnitude[order[alone]]


def away(found: Rotation, seen: Seen) -> Floats:
    """Small rotation (3,) from truth, radian."""
    return (found * seen.icrs_to_camera.inv()).as_rotvec()


def wrong(found: Rotation, seen: Seen, regime: Regime) -> bool:
    across = math.hypot(*away(found, seen)[:2]) * seen.believed.focal_length_px
    return across > max(3, 6 * regime.noise)


def bound(seen: Seen, regime: Regime) -> Floats:
    """Standard deviations (3,), radian, of the best attitude from all stars, focal length known."""
    camera, stars, _ = design(regime.field)
    x, y, z = seen.icrs_to_camera.apply(stars.direction[seen.star[seen.star >= 0]]).T
    x, y = x / z, y / z
    rows = np.concatenate(
        [np.column_stack([-x * y, 1 + x * x, -y]), np.column_stack([-1 - y * y, x * y, x])]
    )
    sigma = regime.noise / camera.focal_length_px
    return np.sqrt(np.diag(np.linalg.pinv(rows.T @ rows))) * sigma


def within_reach(seen: Seen, regime: Regime) -> bool:
    """Whether the truth itself is evident enough, its faintest stars left out or not."""
    camera, stars, index = design(regime.field)
    every = see(seen.spots, usable(seen.spots), camera, SETTINGS)
    view = first(every, SETTINGS.verify_spots)
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
        evidence = weigh(
            view, voters, near, true[:fewest], taken[:fewest],
            distance[:fewest], seen.icrs_to_camera.as_matrix(), 1.0,
        )  # fmt: skip
        best = max(best, evidence)
    return best > -math.log(SETTINGS.max_false_probability)


Solver = Callable[[Seen], Rotation | None]


def ours(regime: Regime) -> Solver:
    _, stars, index = design(regime.field)

    def run(seen: Seen) -> Rotation | None:
        return identify(seen.spots, seen.believed, stars, index, SETTINGS).icrs_to_camera

    return run


def peers(regime: Regime) -> Iterator[tuple[str, Solver]]:
    """tetra3rs as it comes, and with the tolerances that the noise asks for."""
    try:
        import tetra3rs
    except ImportError:
        return
    database = _database(regime.field)
    tuned = {
        "match_radius": (4 * regime.noise + 1) / SIZE,
        "match_max_error": max(0.001, 6 * regime.noise / SIZE),
        "match_threshold": 1e-6,
    }
    for name, settings in (("tetra3rs", {}), ("tetra3rs tuned", tuned)):

        def run(seen: Seen, settings: dict[str, float] = settings) -> Rotation | None:
            centre = (SIZE - 1) / 2
            spots = seen.spots
            field = seen.believed.fov_x / deg
            answer = database.solve_from_centroids(
                np.column_stack([spots.x - centre, spots.y - centre, spots.flux]),
                fov_estimate_deg=field,
                fov_max_error_deg=1.1 * TOLERANCE * field,
                image_shape=(SIZE, SIZE),
                **settings,
            )
            if isinstance(answer, tetra3rs.SolveFailure):
                return None
            return Rotation.from_matrix(np.array(answer.rotation_matrix_icrs_to_camera))

        yield name, run


@lru_cache
def _database(field: int) -> Any:
    import tetra3rs

    return tetra3rs.SolverDatabase.generate_from_gaia(
        max_fov_deg=field, star_max_magnitude=LIMIT_G[field] + 1
    )


def measure(regime: Regime, skies: int, seed: int) -> dict[str, Any]:
    """One row a regime: every solver sees every sky, one after the other."""
    rng = np.random.default_rng(seed)
    solvers = {"startrack": ours(regime), **dict(peers(regime))}
    seconds: dict[str, list[float]] = {name: [] for name in solvers}
    solved, false = dict.fromkeys(solvers, 0), dict.fromkeys(solvers, 0)
    errors, reach = [], 0
    _, stars, index = design(regime.field)
    solvers["startrack"](sky(rng, regime))  # compiles
    for _ in range(skies):
        seen = sky(rng, regime)
        reach += within_reach(seen, regime)
        for name, solver in solvers.items():
            start = time.process_time()
            found = solver(seen)
            seconds[name].append(time.process_time() - start)
            if found is not None:
                mistaken = wrong(found, seen, regime)
                false[name] += mistaken
                solved[name] += not mistaken
        matches = identify(seen.spots, seen.believed, stars, index, SETTINGS)
        estimate = solve(seen.spots, matches, Attitude())
        if estimate.icrs_to_camera is not None and not wrong(estimate.icrs_to_camera, seen, regime):
            errors.append(away(estimate.icrs_to_camera, seen) / bound(seen, regime))
    row: dict[str, Any] = {**regime._asdict(), "within_reach": reach / skies}
    if errors:
        across, about = np.array(errors)[:, :2], np.array(errors)[:, 2]
        # The median square of a Gaussian is 0.455 of its variance; few outliers do not matter.
        row["error_over_bound"] = {
            "across": math.sqrt(float(np.median(across**2)) / 0.4549),
            "about": math.sqrt(float(np.median(about**2)) / 0.4549),
        }
    for name in solvers:
        row[name] = {
            "success": solved[name] / skies,
            "false_solutions": false[name],
            "median_ms": 1e3 * float(np.median(seconds[name])),
            "p99_ms": 1e3 * float(np.percentile(seconds[name], 99)),
        }
    return row


def brightest(spots: Spots, count: int) -> Spots:
    return Spots(*(getattr(spots, name)[:count] for name in spots.__dataclass_fields__))


def few_stars(count: int, skies: int) -> float:
    """Share solved from the brightest so many stars alone, at 12 deg, 0.2 pixel."""
    regime = Regime(12, 0.2, 0, 0.0)
    rng, run = np.random.default_rng(count), ours(regime)
    good = tried = 0
    while tried < skies:
        seen = sky(rng, regime)
        if len(seen.spots) >= count:
            tried += 1
            found = run(replace(seen, spots=brightest(seen.spots, count)))
            good += found is not None and not wrong(found, seen, regime)
    return good / skies


def tracked(count: int, skies: int, sigma: float = 0.05 * deg) -> float:
    """Share solved from so many stars, the attitude predicted with this sigma about each axis."""
    regime = Regime(12, 0.2, 0, 0.0)
    camera, stars, index = design(12)
    rng = np.random.default_rng(count)
    good = tried = 0
    while tried < skies:
        seen = sky(rng, regime)
        if len(seen.spots) < count:
            continue
        tried += 1
        predicted = Rotation.from_rotvec(sigma * rng.standard_normal(3)) * seen.icrs_to_camera
        spots = brightest(seen.spots, count)
        matches = track(spots, camera, stars, index, predicted, np.eye(3) * sigma**2, SETTINGS)
        found = matches.icrs_to_camera
        good += found is not None and not wrong(found, seen, regime)
    return good / skies


def random_points(frames: int) -> tuple[int, float]:
    """How many images of 30 random points are solved, and the longest time, ms."""
    camera, stars, index = design(12)
    rng = np.random.default_rng(5)
    solved, longest = 0, 0.0
    for _ in range(frames):
        spots = spots_at(SIZE * rng.random((30, 2)) - 0.5, np.geomspace(1, 0.01, 30), 0.2)
        start = time.process_time()
        solved += identify(spots, camera, stars, index, SETTINGS).icrs_to_camera is not None
        longest = max(longest, time.process_time() - start)
    return solved, 1e3 * longest


def index_figures() -> dict[str, float]:
    """Build, size and load of the index for 12 deg; least of three."""
    _, stars, index = design(12)

    def least(action: Callable[[], object]) -> float:
        times = []
        for _ in range(3):
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
        for name in ("startrack", "tetra3rs", "tetra3rs tuned")
        if name in row
    ]
    print(f"{regime}  reach {100 * row['within_reach']:5.1f} %  " + "   ".join(cells), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--regimes", choices=("few", "all"), default="few")
    parser.add_argument("--skies", type=int, default=200, help="a regime (default: 200)")
    options = parser.parse_args()
    rows = []
    for number, regime in enumerate(ALL if options.regimes == "all" else FEW):
        rows.append(measure(regime, options.skies, number))
        show(rows[-1])
    solved, longest = random_points(10 * options.skies)
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
        **index_figures(),
    }
    print(json.dumps({k: v for k, v in figures.items() if k != "regimes"}, indent=1))
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
