"""Exact unit vectors of many attitudes; what remains of the attitude's error is rounding."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude import align, davenport, foam, quest, svd
from startrack.benchmark.stage import Stage
from startrack.core import Floats, deg

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


def attitude() -> Stage:
    """Without noise, so that the solvers' own errors show."""
    truth, b, r = fields(MANY, STARS, 10 * deg, 0.0, 1)
    w = np.ones(b.shape[:2])
    return Stage(
        "attitude",
        f"an attitude from {STARS} exact directions in 20 deg",
        "rms angle, radian",
        {name: partial(solve, b, r, w) for name, solve in SOLVERS.items()},
        lambda found: float(np.sqrt(np.mean((found * truth.inv()).magnitude() ** 2))),
        np.finfo(float).eps,
        "rounding",
        MANY,
    )
