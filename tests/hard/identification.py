"""Skies that mislead the identification."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.benchmark.solving import (
    SETTINGS,
    BenchmarkView,
    Regime,
    design,
    sky,
    spots_at,
    wrong,
)
from startrack.core.values import Spots
from startrack.identification import Identification, build_index, identify
from tests.hard.case import hard, refused

REGIME = Regime(12, 0.1, 3, 0.0)


@lru_cache
def seen(seed: int) -> BenchmarkView:
    return sky(np.random.default_rng(seed), REGIME)


def solve(spots: Spots, one: BenchmarkView):
    _, stars, index = design(REGIME.field)
    return identify(spots, one.believed, stars, index, SETTINGS)


def right(found: Rotation | None, one: BenchmarkView) -> float:
    return float(found is not None and not wrong(found, one, REGIME))


@hard("identification", "a mirrored sky, of 25, solved", (0, 0))
def _mirrored() -> float:
    skies = [seen(n) for n in range(25)]
    flipped = [solve(replace(s.spots, x=1023 - s.spots.x), s).icrs_to_camera for s in skies]
    return float(sum(one is not None for one in flipped))


@hard("identification", "thirty spots at one place", "no")
def _heap() -> str:
    one = seen(0)
    spots = spots_at(np.full((30, 2), 500.0), np.ones(30), 0.1)
    return str(solve(spots, one).status)


for _count, _words in ((0, "blank"), (3, "too few stars")):

    @hard("identification", f"{_count} spots", _words)
    def _few(count=_count) -> str:
        one = seen(0)
        pixel = np.array([[100.0, 200.0], [700.0, 300.0], [500.0, 900.0]])[:count]
        return str(solve(spots_at(pixel, np.ones(count), 0.1), one).status)


@hard("identification", "two thousand false spots fainter than the stars: solved and right", (1, 1))
def _many() -> float:
    one = seen(6)
    more = np.random.default_rng(6).random((2000, 2)) * 1024 - 0.5
    pixel = np.concatenate([np.column_stack([one.spots.x, one.spots.y]), more])
    flux = np.concatenate([one.spots.flux, np.full(2000, one.spots.flux.min() / 2)])
    return right(solve(spots_at(pixel, flux, 0.1), one).icrs_to_camera, one)


for _sigma2 in (np.nan, 0.0, -1.0, 1e6):

    @hard("identification", f"covariances of {_sigma2} pixel^2: solved and right", (1, 1))
    def _covariance(sigma2=_sigma2) -> float:
        one = seen(4)
        spots = replace(one.spots, covariance=np.full_like(one.spots.covariance, sigma2))
        return right(solve(spots, one).icrs_to_camera, one)


@hard("identification", "places that are not numbers among the spots: solved and right", (1, 1))
def _lost() -> float:
    one = seen(3)
    x, y = one.spots.x.copy(), one.spots.y.copy()
    x[0], y[2] = np.nan, np.inf
    return right(solve(replace(one.spots, x=x, y=y), one).icrs_to_camera, one)


@hard("identification", "500 images of 12 random points, solved", (0, 0))
def _random() -> float:
    one, rng = seen(0), np.random.default_rng(9)
    flux = np.geomspace(1, 0.01, 12)
    return float(
        sum(
            solve(spots_at(1024 * rng.random((12, 2)) - 0.5, flux, 0.1), one).icrs_to_camera
            is not None
            for _ in range(500)
        )
    )


@hard("identification", "a field of view of nothing", "field_of_view must be positive")
def _field() -> str:
    return refused(lambda: build_index(design(12)[1], 0.0))


@hard("identification", "a tolerance below nothing", "focal_tolerance must")
def _tolerance() -> str:
    return refused(lambda: Identification(focal_tolerance=-0.1))
