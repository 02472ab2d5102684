"""Question: are the results of this tree equal, byte for byte, to the recorded results?

    python experiments/same_bytes.py [--record] [--json FILE] [--quick]

same_bytes   1 where each result has the recorded digest, else 0
differs      names of the results with a different digest

The results: outcomes of trials in each fidelity of three designs, analytic budgets of the designs
and of their units, an optimisation, a day of a mission, and an image of the Earth.
`same_bytes.json` has the first letters of their SHA-256, and the machine where they were made:
another processor or another version of numpy, scipy or numba may change last digits. --record
writes this file again, after an intended change of numbers.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack import Fidelity, Refused, load_design, run_trials, shipped
from startrack.budget import analytic, unit_budgets
from startrack.earth.imager import Picture, load_survey, render
from startrack.mission import fly, load_mission, plan_of
from startrack.optimise import TrialRunner, optimize

RECORDED = Path(__file__).with_suffix(".json")
DESIGNS = ("noise_only", "nanosatellite", "high_accuracy")
TRIALS = 200
UNITS = 3
SEARCH = ("campaign.analytic_evaluations=40", "campaign.evaluations=6", "campaign.fresh_trials=100")
MISSION, DAY = "missions/sun-synchronous.toml", ("time.duration=1 d", "time.step=60 s")
PIXELS, CELLS = 64, 256  # along each side of the image of the Earth, and of its terrain
LETTERS = 16  # letters of a digest


def main() -> None:
    """Print the names of results that differ, and whether all are the same."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--record", action="store_true", help="replace same_bytes.json")
    options = command.read(parser)
    if options.record:
        made: dict[str, Any] = {"machine": machine()}
        made |= {size: dict(digests(size == "quick")) for size in ("quick", "whole")}
        RECORDED.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")
    figures = compare(options.quick)
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


def compare(quick: bool) -> dict[str, Any]:
    """Whether all results are as recorded, and names of the differing results."""
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    if recorded["machine"] != machine():
        print(f"recorded on {recorded['machine']}, but this is {machine()}")
    expected = recorded["quick" if quick else "whole"]
    found = dict(digests(quick))
    names = sorted(expected.keys() | found.keys())
    differs = [name for name in names if found.get(name) != expected.get(name)]
    return {"same_bytes": int(not differs), "differs": differs}


def machine() -> str:
    """Properties of the machine that affect last digits."""
    versions = [f"{name} {version(name)}" for name in ("numpy", "scipy", "numba")]
    return ", ".join([platform.machine(), *versions])


def digests(quick: bool) -> Iterator[tuple[str, str]]:
    """The digest of each result; a quick run has few trials of one design."""
    for name in DESIGNS[:1] if quick else DESIGNS:
        case = load_design(shipped(f"designs/{name}.toml")).case
        for fidelity in Fidelity:
            try:
                outcomes = run_trials(case, 1, range(2 if quick else TRIALS), fidelity)
            except Refused as reason:  # the refusal is the result
                yield f"{name} {fidelity}", digest(str(reason))
            else:
                yield f"{name} {fidelity}", digest(outcomes)
        yield f"{name} budget", digest(analytic(case))
        if case.varying:
            budgets = unit_budgets(case, 1, UNITS, case.end_of_life)
            yield f"{name} units", digest(budgets)
    if not quick:
        yield "optimisation", digest(optimised())
        yield "mission", digest(fly(plan_of(load_mission(shipped(MISSION), DAY))))
        yield "image of the Earth", digest(image())


def optimised() -> dict[str, Any]:
    """The result of a short search."""
    design = load_design(shipped("designs/noise_only.toml"), SEARCH)
    assert design.campaign
    found = optimize(design.case, design.campaign, TrialRunner(1))
    return {
        "tried": [(done.coordinates, done.error, done.score) for done in found.evaluations],
        "factor": found.factor,
        "margins": found.margins,
        "errors": found.errors,
    }


def image() -> Any:
    """Digital numbers of the pixels of a small scene."""
    survey = load_survey(shipped("scenes/waoss.toml"))
    fractal = survey.terrain.fractal
    assert fractal
    terrain = replace(survey.terrain, fractal=replace(fractal, cells=CELLS))
    survey = replace(survey, lines=PIXELS, columns=PIXELS, terrain=terrain)
    channel = survey.channels[0]
    picture = Picture.blank(PIXELS, channel.columns)
    render(survey, channel, Path(), 1, picture)
    return picture.numbers


def digest(value: Any) -> str:
    """First letters of the SHA-256 of a value: bytes of arrays, all digits of floats."""
    kept = hashlib.sha256()
    for part in _parts(value):
        kept.update(part)
    return kept.hexdigest()[:LETTERS]


def _parts(value: Any) -> Iterator[bytes]:
    if isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape}".encode()
        yield value.tobytes()
    elif isinstance(value, float):
        yield value.hex().encode()
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield str(key).encode()
            yield from _parts(item)
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _parts(item)
    elif is_dataclass(value):
        for field in fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
    else:
        yield repr(value).encode()


if __name__ == "__main__":
    command.run(main)
