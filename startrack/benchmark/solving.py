"""Identification of random skies; attitudes of exact unit vectors."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude import align, davenport, foam, quest, svd
from startrack.benchmark.stage import BenchmarkStage
from startrack.catalog import Selection, open_sky
from startrack.core import Camera, Floats, Ints, Spots, Stars, deg
from startrack.identification import Identification, PatternIndex, build_index, identify

LIMIT_G = {8: 6.5, 12: 6.0, 20: 5.0}  # field, degree: faintest detected star
TOLERANCE = 0.01  # of the focal length
MAGNITUDE_NOISE = 0.3
SIZE = 1024  # pixel, of a side
RESOLUTION = 2.0  # pixel, between spots
SETTINGS = Identification(focal_tolerance=TOLERANCE)


class Regime(NamedTuple):
    """Difficulty of skies: centroid noise, false spots, missing fraction of the true stars."""

    field: int  # degree
    noise: float  # pixel
    false: int
    missing: float


@dataclass(frozen=True)
class BenchmarkView:
    """The spots of one random attitude, and the truth."""

    spots: Spots
    star: Ints  # index into the catalogue, -1 for none
    icrs_to_camera: Rotation
    believed: Camera


@lru_cache
def design(field: int) -> tuple[Camera, Stars, PatternIndex]:
    """The tracker's catalogue is one magnitude deeper than its detection limit."""
    stars = open_sky(Selection(limit_g=LIMIT_G[field] + 1)).stars
    camera = Camera.from_field_of_view(SIZE, SIZE, field * deg)
    return camera, stars, build_index(stars, field * deg)


def spots_at(pixel: Floats, flux: Floats, noise: float) -> Spots:
    """Spots at pixels (n, 2), with the given brightness and equal noise."""
    n = len(pixel)
    covariance = np.tile(np.eye(2) * noise**2, (n, 1, 1))
    x, y = pixel.T.copy()
    return Spots(x, y, flux, covariance, np.full(n, 50.0), np.full(n, 9))


def sky(rng: np.random.Generator, regime: Regime) -> BenchmarkView:
    """Spots at a random attitude; false ones with the brightness distribution of the true ones."""
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
    return BenchmarkView(
        spots_at(pixel[order], flux, regime.noise), star[order], icrs_to_camera, believed
    )


def blended(pixel: Floats, star: Ints, magnitude: Floats) -> tuple[Ints, Floats]:
    """Keep only the brightest of stars that are too close to be resolved."""
    order = np.argsort(magnitude, kind="stable")
    apart = np.linalg.norm(pixel[order, None] - pixel[order], axis=2)
    alone = np.array([(apart[i, :i] > RESOLUTION).all() for i in range(len(order))], bool)
    return star[order[alone]], magnitude[order[alone]]


def away(estimate: Rotation, seen: BenchmarkView) -> Floats:
    """Small rotation (3,) from truth, radian."""
    return (estimate * seen.icrs_to_camera.inv()).as_rotvec()


def wrong(estimate: Rotation, seen: BenchmarkView, regime: Regime) -> bool:
    """Whether an attitude is off by more than noise explains."""
    across = math.hypot(*away(estimate, seen)[:2]) * seen.believed.focal_length_px
    return across > max(3, 6 * regime.noise)


REGIME = Regime(12, 0.2, 5, 0.1)
SKIES = 100


def skies() -> list[BenchmarkView]:
    """The skies that every solver gets."""
    rng = np.random.default_rng(3)
    return [sky(rng, REGIME) for _ in range(SKIES)]


def solver(regime: Regime) -> Callable[[BenchmarkView], Rotation | None]:
    """Function from one sky to its attitude, None where it is not identified."""
    _, stars, index = design(regime.field)

    def run(seen: BenchmarkView) -> Rotation | None:
        return identify(seen.spots, seen.believed, stars, index, SETTINGS).icrs_to_camera

    return run


def identification() -> BenchmarkStage:
    """The fraction of skies that are not solved, or wrongly."""
    every, run = skies(), solver(REGIME)

    def judge(attitudes: Sequence[Rotation | None]) -> float:
        right = (
            attitude is not None and not wrong(attitude, seen, REGIME)
            for attitude, seen in zip(attitudes, every, strict=True)
        )
        return 1 - sum(right) / SKIES

    return BenchmarkStage(
        name="identification",
        work=f"a sky of {REGIME.field} deg, {REGIME.noise} px of noise, {REGIME.false} false "
        f"spots, {100 * REGIME.missing:g} % missing",
        error=f"fraction of {SKIES} skies not solved, or wrongly",
        ways={"startrack": lambda: [run(seen) for seen in every]},
        judge=judge,
        limit=1 / SKIES,
        limit_of="one of these skies",
        pieces=SKIES,
    )


Solver = Callable[[Any, Any, Any], Rotation]

STARS, MANY = 15, 2000


def aligned(b: Floats, r: Floats, w: Floats) -> Rotation:
    """`align` with the signature of the textbook solvers."""
    if b.ndim == 2:
        return align(b[None], r[None], w[None]).source_to_target[0]
    return align(b, r, w).source_to_target


SOLVERS: dict[str, Solver] = {
    "align": aligned,
    "svd": svd,
    "davenport": davenport,
    "quest": quest,
    "foam": foam,
}


def fields(many: int, stars: int, half: float, noise: float, seed: int) -> tuple[Any, ...]:
    """True attitudes, and observed (with noise) and reference vectors, over square fields."""
    rng = np.random.default_rng(seed)
    truth = Rotation.from_quat(rng.standard_normal((many, 4)))
    plane = rng.uniform(-np.tan(half), np.tan(half), (many, stars, 2))
    seen = unit(np.concatenate([plane, np.ones((many, stars, 1))], axis=2))
    reference = np.einsum("mji,mnj->mni", truth.as_matrix(), seen)
    return truth, unit(seen + noise * rng.standard_normal(seen.shape)), reference


def unit(vector: Floats) -> Floats:
    """Vectors of length one."""
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def attitude() -> BenchmarkStage:
    """Without noise, so that the solvers' own errors show."""
    truth, b, r = fields(MANY, STARS, 10 * deg, 0.0, 1)
    w = np.ones(b.shape[:2])
    return BenchmarkStage(
        name="attitude",
        work=f"an attitude from {STARS} exact directions in 20 deg",
        error="rms angle, radian",
        ways={name: partial(solve, b, r, w) for name, solve in SOLVERS.items()},
        judge=lambda attitudes: float(np.sqrt(np.mean((attitudes * truth.inv()).magnitude() ** 2))),
        limit=np.finfo(float).eps,
        limit_of="rounding",
        pieces=MANY,
    )
