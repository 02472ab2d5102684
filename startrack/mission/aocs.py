"""Case -> HeadModel: its error as data and C code, for simulators of attitude control."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from startrack.budget import Budget, Law, Term, analytic
from startrack.core import Refused
from startrack.design import Case, turning
from startrack.io import save_json, save_text
from startrack.mission.heads import limits_of
from startrack.mission.parameters import Head
from startrack.mission.summary import timing_of

# Pixels that a star moves in an exposure at the rates of the table, besides 0; chosen by hand.
SMEARS: tuple[float, ...] = (0.1, 0.3, 0.7, 1.5, 3.0, 6.0, 12.0)
LEAST = 0.5  # availability below which the table of rates ends
# Stars' errors over a pixel repeat with it, and are unlike after a fraction of it; chosen by hand.
PIXEL_LENGTH = 0.5  # pixel
SOURCES = ("startrack_head.c", "startrack_head.h")
CONVENTION = (
    "quaternion x, y, z, w (scalar last) of icrs_to_camera, which takes directions from ICRS axes "
    "into camera axes: z boresight, x to larger columns, y to larger rows; measured = exp(error) "
    "true, with the error about the camera's axes; pairs are across (per axis) and about the "
    "boresight; SI units"
)


@dataclass(frozen=True)
class HeadModel:
    """The error of a star tracker over rate and time; see startrack_head.h.

    name           of the design
    period         second, between two frames
    latency        second, from the middle of the exposure to the end of the read-out
    rate           (r,) radian / second across the boresight, from 0
    noise, pixel, field   ((r,), (r,)) radian rms across and about: temporal noise, pixel spatial
                   error, FOV spatial error
    available      (r,) 1, fraction of the sky and time with an attitude
    bias, swing    radian rms, across and about: constant, and thermo-elastic over an orbit
    pixel_length, field_length   radian that the boresight turns while these errors change
    sun, moon, limb  radian, exclusion angles
    """

    name: str
    period: float
    latency: float
    rate: tuple[float, ...]
    noise: tuple[tuple[float, ...], tuple[float, ...]]
    pixel: tuple[tuple[float, ...], tuple[float, ...]]
    field: tuple[tuple[float, ...], tuple[float, ...]]
    available: tuple[float, ...]
    bias: tuple[float, float]
    swing: tuple[float, float]
    pixel_length: float
    field_length: float
    sun: float
    moon: float
    limb: float

    @property
    def table(self) -> dict[str, Any]:
        """For JSON, with the convention in words."""
        return {"convention": CONVENTION, **asdict(self)}


def head_model(case: Case, name: str) -> HeadModel:
    """The error model of a design, by its analytic budget at each rate.

    Raises    ValueError where the budget refuses the case, or no field has an attitude at rest.
    Accuracy  model: that of `budget.analytic` for the variances; that errors over the pixel and the
              field are Gauss-Markov, with half a pixel and a field as their lengths, is an
              assumption. A roll counts as no rate. Faster than the table, whose smear ends at 12
              pixels, there is no attitude.
    """
    rates, budgets = _over_rates(case)
    limits = limits_of(Head(name or "head", ""), case)
    camera, detector = case.instrument.camera, case.instrument.detector

    def rms(*terms: Term) -> tuple[tuple[float, ...], tuple[float, ...]]:
        square = [[np.square(one.term(term)) for term in terms] for one in budgets]
        across, about = np.sqrt(np.sum(square, axis=1)).T
        return tuple(map(float, across)), tuple(map(float, about))

    bias = rms(Term.BIAS, Term.ABERRATION, Term.MEASUREMENT_DATE)
    swing = rms(Term.THERMO_ELASTIC)
    return HeadModel(
        name,
        *timing_of(case),
        tuple(rates),
        rms(Term.NOISE),
        rms(Term.PIXEL),
        rms(Term.FIELD),
        tuple(float(one.availability) for one in budgets),
        (bias[0][0], bias[1][0]),
        (swing[0][0], swing[1][0]),
        PIXEL_LENGTH / camera.focal_length_px,
        2 * math.atan(min(detector.columns, detector.rows) / 2 / camera.focal_length_px),
        limits.sun,
        limits.moon,
        limits.earth,
    )


def _over_rates(case: Case) -> tuple[list[float], list[Budget[Law]]]:
    """The rates of the table, up to the last at which half of the sky has an attitude."""
    pixel = 1 / case.instrument.camera.focal_length_px / case.instrument.detector.exposure
    rates, budgets = [0.0], [analytic(turning(case, 0.0))]
    for smear in SMEARS:
        rate = smear * pixel
        try:
            found = analytic(turning(case, rate))
        except Refused:  # no field has an attitude
            break
        if found.availability < LEAST:
            break
        rates.append(rate)
        budgets.append(found)
    if len(rates) < 2:  # two rows at least, as tables have
        rates, budgets = [0.0, SMEARS[0] * pixel / 100], [budgets[0], budgets[0]]
    return rates, budgets


def write_model(folder: Path, model: HeadModel) -> list[Path]:
    """Write the model as JSON and as C; the C is in two files that are the same for all designs.

    Returns  the files
    """
    files = model_sources(model)
    for name, text in files.items():
        save_text(folder / name, text)
    save_json(folder / "startrack_head.json", model.table)
    return [folder / name for name in (*files, "startrack_head.json")]


def model_sources(model: HeadModel) -> dict[str, str]:
    """The C of the model, file by file."""
    files = {name: (Path(__file__).parent / name).read_text(encoding="utf-8") for name in SOURCES}
    return {**files, "startrack_head_data.h": _data(model)}


def _data(model: HeadModel) -> str:
    count = len(model.rate)
    single = {
        "PERIOD": model.period,
        "LATENCY": model.latency,
        "PIXEL": model.pixel_length,
        "FIELD": model.field_length,
        "SUN": model.sun,
        "MOON": model.moon,
        "LIMB": model.limb,
    }
    lines = [
        "/* Numbers of one design for startrack_head.c; radian and second. */",
        "#ifndef STARTRACK_HEAD_DATA_H",
        "#define STARTRACK_HEAD_DATA_H",
        "",
        f"#define STARTRACK_RATES {count}",
        *(f"#define STARTRACK_{name} {value!r}" for name, value in single.items()),
        "",
        f"static const double startrack_rate[{count}] = {_row(model.rate)};",
        f"static const double startrack_available[{count}] = {_row(model.available)};",
        "/* across the boresight, about it */",
    ]
    for name in ("noise", "pixel", "field"):
        across, about = (_row(one) for one in getattr(model, name))
        lines.append(
            f"static const double startrack_{name}[2][{count}] = {{\n    {across},\n    {about}}};"
        )
    for name in ("bias", "swing"):
        lines.append(f"static const double startrack_{name}[2] = {_row(getattr(model, name))};")
    return "\n".join([*lines, "", "#endif", ""])


def _row(values: tuple[float, ...]) -> str:
    parts = [repr(float(value)) for value in values]
    rows = [", ".join(parts[k : k + 4]) for k in range(0, len(parts), 4)]
    return "{" + ",\n     ".join(rows) + "}"
