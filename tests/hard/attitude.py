"""Vectors for which solvers lose digits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.attitude import Observability, align
from startrack.benchmark.solving import fields
from tests.hard.case import hard, refused

CASES = json.loads((Path(__file__).parents[1] / "oracle" / "wahba_cases.json").read_text())["cases"]
EPS = 2.0**-52


def solved(case):
    return align(*(np.array(case[key])[None] for key in ("b", "r", "weight")))


@hard("attitude", "98 cases of 60 digits: worst error over eps sqrt(condition)", (0, 50))
def _digits() -> float:
    ratios = []
    for case in (case for case in CASES if case["observable"]):
        apart = solved(case).source_to_target[0] * Rotation.from_matrix(case["A"]).inv()
        ratios.append(apart.magnitude() / (EPS * np.sqrt(case["info_cond"])))
    return float(max(ratios))


@hard("attitude", "4 cases that one cannot solve, told", (4, 4))
def _flagged() -> float:
    hopeless = [case for case in CASES if not case["observable"]]
    return float(sum(solved(c).observability[0] != Observability.OBSERVED for c in hopeless))


@hard("attitude", "no star at all", "one direction")
def _none() -> str:
    got = align(np.zeros((1, 0, 3)), np.zeros((1, 0, 3)), np.zeros((1, 0)))
    return got.observability[0].__class__.__name__ and str(
        Observability(got.observability[0]).name
    ).lower().replace("_", " ")


@hard("attitude", "half a turn about each axis, largest error, rad", (0, 1e-15))
def _half_turns() -> float:
    _, b, _ = fields(1, 6, 0.1, 0.0, 3)
    errors = []
    for axis in np.eye(3):
        turn = Rotation.from_rotvec(np.pi * axis)
        got = align(b, turn.inv().apply(b[0])[None], np.ones((1, 6)))
        errors.append((got.source_to_target[0] * turn.inv()).magnitude())
    return float(max(errors))


@hard("attitude", "two stars an arc second apart: error over eps / separation", (0, 50))
def _near() -> float:
    second = np.array([np.sin(4.85e-6), 0.0, np.cos(4.85e-6)])
    b = np.array([[[0.0, 0.0, 1.0], second]])
    turn = Rotation.from_rotvec([0.3, -1.1, 2.0])
    got = align(b, turn.inv().apply(b[0])[None], np.ones((1, 2)))
    return float((got.source_to_target[0] * turn.inv()).magnitude() / (EPS / 4.85e-6))


@hard("attitude", "weights over 24 orders of magnitude: error, rad", (0, 1e-14))
def _weights() -> float:
    truth, b, r = fields(1, 12, 0.2, 0.0, 5)
    got = align(b, r, 10.0 ** np.linspace(-12, 12, 12)[None])
    return float((got.source_to_target[0] * truth[0].inv()).magnitude())


@hard("attitude", "a negative weight", "weight must be finite and not negative")
def _negative() -> str:
    _, b, r = fields(1, 2, 0.2, 0.0, 5)
    return refused(lambda: align(b, r, np.array([[1.0, -1.0]])))
