"""Problems beside star trackers: what the engines cost, gain and know of each camera.

python experiments/second_camera.py --json figures.json measures for fires (HSRS), minerals
(MERTIS), moving objects (AsteroidFinder), land (Sentinel-2) and heights (ADS40):

forecast_ms          CPU time of a forecast of a design that was not forecast before
trial_s              CPU time of a trial, the first ones left out
optimize_s, gain     wall time of a search in this process, and start over best on fresh trials
formula_over_trials  worst ratio of formula and trials, over designs that stress the formulas
hsrs_area_m2         smallest fire that is found in 95 % of the places, all conditions
modis_area_m2        the same of MODIS's bands 22 and 31; modis_areas_m2 by temperature and hour,
                     modis_forecast_m2 by formula
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
import math
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import command
import moving_objects
import numpy as np
import retrieval_formulas

from startrack import load_design, run_trials, shipped
from startrack.core import ALL, Rows
from startrack.design import Fidelity
from startrack.detector import Scan
from startrack.earth import imager
from startrack.earth.geometry import flight_height, ground_rate
from startrack.earth.imager import band_of
from startrack.earth.retrieval import CameraLimits, EarthProblem, load_earth_design
from startrack.moving import MovingProblem, load_moving_design
from startrack.optimise import TrialRunner, improve
from startrack.problem import Problem

ROOT = Path(__file__).parents[1]
ENGINES = "optimise", "montecarlo", "verification"
KINDS = re.compile(r"\bEarth|\bearth\b|MovingProblem|MovingDesign|is_scene|is_search|\bProblemKind")
IMAGES = 24  # of a terrain
MODIS_FOCAL = 0.3809  # metre
# Edges in metre, NEdT in kelvin and saturation in kelvin of bands 22 and 31.
MODIS = ((3.940e-6, 4.001e-6, 0.07, 331.0), (10.78e-6, 11.28e-6, 0.05, 400.0))
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
    figures: dict[str, Any] = {}
    for name, value in measured(options):
        figures[name] = value
        print(f"{name}: {value}", flush=True)
        command.save(options, figures)  # so that an interrupted run leaves what it measured


def measured(options: argparse.Namespace) -> Iterator[tuple[str, Any]]:
    """Name and value of each figure, as soon as it is measured."""
    problems = cameras(options.quick)
    yield "problem_lines", lines_of(ROOT / "docs" / "gallery" / "problem_of_a_photometer.py")
    yield "tracker_same", tracker_same()
    yield "earth_if", sum(1 for _ in conditions())
    yield (
        "forecast_ms",
        {
            name: forecast_ms(problem, VARIED[name], options.repeats)
            for name, problem in problems.items()
        },
    )
    rows = dict[str, tuple[float, Rows]]()
    for name, problem in problems.items():
        rows[name] = trials(problem, options.trials)
        print(f"{name}: {rows[name][0]:.3g} s a trial", flush=True)
    yield "trial_s", {name: each for name, (each, _) in rows.items()}
    yield "hsrs_area_m2", problems["hsrs"].judge(rows["hsrs"][1]).value.value
    modis = modis_problem()
    judged = modis.judge(modis.trials(1, range(options.trials)))
    yield "modis_area_m2", judged.value.value
    yield "modis_areas_m2", {name: part.value for name, part in judged.parts.items()}
    yield "modis_forecast_m2", modis.expect().value
    minerals = problems["mertis"].judge(rows["mertis"][1]).parts
    yield "mertis_right", 1 - minerals["nominal: wrong"].value
    asteroids = problems["asteroidfinder"].judge(rows["asteroidfinder"][1]).parts
    yield "asteroid_limit_mag", asteroids["limit 50 V"].value
    yield "height_error_px", height_error(2 if options.quick else IMAGES)
    seconds, gain = dict[str, float](), dict[str, list[float]]()
    for name in options.cameras:
        began = time.perf_counter()
        factor = improve(problems[name], seed=1).factor
        seconds[name] = time.perf_counter() - began
        gain[name] = [factor.value, factor.low, factor.high]
        print(f"{name}: {seconds[name]:.1f} s, gain {gain[name]}", flush=True)
    yield "optimize_s", seconds
    yield "gain", gain
    yield "formula_over_trials", formulas(options.quick)


def modis_problem() -> EarthProblem:
    """Fires of the HSRS scene below MODIS: bands 22 and 31, 1 km from 705 km, at the nadir.

    Published (Barnes et al. 1998, IEEE Trans. Geosci. Remote Sensing 36, 1088; MODIS's table of
    specifications): edges of the bands, aperture of 177.8 mm, 12 bits, NEdT of 0.07 and 0.05 K at
    300 K, saturation at 331 and 400 K. Of band 21, which saturates at 500 K and has the same edges
    but 2 K of noise, nothing is used: the smallest fires are found in band 22, whether or not it
    saturates. The scanning mirror smears a pixel by its width along the scan, here along the track.
    """
    design = load_earth_design("hsrs")
    assert design.orbit
    assert design.campaign
    orbit = replace(design.orbit, altitude=705e3, inclination=math.radians(98.2))
    height, rate = flight_height(orbit), ground_rate(orbit)
    channels = list[imager.Channel]()
    for channel, (low, high, noise, full) in zip(design.camera.channels, MODIS, strict=True):
        optics = replace(
            channel.optics, focal_length=MODIS_FOCAL, f_number=MODIS_FOCAL / 0.1778, blur=0.0
        )
        detector = replace(
            channel.detector,
            columns=1354,
            pixel_pitch=MODIS_FOCAL * 1e3 / height,
            exposure=1.0,  # all of the line, for the smear
            scan=Scan("line"),
            bits=12,
            offset=0,
            prnu=0.0,
            full_well=1e12,
            read_noise=0.0,
        )
        edges = imager.Passband(low, high)
        seen = replace(
            channel,
            optics=optics,
            detector=detector,
            band=ALL,
            passband=edges,
            reference=imager.Reference(temperature=300.0),
        )
        channels.append(as_published(seen, height, rate, noise, full))
    return EarthProblem(
        replace(
            design,
            camera=imager.Imager(tuple(channels)),
            orbit=orbit,
            campaign=replace(design.campaign, variables=(), requirements=CameraLimits()),
        )
    )


def as_published(
    channel: imager.Channel, height: float, rate: float, noise: float, saturation: float
) -> imager.Channel:
    """The channel with a full well that a blackbody fills, and the read noise of its NEdT."""
    band = band_of(channel, None, height, 1.0)
    assert band.heat
    about = imager.figures(channel, band, height, rate)
    per_radiance = about.electrons / about.radiance
    full = per_radiance * float(band.heat(np.array([saturation]))[0, 0])
    near = band.heat(np.array([299.5, 300.5]))[:, 0]
    wanted = noise * float(near[1] - near[0]) * per_radiance
    step = full / (2**channel.detector.bits - 1)
    rest = wanted**2 - about.electrons - step**2 / 12
    detector = replace(channel.detector, full_well=full, read_noise=math.sqrt(max(rest, 0.0)))
    return replace(channel, detector=detector)


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
