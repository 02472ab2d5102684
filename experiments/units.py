"""Differences between published trackers, units and calibrations and their predictions.

    python experiments/units.py --json units.json

Predicts the published trackers with the variations of their classes; compares calibrations drawn
from their covariance with simulated calibrations, the interpolated response of units with complete
trials, and the interval of a yield with the yield of many units; times 1,000 units at two ages; and
compares a design optimised for all its units with a design optimised for the unit as designed.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import chandra
import command
import numpy as np

from startrack import Camera, Refused, Streams, arcsec, load_design, shipped
from startrack.budget import Term, UnitBudgets, analytic, unit_budgets
from startrack.core import Floats
from startrack.design import (
    CameraCalibration,
    Case,
    Fidelity,
    Moment,
    Structure,
    found_at,
    replaced_all,
    unit_case,
)
from startrack.metrics import fraction_interval, quantile_of_few
from startrack.montecarlo import Sampling, Store, pool, resume
from startrack.optics import Optics, Residual
from startrack.population import Units, calibrated, drawn, left_over, per_unit, unit_trials
from startrack.response import errors as star_errors

ALL = tuple(term for term in Term if term is not Term.BIAS)
FLIGHT = (Term.NOISE, Term.PIXEL)


class Published(NamedTuple):
    """A published accuracy, rms per axis.

    across, about  arcsec; None where nothing is published
    family         family of trackers; the figures of its members give the constant of the family
    counts         classes of error that the figure includes
    jitter         arcsec, across and about, jitter of the vehicle, which the figure also includes
    magnitude      G of the star whose error is published, by noise and pixels; None: error of the
                   attitude
    required       whether the figure is a requirement, an upper bound, and not a result
    """

    across: float | None
    about: float | None
    family: str
    counts: tuple[Term, ...] = ALL
    jitter: tuple[float, float] = (0.0, 0.0)
    magnitude: float | None = None
    required: bool = False


class Head(NamedTuple):
    """A head with a published motion in orbit.

    parts         structure and platform
    focal_length  metre
    published     arcsec rms per axis
    changes       of the structure's values
    """

    parts: tuple[str, str]
    focal_length: float
    f_number: float
    bracket: str
    published: float
    changes: tuple[tuple[str, str], ...] = ()


HEADS = {
    "STECE": Head(("aluminium", "small"), 43.6e-3, 1.2, "0.1 m", 5.0),
    "CM-1": Head(("titanium", "controlled"), 50e-3, 1.4, "0.1 m", 0.5),
    "Swarm": Head(
        ("titanium", "small"),
        20e-3,
        1.2,
        "0.1 m",
        6.41 / 2**0.5,
        (("plate_expansion", "2.2 um / (m K)"),),
    ),
    "SED36": Head(("titanium", "controlled"), 32e-3, 1.2, "0 m", 1.1 / 3),
}


STEADY = tuple(term for term in ALL if term is not Term.THERMO_ELASTIC)
TRACKERS = {
    "rigel-l": Published(3.0, 28.0, "made"),
    "altair-hb": Published(10.0, 60.0, "shelf"),
    "vst-41m": Published(9.0, None, "shelf"),
    # Scatter between tests in a laboratory at constant temperature.
    "rufino-2013": Published(5.0, 30.0, "shelf", STEADY),
    # Six minutes on one field of the sky: constant errors do not scatter.
    "st5000": Published(0.54, 17.0, "made", FLIGHT, (0.5, 10.0)),
    # The scatter of guide stars that dither by a few pixels, over which the residual is constant.
    "chandra-aca": Published(0.06, None, "observatory", FLIGHT, magnitude=8.5),
    "plato-fcam": Published(0.3, None, "observatory", FLIGHT, magnitude=8.0, required=True),
    "apst": Published(None, None, "shelf"),
    "vst-68m": Published(5.0, 30.0, "shelf"),
    "st400": Published(5.0, 50.0, "shelf"),
    "st-16": Published(7.0, 70.0, "shelf"),
    "astro-aps": Published(1.0, 8.0, "made"),
    "ast-201": Published(0.99, 28.0, "made", STEADY),
    "sagitta": Published(2.0, 10.0, "made"),
    "he-5as": Published(1.07, 5.33, "made"),
    "clementine": Published(20.6, 92.8, "made"),
    # Nights on one mountain: errors constant in the field do not scatter.
    "oersted-asc": Published(1.4, 13.0, "made", FLIGHT),
}
FIRST = [
    "rigel-l",
    "altair-hb",
    "vst-41m",
    "rufino-2013",
    "st5000",
    "chandra-aca",
    "plato-fcam",
    "apst",
]
# Trackers whose covariance is compared with their errors: trackers judged by their attitude.
STATED = ["rigel-l", "altair-hb", "vst-41m", "rufino-2013", "st5000"]
FACTORS = np.geomspace(0.4, 2.5, 5)  # factors of both
RESIDUALS = ("rms", "angle", "grid", "flatness", "decentre", "tilt", "wedge", "drift")
HEAT = ("swing", "gradient_x", "gradient_y", "flux", "calibration_offset", "gradient_offset")


def tracker(name: str, factor: float = 1.0) -> Case:
    """A published tracker with residual and temperatures multiplied by a factor."""
    case = load_design(shipped(f"trackers/{name}.toml")).case
    if factor == 1:
        return case
    names = [f"instrument.residual.{part}" for part in RESIDUALS]
    names += [f"instrument.structure.{part}" for part in HEAT if case.instrument.structure]
    return replaced_all(case, {name: found_at(case, name) * factor for name in names})


def varied(design: str, *parts: str, changes: Sequence[str] = ()) -> Case:
    """A shipped design with the variations of some parts and changes "KEY=VALUE"."""
    include = json.dumps([f"variations/{part}.toml" for part in parts])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "varied.toml"
        path.write_text(f'base = "{design}"\ninclude = {include}\n', encoding="utf-8")
        return load_design(path, changes).case


def counted(budgets: UnitBudgets, one: Published) -> tuple[float, float]:
    """Rms over the units of the classes that a figure includes, across and about, arcsec."""
    square = sum(
        (budgets.terms[term] ** 2 for term in one.counts if term in budgets.terms),
        np.zeros((len(budgets), 3)),
    )
    x, y, z = square.mean(axis=0) / arcsec**2
    across, about = ((x + y) / 2 + one.jitter[0] ** 2) ** 0.5, (z + one.jitter[1] ** 2) ** 0.5
    return float(across), float(about)


def star_error(case: Case, one: Published) -> float:
    """Error of one star of a magnitude by its pixels and their noise, arcsec per axis."""
    assert one.magnitude is not None
    star, pixel = star_errors(case), 1 / case.instrument.camera.focal_length_px
    variance = sum(np.trace(each, axis1=1, axis2=2) / 2 for each in star.random.values())
    square = float(np.exp(np.interp(one.magnitude, star.magnitude, np.log(variance))))
    return float(square**0.5 * pixel / arcsec)


def trackers(names: list[str], units: int, seed: int) -> dict[str, Any]:
    """Predicted and published accuracy of each tracker at the begin of life, arcsec."""
    found: dict[str, Any] = {}
    for name in names:
        one = TRACKERS[name]
        case = tracker(name)
        if one.magnitude is None:
            across, about = counted(unit_budgets(case, seed, units, 0.0, 2), one)
        elif (
            case.tracker.acquisition == "box"
        ):  # images of guide stars, as on the page on its flight
            across, about = chandra.centroid({}, False)["centroid_mean_arcsec"], float("nan")
        else:
            across, about = star_error(case, one), float("nan")
        found[name] = {
            "across": [across, one.across],
            "about": [about if about == about else None, one.about],
            "family": one.family,
            "required": one.required,
        }
        print(
            f"{name:12s} {across:8.3g} / {about:8.3g} arcsec predicted, "
            f"{one.across} / {one.about} published",
            flush=True,
        )
    return found


def stated(cases: dict[str, Case], units: int, trials: int, seed: int) -> dict[str, float]:
    """Mean normalised squared error of units at the begin of life; 3 is expected.

    By trials of fidelity covariance; a tracker that it refuses is left out and reported.
    """
    found = {}
    for name, case in cases.items():
        how = Units(trials, min(10, trials))
        try:
            table = unit_trials(case, seed, range(units * trials), how)
        except ValueError as error:
            print(f"{name:12s} no covariance: {error}", flush=True)
            continue
        found[name] = float(table["nees"][table["solved"] & ~table["false"]].mean())
        print(f"{name:12s} normalised error squared {found[name]:.2f}", flush=True)
    return found


def ratios(found: dict[str, Any]) -> dict[str, float]:
    """The factor, at least one, between prediction and publication for each tracker's worse axis.

    Only for published results: a requirement is only a bound.
    """
    each = {}
    for name, one in found.items():
        if one["required"]:
            continue
        parts = [made / known for made, known in (one["across"], one["about"]) if known]
        if parts:
            each[name] = max(max(part, 1 / part) for part in parts)
    return each


def judged(found: dict[str, Any]) -> dict[str, Any]:
    """Accuracy of predictions, compared with a constant for each family.

    For results on the attitude or a star. A constant is the geometric mean of the published figures
    of the other trackers of the family, without the judged tracker; a family of one has no
    constant.
    """
    results = {name: one for name, one in found.items() if not one["required"]}
    off = {
        name: [
            math.log(made / known) if known else math.nan
            for made, known in (one["across"], one["about"])
        ]
        for name, one in results.items()
        if one["across"][1]
    }
    across = np.array([pair[0] for pair in off.values()])
    worst = np.array([np.nanmax(np.abs(pair)) for pair in off.values()])
    figures: dict[str, Any] = {
        "known": {name: [*one["across"], *one["about"]] for name, one in results.items()},
        "known_judged": len(off),
        "across_within_1_5": int((np.abs(across) <= math.log(1.5)).sum()),
        "both_within_2": int((worst <= math.log(2)).sum()),
        "both_within_3": int((worst <= math.log(3)).sum()),
        "geometric_mean": float(np.exp(across.mean())),
    }
    for axis, name in enumerate(("across", "about")):
        model, constant = [], []
        for tracker_name, pair in off.items():
            known = results[tracker_name][name][1]
            others = [
                one[name][1]
                for other, one in results.items()
                if other != tracker_name
                and one["family"] == results[tracker_name]["family"]
                and one[name][1]
            ]
            if known and others:
                model.append(pair[axis])
                constant.append(np.log(others).mean() - math.log(known))
        if model:
            figures[f"skill_{name}"] = rms(model) / rms(constant)
    return figures


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def leave_out(names: list[str], units: int, seed: int, tried: Floats = FACTORS) -> dict[str, Any]:
    """The fitted factor of a family, and its change without one tracker.

    A common factor on residual and temperatures of a family is fitted to its trackers: the least
    sum of squares of log (predicted / published), each tracker counted once. It is fitted again
    without each tracker.

    Returns  "factors" of the families, and "largest": the largest relative change of a prediction
             of another tracker of the family by leaving one out
    """
    fine = np.geomspace(tried[0], tried[-1], 400)
    factors, largest = {}, 0.0
    for family in ("made", "shelf"):
        members = [name for name in names if TRACKERS[name].family == family]
        members = [name for name in members if TRACKERS[name].across]
        if len(members) < 2:
            continue
        off, predicted = {}, {}
        for name in members:
            one = TRACKERS[name]
            nodes = [
                counted(unit_budgets(tracker(name, k), seed, units, 0.0, 2), one) for k in tried
            ]
            known = np.array([value for value in (one.across, one.about) if value])
            logs = np.log(np.array(nodes)[:, : len(known)])
            curve = [np.interp(np.log(fine), np.log(tried), column) for column in logs.T]
            predicted[name] = np.stack(curve)
            off[name] = np.mean((predicted[name] - np.log(known)[:, None]) ** 2, axis=0)
        best = int(np.argmin(sum(off.values())))
        factors[family] = float(fine[best])
        for name in members:
            other = int(np.argmin(sum(off[each] for each in members if each != name)))
            for each in members:
                if each != name:
                    moved = np.expm1(np.abs(predicted[each][:, other] - predicted[each][:, best]))
                    largest = max(largest, float(moved.max()))
                    print(
                        f"{family} without {name}: {fine[other]:.2f} instead of "
                        f"{fine[best]:.2f}, {each} by {moved.max():.1%}",
                        flush=True,
                    )
    return {"factors": factors, "largest": largest}


def calibration_ratio(units: int, seed: int, case: Case) -> float:
    """Residual of drawn calibrations over the frame, divided by the residual of simulated
    calibrations."""
    square = np.zeros(2)
    settings = case.tracker.calibration
    assert settings
    for number in range(units):
        unit = unit_case(case, seed, Moment(number))
        camera, design = unit.instrument.camera, unit.as_designed.believed_camera
        for k, find in enumerate((drawn, calibrated)):
            left = left_over(camera, find(camera, design, settings, Streams(seed, number)))
            square[k] += np.mean(left**2)
    return float(np.sqrt(square[0] / square[1]))


MAPS = (
    CameraCalibration(positions=100, direction=arcsec),
    CameraCalibration(positions=100, direction=arcsec, order=5, tangential=True),
    CameraCalibration(positions=400, direction=arcsec, order=5, tangential=True, map=5),
    CameraCalibration(place="orbit", frames=200, stars=8, noise=0.05, map=4),
)


def calibration_map_error(units: int, seed: int) -> float:
    """Largest relative difference between residuals of drawn and of simulated calibrations of a
    lens.

    For orders, positions and maps, with a double Gauss as built and a detector that is not flat.
    """
    optics, pitch = Optics(focal_length=0.035, f_number=2.0), 5.5e-6
    design = Camera(2048, 2048, optics.focal_length / pitch)
    residual = Residual(
        angle=5 * arcsec,
        grid=0.1e-6,
        flatness=2e-6,
        decentre=25e-6,
        tilt=90 * arcsec,
        wedge=90 * arcsec,
        family="double-gauss",
    )
    worst = 0.0
    for settings in MAPS:
        square = np.zeros(2)
        for number in range(1, units + 1):
            shape = replace(residual, seed=number).field(design, optics, pitch)
            camera = replace(design, residual=shape)
            for k, find in enumerate((drawn, calibrated)):
                believed = find(camera, design, settings, Streams(seed, number))
                square[k] += np.mean(left_over(camera, believed) ** 2)
        worst = max(worst, float(abs(np.sqrt(square[0] / square[1]) - 1)))
    return worst


def response_error(units: int, trials: int, seed: int, case: Case) -> tuple[float, float]:
    """Relative difference between a unit's interpolated rms and its complete trials: median, worst.

    Over the units, across and about the boresight.
    """
    fast, whole = (
        per_unit(
            unit_trials(case, seed, range(units * trials), Units(trials, 1, case.lifetime, exact))
        )
        for exact in (False, True)
    )
    apart = [np.abs(one / other - 1) for one, other in zip(fast[1:], whole[1:], strict=True)]
    every = np.concatenate(apart)
    return float(np.median(every)), float(every.max())


def thousand_units(units: int, trials: int, seed: int, case: Case, workers: int) -> float:
    """Seconds for the trials of units at the begin and the end of life."""
    began = time.perf_counter()
    with pool(workers) as executor:
        for age in (0.0, case.lifetime):
            sampling = Sampling(Fidelity.COVARIANCE, units=Units(trials, min(10, trials), age))
            with Store(None, case, seed, sampling) as store:
                resume(store, executor, workers, units * trials, block=5000)
    return time.perf_counter() - began


def yield_coverage(repetitions: int, units: int, trials: int, seed: int, case: Case) -> float:
    """Fraction of repetitions whose 95 % interval contains the yield of all units."""
    how = Units(trials, 1, case.lifetime)
    every = per_unit(unit_trials(case, seed, range(repetitions * units * trials), how)).across
    limit = np.quantile(every, 0.8)
    good = (every <= limit).reshape(repetitions, units)
    held = [fraction_interval(int(row.sum()), units) for row in good]
    return float(np.mean([one.low <= good.mean() <= one.high for one in held]))


def designs(case: Case) -> Iterator[Case]:
    """Designs with the same aperture and different focal lengths and blurs of the image."""
    optics = case.instrument.optics
    for size in (0.6, 1.0, 1.6):
        for blur in (0.7, 1.0, 1.5):
            yield replaced_all(
                case,
                {
                    "instrument.optics.focal_length": optics.focal_length * size,
                    "instrument.optics.f_number": optics.f_number * size,
                    "instrument.optics.blur": optics.blur * blur,
                },
            )


def robust(units: int, seed: int, every: list[Case]) -> tuple[float, float]:
    """Yield at the end of life of the design with the highest yield, and of the best nominal
    design.

    The requirement is an rms across that 40 % of the units of the middle design meet. Both are
    judged on units that were not used for the choice.
    """
    errors = [unit_budgets(one, seed, units, one.lifetime, 2).across() for one in every]
    noise = [analytic(one.without_units, 64).across for one in every]
    limit = float(np.quantile(errors[len(every) // 2], 0.4))
    best = int(np.argmax([(each <= limit).mean() - each.mean() / limit / 1e3 for each in errors]))
    fresh = [
        unit_budgets(every[k], seed + 1, units, every[k].lifetime, 2).across()
        for k in (best, int(np.argmin(noise)))
    ]
    return float((fresh[0] <= limit).mean()), float((fresh[1] <= limit).mean())


def of_class(structure: str, platform: str, **changes: str) -> Structure:
    """A structure on a platform, as in a design with these parts, with changed values.

    Unknown values are at the median of their law.
    """
    parts = f"structure-{structure}", f"platform-{platform}"
    words = [f"instrument.structure.{key}={value}" for key, value in changes.items()]
    made = varied("designs/noise_only.toml", *parts, changes=words).instrument.structure
    assert made
    return made


def structure_error() -> float:
    """The worst relative difference of a boresight's rotation between the formulas and finite
    elements."""
    path = Path(__file__).parents[1] / "tests/oracle/structure.json"
    worst = 0.0
    for case in json.loads(path.read_text(encoding="utf-8"))["cases"]:
        head = case["head"]
        structure = Structure(
            expansion=case["expansion"],
            plate_expansion=case["panel"],
            length=head["length"],
            diameter=head["diameter"],
            wall=head["wall"],
            feet_span=head["span"],
            height=head["height"],
            feet_thickness=head["foot"],
            base=head["base"],
            offset=head["offset"],
        )
        optics = Optics(focal_length=head["focal"], f_number=1.5)
        kelvin = [case["mean"], case["gradient"], 0.0, case["tube"], 0.0]
        turn = structure.responses(optics, 5e-6)["instrument.mounting.y"] @ kelvin
        worst = max(worst, abs(float(turn) / case["turn"] - 1))
    return worst


def structure_motion() -> dict[str, tuple[float, float, float]]:
    """Rms across of heads over an orbit, arcsec per axis: at the flange, on a bracket, published.

    Focal lengths and f-numbers follow from fields of view or are assumed, as are brackets of 0.1 m;
    the bracket of SED36 is on the instrument. Published: see docs/units.md.
    """
    found = {}
    for name, head in HEADS.items():
        optics = Optics(focal_length=head.focal_length, f_number=head.f_number)
        flange, above = (
            np.hypot(
                *of_class(*head.parts, **dict(head.changes), bracket=bracket).swings(optics)[:2]
            )
            for bracket in ("0 m", head.bracket)
        )
        each = float(flange) / arcsec / 2**0.5, float(above) / arcsec / 2**0.5
        found[name] = (*each, head.published)
    return found


FEET = "instrument.structure.feet_thickness"
LENS: dict[str, list[Any]] = {
    "instrument.optics.focal_length": [35e-3, 42e-3, 50e-3, 58e-3],
    "instrument.optics.f_number": [2.0, 2.4, 3.0, 3.6],
}
LEVERS: dict[str, list[Any]] = {
    "tracker.calibration.map": [0, 5, 7],
    "tracker.detection.max_spots": [10, 15, 22],
    "tracker.calibration.positions": [200, 400],
    "instrument.structure.material": ["aluminium", "titanium", "invar", "carbon"],
    "instrument.structure.heater": [0.0, 0.2, 0.4],
    "instrument.detector.exposure": [0.08, 0.12, 0.2],
    "instrument.structure.detector_offset": [5e-3, 1e-3],
    "instrument.structure.height": [10e-3, 5e-3],
    "instrument.structure.wall": [2e-3, 3e-3],
    "tracker.focal_length_by_colour": [False, True],
}


def levers_gain(seed: int, units: int, quick: bool) -> dict[str, Any]:
    """Error not exceeded by 95 % of fresh units, optimised over the levers of a design, and over
    its lens alone.

    For the shipped nanosatellite at the end of life, by budgets: each parameter in turn takes the
    best of some values until no value is better, within the mass and power of the campaign; with
    levers at the price of the lens alone, and at any price. The fresh units are equal in
    number and have another seed.
    """
    design = load_design(shipped("designs/nanosatellite.toml"))
    assert design.campaign
    needs = design.campaign.requirements

    def level(case: Case, by: int) -> float:
        budgets = unit_budgets(case, by, units, case.lifetime, 2, 16 if quick else 32, apart=False)
        if budgets.availability.min() < needs.min_availability:
            return math.inf
        return float(quantile_of_few(budgets.across(), 0.95)) / arcsec

    def costs(case: Case) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([needs.mass(case), needs.power(case), needs.cost(case)])

    def best(case: Case, values: dict[str, list[Any]], most: Floats) -> Case:
        least, better = level(case, seed), True
        while better:
            better = False
            for name, every in values.items():
                for value in every:
                    try:
                        # Feet of a different material from the panel are thin, as in the shipped
                        # parts.
                        thin = {FEET: 2e-3} if name.endswith("material") else {}
                        tried = replaced_all(case, {name: value, **thin})
                    except Refused:
                        continue
                    if (costs(tried) > most * (1 + 1e-9)).any() or found_at(case, name) == value:
                        continue
                    now = level(tried, seed)
                    if now < 0.99 * least:
                        case, least, better = tried, now, not quick
        return case

    limits = np.array([needs.max_mass, needs.max_power, math.inf])
    lens = best(design.case, LENS, limits)
    values = LEVERS if quick else {**LEVERS, **LENS}
    priced = np.array([*limits[:2], needs.cost(lens)])
    designs = [lens, best(lens, values, priced), best(lens, values, limits)]
    fresh = [level(case, seed + 1) for case in designs]
    return {
        "levers_gain": fresh[0] / fresh[1],
        "levers_gain_at_any_price": fresh[0] / fresh[2],
        "levers": [
            {"level_arcsec": at}
            | {name: found_at(case, name) for name in {**LENS, **LEVERS}}
            | dict(zip(("mass_kg", "power_w", "price"), costs(case).tolist(), strict=True))
            for at, case in zip(fresh, designs, strict=True)
        ],
    }


def few(case: Case) -> Case:
    """The case with fewer varying parameters, for fewer plans."""
    kept = tuple(one for one in case.variation if not one.name.startswith("instrument.det"))
    return replace(case, variation=kept[:4])


def steps(
    options: argparse.Namespace, case: Case, names: list[str]
) -> list[Callable[[], dict[str, Any]]]:
    """The steps of the experiment in order; each step gives some of the figures."""
    seed, quick = options.seed, options.quick
    size = 4 if quick else 100
    stating = {names[0]: few(tracker(names[0]))} if quick else {one: tracker(one) for one in STATED}

    def published() -> dict[str, Any]:
        found = trackers(names, options.units, seed)
        each = ratios({name: found[name] for name in FIRST if name in found})
        within = [sum(one <= limit for one in each.values()) for limit in (1.5, 2)]
        return {
            **judged(found),
            "trackers": found,
            "within_1_5": within[0],
            "within_2": within[1],
            "judged": len(each),
        }

    def without() -> dict[str, Any]:
        some = ["vst-41m", "altair-hb"] if quick else FIRST
        found = leave_out(some, max(options.units // 2, 1), seed, FACTORS[:: 4 if quick else 1])
        return {"leave_one_out": found, "leave_one_out_max": found["largest"]}

    def response() -> dict[str, Any]:
        median, worst = response_error(1 if quick else 8, size, seed, case)
        return {"unit_response_error": median, "unit_response_worst": worst}

    def coverage() -> dict[str, Any]:
        units, trials = (2, 2) if quick else (30, 20)
        return {"yield_coverage": yield_coverage(options.repetitions, units, trials, seed, case)}

    def chosen() -> dict[str, Any]:
        every = list(designs(case))[: 2 if quick else None]
        best, nominal = robust(options.choices, seed, every)
        return {"robust_yield": best, "nominal_yield": nominal}

    return [
        published,
        without,
        lambda: {"unit_nees": stated(stating, options.units, size, seed)},
        lambda: levers_gain(seed, 3 if quick else 20, quick),
        lambda: {"structure_error": structure_error(), "structure_motion": structure_motion()},
        lambda: {"calibration_ratio": calibration_ratio(options.calibrations, seed, case)},
        lambda: {"calibration_map_error": calibration_map_error(2 if quick else 30, seed)},
        response,
        lambda: {
            "thousand_units_s": thousand_units(options.thousand, size, seed, case, options.workers)
        },
        coverage,
        chosen,
    ]


def main() -> None:
    """Print all figures, and write them as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--units", type=int, default=24, help="number of units of each tracker")
    parser.add_argument("--thousand", type=int, default=1000, help="number of units in the timing")
    parser.add_argument(
        "--repetitions", type=int, default=200, help="number of repetitions of a yield"
    )
    parser.add_argument(
        "--calibrations", type=int, default=200, help="number of calibrations to run"
    )
    parser.add_argument(
        "--choices", type=int, default=40, help="number of units that a choice is based on"
    )
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    options = command.read(
        parser, units=1, thousand=1, repetitions=2, calibrations=1, choices=1, workers=1
    )
    case = varied("designs/noise_only.toml", "space-lens")
    if options.quick:
        case = few(case)
    figures: dict[str, Any] = {}
    names = ["vst-41m", "plato-fcam"] if options.quick else list(TRACKERS)
    for step in steps(options, case, names):
        began = time.perf_counter()
        new = step()
        figures.update(new)
        command.save(options, figures)  # so that completed steps are not lost
        print(f"{', '.join(new)}: {time.perf_counter() - began:.0f} s", flush=True)
    for name, value in figures.items():
        print(f"{name}: {value}")


if __name__ == "__main__":
    command.run(main)
