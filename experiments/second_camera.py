"""Problems beside star trackers: what the engines cost, gain and know of each camera.

python experiments/second_camera.py --json figures.json measures for fires (HSRS), minerals
(MERTIS), moving objects (AsteroidFinder), land (Sentinel-2) and heights (ADS40):

forecast_ms          CPU time of a forecast of a design that was not forecast before
trial_s              CPU time of a trial, the first ones left out
optimize_s, gain     wall time of a search in this process, and start over best on fresh trials
formula_over_trials  worst ratio of formula and trials, over designs that stress the formulas
hsrs_area_m2         smallest fire that is found in 95 % of the places, all conditions
mertis_right         fraction of spectra that are classified rightly
height_error_px      rms error of ADS40's heights from 3 km, over the ground between two lines
asteroid_limit_mag   V of the objects of which half are found
problem_lines        lines of the user's problem in the gallery
tracker_same         whether the engines' trials of a star tracker are those of `run_trials`
earth_if             conditions in optimise, montecarlo and verification that name a kind of camera
"""

from __future__ import annotations

import argparse
import ast
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import moving_objects
import retrieval_formulas

from startrack import load_design, run_trials, shipped
from startrack.core import Rows
from startrack.design import Fidelity
from startrack.earth import imager
from startrack.earth.geometry import flight_height, ground_rate
from startrack.earth.imager import band_of
from startrack.earth.retrieval import EarthProblem, load_earth_design
from startrack.moving import MovingProblem, load_moving_design
from startrack.optimise import TrialRunner, improve
from startrack.problem import Problem

ROOT = Path(__file__).parents[1]
ENGINES = "optimise", "montecarlo", "verification"
KINDS = re.compile(r"\bEarth|\bearth\b|MovingProblem|MovingDesign|is_scene|is_search|\bProblemKind")
IMAGES = 24  # of a terrain
VARIED = {
    "hsrs": "channels.mir.detector.exposure",
    "mertis": "channels.*.detector.exposure",
    "asteroidfinder": "instrument.optics.f_number",
}


def main() -> None:
    """Measure and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200, help="of each camera")
    parser.add_argument("--repeats", type=int, default=8, help="forecasts of each camera")
    parser.add_argument("--cameras", nargs="*", default=[*VARIED], help="that are searched")
    options = command.read(parser, trials=4, repeats=1, cameras=["mertis"])
    problems = cameras(options.quick)
    figures: dict[str, Any] = {
        "problem_lines": lines_of(ROOT / "docs" / "gallery" / "problem_of_a_photometer.py"),
        "tracker_same": tracker_same(),
        "earth_if": sum(1 for _ in conditions()),
        "forecast_ms": {
            name: forecast_ms(problem, VARIED[name], options.repeats)
            for name, problem in problems.items()
        },
    }
    measured = {name: trials(problem, options.trials) for name, problem in problems.items()}
    figures["trial_s"] = {name: each for name, (each, _) in measured.items()}
    figures["hsrs_area_m2"] = problems["hsrs"].judge(measured["hsrs"][1]).value.value
    minerals = problems["mertis"].judge(measured["mertis"][1]).parts
    figures["mertis_right"] = 1 - minerals["nominal: wrong"].value
    asteroids = problems["asteroidfinder"].judge(measured["asteroidfinder"][1]).parts
    figures["asteroid_limit_mag"] = asteroids["limit 50 V"].value
    figures["height_error_px"] = height_error(2 if options.quick else IMAGES)
    seconds, gain = dict[str, float](), dict[str, list[float]]()
    for name in options.cameras:
        began = time.perf_counter()
        factor = improve(problems[name], seed=1).factor
        seconds[name] = time.perf_counter() - began
        gain[name] = [factor.value, factor.low, factor.high]
    figures |= {"optimize_s": seconds, "gain": gain}
    figures["formula_over_trials"] = formulas(options.quick)
    for name, value in figures.items():
        print(f"{name}: {value}", flush=True)
    command.save(options, figures)


def cameras(quick: bool) -> dict[str, Problem]:
    """The problems, as shipped; smaller for a quick run."""
    searched = load_moving_design("asteroidfinder")
    made = {
        "hsrs": EarthProblem(load_earth_design("hsrs")),
        "mertis": EarthProblem(load_earth_design("mertis")),
    }
    if not quick:
        return made | {"asteroidfinder": MovingProblem(searched)}
    for name, problem in made.items():
        campaign = replace(
            problem.campaign,
            trials=4,
            most_trials=4,
            fresh_trials=8,
            evaluations=1,
            analytic_evaluations=2,
        )
        made[name] = EarthProblem(replace(problem.design, campaign=campaign))
    own = replace(searched.moving_object, frames=4)
    return made | {"asteroidfinder": MovingProblem(replace(searched, moving_object=own))}


def height_error(images: int) -> float:
    """Error of heights, in pixels along the track."""
    problem = EarthProblem(load_earth_design("heights"))
    design = problem.design
    (channel,) = (each for each in design.channels if each.name == "nadir")
    height = flight_height(design.carrier)
    band = band_of(channel, design.air, height, design.sun_distance)
    line = imager.figures(channel, band, height, ground_rate(design.carrier)).sampling_along
    judged = problem.judge(problem.trials(1, range(images)))
    return judged.parts["nominal: height"].value / line


def lines_of(path: Path) -> int:
    """Lines of a file that are not blank."""
    return sum(bool(line.strip()) for line in path.read_text(encoding="utf-8").splitlines())


def tracker_same() -> bool:
    """Whether trials of the engines' runner are those of `run_trials`, to the last bit."""
    case = load_design(shipped("designs/noise_only.toml")).case
    direct = run_trials(case, 1, range(4), Fidelity.COVARIANCE)
    return TrialRunner(1).run(case, 4, Fidelity.COVARIANCE).tobytes() == direct.tobytes()


def conditions() -> Iterator[str]:
    """Conditions of the engines that name a kind of camera."""
    for room in ENGINES:
        for path in sorted((ROOT / "startrack" / room).glob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                test = getattr(node, "test", None) or getattr(node, "subject", None)
                if isinstance(test, ast.AST) and KINDS.search(ast.unparse(test)):
                    yield f"{path.name}: {ast.unparse(test)}"


def forecast_ms(problem: Problem, name: str, repeats: int) -> float:
    """Mean CPU time of forecasts of designs that differ in a variable."""
    start = {variable.name: variable.start for variable in problem.variables}
    designs = [
        problem.replaced({name: start[name] * (1 + 1e-3 * (number + 1))})
        for number in range(repeats + 1)
    ]
    designs[0].expect()
    began = time.process_time()
    for design in designs[1:]:
        design.expect()
    return 1e3 * (time.process_time() - began) / repeats


def trials(problem: Problem, count: int) -> tuple[float, Rows]:
    """CPU seconds of a trial, and rows."""
    problem.trials(2, range(1))
    began = time.process_time()
    rows = problem.trials(1, range(count))
    return (time.process_time() - began) / count, rows


def formulas(quick: bool) -> dict[str, float]:
    """Worst ratio of each retrieval over designs that stress its formulas."""
    images, few = (1, 2) if quick else (retrieval_formulas.IMAGES, moving_objects.TRIALS)
    kinds = {"fires": ("hsrs", retrieval_formulas.FIRES)}
    kinds["minerals"] = "mertis", retrieval_formulas.MINERALS
    kinds["heights"] = "heights", retrieval_formulas.HEIGHTS
    kinds["fields"] = "fields", retrieval_formulas.FIELDS
    worst = dict[str, float]()
    for kind, (scene, designs) in kinds.items():
        some = dict(list(designs.items())[:1]) if quick else designs
        worst[kind] = furthest(retrieval_formulas.compare(scene, some, images))
    some = dict(list(moving_objects.STRESSED.items())[:1]) if quick else moving_objects.STRESSED
    ratios = moving_objects.compare(few, some)["designs"]
    limits = {
        name: {part: ratio for part, ratio in design.items() if part != "place"}
        for name, design in ratios.items()
    }
    return worst | {"moving objects": furthest(limits)}


def furthest(ratios: dict[str, dict[str, float]]) -> float:
    """The largest of ratios and their inverses."""
    every = (ratio for design in ratios.values() for ratio in design.values())
    return max(max(ratio, 1 / ratio) for ratio in every)


if __name__ == "__main__":
    command.run(main)
