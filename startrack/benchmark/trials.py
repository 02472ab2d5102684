"""Whole trials on real skies, from a random attitude to the error of the solution."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from startrack.benchmark.stage import Stage
from startrack.core import arcsec, deg
from startrack.design import Case, Fidelity, load_design
from startrack.io import shipped
from startrack.trial import run_trials

SEED, TRIALS, SIDE = 5, 32, 1024
FALSE = 0.5 * deg  # an attitude that is off by more is not counted


def example() -> Case:
    """The design that is shipped, with as many pixels as the peers' examples."""
    return sized(load_design(shipped("designs/noise_only.toml")).case, SIDE)


def sized(case: Case, pixels: int) -> Case:
    """The same field and lens on so many pixels a side."""
    instrument = case.instrument
    detector = instrument.detector
    pitch = detector.pixel_pitch * detector.columns / pixels
    detector = replace(detector, columns=pixels, rows=pixels, pixel_pitch=pitch)
    return replace(case, instrument=replace(instrument, detector=detector))


def montecarlo() -> Stage:
    """All fidelities on the same skies; answers are angles across the boresight, radian."""
    case = example()

    def angles(fidelity: Fidelity) -> NDArray[np.float64]:
        found = run_trials(case, SEED, range(TRIALS), fidelity)
        return np.where(found["solved"], np.hypot(found["error_x"], found["error_y"]), np.nan)

    def judge(angle: NDArray[np.float64]) -> float:
        correct = angle[np.isfinite(angle) & (angle < FALSE)]
        return float(np.sqrt(np.mean(correct**2) / 2)) / arcsec if len(correct) else math.nan

    return Stage(
        "montecarlo",
        f"a trial of the example on {SIDE} x {SIDE} pixels: render, detect, identify, solve, judge",
        f"rms per axis across the boresight of {TRIALS} trials, arcsec",
        {fidelity.value: partial(angles, fidelity) for fidelity in Fidelity},
        judge,
        pieces=TRIALS,
    )
