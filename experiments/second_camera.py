"""Problems other than star trackers: time, gain and accuracy of the engines for each camera.

python experiments/second_camera.py --json figures.json measures for fires (HSRS), minerals
(MERTIS), moving objects (AsteroidFinder), land and waves (Sentinel-2) and heights (ADS40), part by
part; figures in the file are kept, and an interrupted run continues:

engines           problem_lines: lines of the user's problem in the gallery; tracker_same: whether
                  the engines' trials of a star tracker equal those of `run_trials`; earth_if:
                  number of conditions in optimise, montecarlo and verification that name a kind of
                  camera
forecast/CAMERA   forecast_ms: CPU time of a forecast of a new design
trials/CAMERA     trial_s: CPU time of a trial, without the first; image_s: CPU time of an image of
                  a condition, which has several trials; hsrs_area_m2: smallest fire that is found
                  in 95 % of the places, all conditions; mertis_right: fraction of correctly
                  classified spectra; asteroid_limit_mag: V at which half of the objects are found;
                  wave_height_m, wave_direction_rad: rms errors; intervals: ends of the 95 %
                  intervals, and the formula
modis             modis_area_m2: as hsrs_area_m2, for MODIS's bands 22 and 31; modis_areas_m2: by
                  temperature and hour; modis_forecast_m2: by formula
heights           height_error_px: rms error of ADS40's heights from 3 km, over the ground between
                  two lines
search/CAMERA     optimize_s, optimize_cpu_s: time of a search in this process; gain: start over
                  best on fresh trials
formulas/KIND     formula_over_trials: worst ratio of formula and trials, over designs that stress
                  the formulas; ratios: of each design
measured          commit, counts and time of each part
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
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
IMAGES = 24  # images of terrain
MODIS_FOCAL = 0.3809  # metre
# Edges in metre, NEdT in kelvin and saturation in kelvin of bands 22 and 31.
MODIS = ((3.940e-6, 4.001e-6, 0.07, 331.0), (10.78e-6, 11.28e-6, 0.05, 400.0))
VARIED = {
    "hsrs": "channels.mir.detector.exposure",
    "mertis": "channels.*.detector.exposure",
    "asteroidfinder": "instrument.optics.f_number",
    "waves": "channels.*.optics.f_number",
}
Figures = dict[str, Any]
Measured = Iterator[tuple[tuple[str, ...], Any]]
Part = Callable[[argparse.Namespace, Figures], Measured]


def main() -> None:
    """Measure and save each requested part that was not measured before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100, help="trials of each camera")
    parser.add_argument(
        "--images",
        type=int,
        help="number of images, or fields of moving objects, of each design of `formulas` "
        "(default: by retrieval)",
    )
    parser.add_argument(
        "--repeats", type=int, default=8, help="number of timed forecasts of each camera"
    )
    parser.add_argument(
        "--parts", default="", help="parts to run, such as search/hsrs,modis (default: all)"
    )
    options = command.read(parser, trials=4, images=2, repeats=1)
    asked = options.parts.split(",") if options.parts else list(PARTS)
    if options.quick and not options.parts:
        asked.remove("search/hsrs")
        asked.remove("search/asteroidfinder")
        asked.remove("search/waves")
    for part in asked:
        if part not in PARTS:
            raise SystemExit(f"--parts must be of {', '.join(PARTS)}, got {part}")
    figures: dict[str, Any] = {}
    if options.json and options.json.is_file():
        figures = json.loads(options.json.read_text(encoding="utf-8"))
    done = figures.setdefault("measured", {})
    for part in asked:
        if part in done:
            continue
        began, wall = time.process_time(), time.perf_counter()
        for place, value in PARTS[part](options, figures):
            table = figures
            for level in place[:-1]:
                table = table.setdefault(level, {})
            table[place[-1]] = value
            print(f"{', '.join(place)}: {value}", flush=True)
            command.save(options, command.finite(figures), partial=True)
        done[part] = {
            "commit": command.commit(),
            "trials": options.trials,
            "images": options.images,
            "cpu_s": time.process_time() - began,
            "wall_s": time.perf_counter() - wall,
        }
        command.save(options, command.finite(figures), partial=len(done) < len(PARTS))


def engines(options: argparse.Namespace, figures: Figures) -> Measured:
    """Facts on star trackers in the code of the engines."""
    yield ("problem_lines",), lines_of(ROOT / "docs" / "gallery" / "problem_of_a_photometer.py")
    yield ("tracker_same",), tracker_same()
    yield ("earth_if",), sum(1 for _ in conditions())


def forecasts(name: str, options: argparse.Namespace, figures: Figures) -> Measured:
    """CPU time of a forecast."""
    problem = camera(name, options.quick)
    yield ("forecast_ms", name), forecast_ms(problem, VARIED[name], options.repeats)


def camera_trials(name: str, options: argparse.Namespace, figures: Figures) -> Measured:
    """CPU time of a trial, and the results of the trials."""
    problem = camera(name, options.quick)
    each, rows = trials(problem, options.trials)
    yield ("trial_s", name), each
    if isinstance(problem, EarthProblem):
        studies = problem.studies.values()
        images = len(studies) * math.ceil(options.trials / next(iter(studies)).per_image)
        yield ("image_s", name), each * options.trials / images
    judged, expected = problem.judge(rows), problem.expect()
    for figure, part, right in SAID[name]:
        found = judged.parts[part] if part else judged.value
        ends = found.value, found.low, found.high
        value, low, high = (1 - ends[0], 1 - ends[2], 1 - ends[1]) if right else ends
        formula = expected.parts[part] if part else expected.value
        yield (figure,), value
        yield (
            ("intervals", figure),
            {"low": low, "high": high, "formula": 1 - formula if right else formula},
        )


def modis(options: argparse.Namespace, figures: Figures) -> Measured:
    """Smallest fires of MODIS."""
    problem = modis_problem()
    judged = problem.judge(problem.trials(1, range(options.trials)))
    yield ("modis_area_m2",), judged.value.value
    yield ("modis_areas_m2",), {name: part.value for name, part in judged.parts.items()}
    yield ("modis_forecast_m2",), problem.expect().value


def heights(options: argparse.Namespace, figures: Figures) -> Measured:
    """Error of ADS40's heights."""
    yield ("height_error_px",), height_error(2 if options.quick else IMAGES)


def search(name: str, options: argparse.Namespace, figures: Figures) -> Measured:
    """Time and gain of a search."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = improve(camera(name, options.quick), seed=1)
    yield ("optimize_s", name), time.perf_counter() - wall
    yield ("optimize_cpu_s", name), time.process_time() - cpu
    yield ("gain", name), [found.factor.value, found.factor.low, found.factor.high]
    start, best = (judged.value for judged in found.judged)
    yield ("start", name), [start.value, start.low, start.high]
    yield ("best", name), [best.value, best.low, best.high]
    yield ("verdicts", name), found.verdicts
    yield ("values", name), {"start": found.start, "best": found.best}


def formulas(kind: str, options: argparse.Namespace, figures: Figures) -> Measured:
    """Ratios of trials and formula over designs, each kept when it is measured, and the worst
    ratio."""
    scene, designs = STRESSED[kind]
    some = dict(list(designs.items())[:1]) if options.quick else designs
    known = figures.get("ratios", {}).get(kind, {})
    for name, values in some.items():
        if name in known:
            continue
        if scene == "asteroidfinder":
            fields = options.images or moving_objects.TRIALS
            found = moving_objects.compare(fields, {name: values})["designs"][name]
        else:
            images = options.images or retrieval_formulas.IMAGES[kind]
            found = retrieval_formulas.compare(scene, {name: values}, images)[name]
        yield ("ratios", kind, name), found
    measured = figures["ratios"][kind]
    for group, inside in (kind, False), (f"{kind}, place", True):
        some = {
            name: {part: ratio for part, ratio in ratios.items() if (part == "place") == inside}
            for name, ratios in measured.items()
        }
        if any(some.values()):
            yield ("formula_over_trials", group), furthest(some)


def modis_problem() -> EarthProblem:
    """Fires of the HSRS scene below MODIS: bands 22 and 31, 1 km from 705 km, at the nadir.

    Published (Barnes et al. 1998, IEEE Trans. Geosci. Remote Sensing 36, 1088; MODIS's table of
    specifications): edges of the bands, aperture of 177.8 mm, 12 bits, NEdT of 0.07 and 0.05 K at
    300 K, saturation at 331 and 400 K. Band 21, which saturates at 500 K and has the same edges but
    2 K of noise, is not used: the smallest fires are found in band 22, saturated or not. The
    scanning mirror smears a pixel by its width along the scan, here along the track.
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
            exposure=1.0,  # the whole line, for the smear
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
    """The channel with the full well of the published saturation, and the read noise of its
    NEdT."""
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


def camera(name: str, quick: bool) -> Problem:
    """A problem as shipped; smaller for a quick run."""
    if name == "asteroidfinder":
        searched = load_moving_design(name)
        own = replace(searched.moving_object, frames=4) if quick else searched.moving_object
        return MovingProblem(replace(searched, moving_object=own))
    design = load_earth_design(name)
    if quick:
        assert design.campaign
        campaign = replace(
            design.campaign,
            trials=4,
            most_trials=4,
            fresh_trials=8,
            evaluations=1,
            analytic_evaluations=2,
        )
        design = replace(design, campaign=campaign)
    return EarthProblem(design)


def height_error(images: int) -> float:
    """Error of heights, in pixels along the track."""
    problem = EarthProblem(load_earth_design("heights"))
    design = problem.design
    (channel,) = (each for each in design.channels if each.name == "nadir")
    height = flight_height(design.carrier)
    band = band_of(channel, design.air, height, design.distance_to_sun)
    line = imager.figures(channel, band, height, ground_rate(design.carrier)).sampling_along
    judged = problem.judge(problem.trials(1, range(images)))
    return judged.parts["nominal: height"].value / line


def lines_of(path: Path) -> int:
    """Non-blank lines of a file."""
    return sum(bool(line.strip()) for line in path.read_text(encoding="utf-8").splitlines())


def tracker_same() -> bool:
    """Whether trials of the engines' runner equal those of `run_trials`, to the last bit."""
    case = load_design(shipped("designs/noise_only.toml")).case
    direct = run_trials(case, 1, range(4), Fidelity.COVARIANCE)
    return TrialRunner(1).run(case, 4, Fidelity.COVARIANCE).tobytes() == direct.tobytes()


def conditions() -> Iterator[str]:
    """Conditions in the engines that name a kind of camera."""
    for room in ENGINES:
        for path in sorted((ROOT / "startrack" / room).glob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                test = getattr(node, "test", None) or getattr(node, "subject", None)
                if isinstance(test, ast.AST) and KINDS.search(ast.unparse(test)):
                    yield f"{path.name}: {ast.unparse(test)}"


def forecast_ms(problem: Problem, name: str, repeats: int) -> float:
    """Mean CPU time of forecasts of designs with different values of a variable."""
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
    """CPU time of a trial, second, and rows."""
    problem.trials(2, range(1))
    began = time.process_time()
    rows = problem.trials(1, range(count))
    return (time.process_time() - began) / count, rows


def furthest(ratios: dict[str, dict[str, float]]) -> float:
    """The largest of ratios and their inverses."""
    every = (ratio for design in ratios.values() for ratio in design.values())
    return max(max(ratio, 1 / ratio) for ratio in every)


# Figures of trials: name, part of the judgement or "" for its value, whether the figure is 1 minus
# the part.
SAID = {
    "hsrs": (("hsrs_area_m2", "", False),),
    "mertis": (("mertis_right", "nominal: wrong", True),),
    "asteroidfinder": (
        ("asteroid_limit_mag", "limit 50 V", False),
        ("asteroid_limit_90_mag", "limit 90 V", False),
    ),
    "waves": (
        ("wave_height_m", "nominal: wave height", False),
        ("wave_direction_rad", "nominal: wave direction", False),
    ),
}
STRESSED = {
    **retrieval_formulas.STRESSED,
    "moving objects": ("asteroidfinder", moving_objects.STRESSED),
}
PARTS: dict[str, Part] = {
    "engines": engines,
    **{f"forecast/{name}": partial(forecasts, name) for name in VARIED},
    **{f"trials/{name}": partial(camera_trials, name) for name in VARIED},
    "modis": modis,
    "heights": heights,
    **{f"search/{name}": partial(search, name) for name in VARIED},
    **{f"formulas/{kind}": partial(formulas, kind) for kind in STRESSED},
}


if __name__ == "__main__":
    command.run(main)
