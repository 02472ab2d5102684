"""Random skies with noise, losses and false spots, to be identified with nothing known."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.benchmark.skies import SETTINGS, Regime, Seen, design, sky, wrong
from startrack.benchmark.stage import Stage
from startrack.identification import identify

REGIME = Regime(12, 0.2, 5, 0.1)
SKIES = 100


def skies() -> list[Seen]:
    """The skies that every solver gets."""
    rng = np.random.default_rng(3)
    return [sky(rng, REGIME) for _ in range(SKIES)]


def solver(regime: Regime) -> Callable[[Seen], Rotation | None]:
    """One sky -> its attitude, None where it is not sure."""
    _, stars, index = design(regime.field)

    def run(seen: Seen) -> Rotation | None:
        return identify(seen.spots, seen.believed, stars, index, SETTINGS).icrs_to_camera

    return run


def identification() -> Stage:
    """The share of skies that are not solved, or wrongly."""
    every, run = skies(), solver(REGIME)

    def judge(found: Sequence[Rotation | None]) -> float:
        right = (
            one is not None and not wrong(one, seen, REGIME)
            for one, seen in zip(found, every, strict=True)
        )
        return 1 - sum(right) / SKIES

    return Stage(
        "identification",
        f"a sky of {REGIME.field} deg, {REGIME.noise} px of noise, {REGIME.false} false spots, "
        f"{100 * REGIME.missing:g} % missing",
        f"share of {SKIES} skies not solved, or wrongly",
        {"startrack": lambda: [run(seen) for seen in every]},
        judge,
        1 / SKIES,
        "that many skies",
        SKIES,
    )
