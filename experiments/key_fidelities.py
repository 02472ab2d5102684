"""Which fidelities use each key of a design file?

python experiments/key_fidelities.py [--json FILE] [--write] [--quick]

Each key that trials depend on is set in a small design, with the other keys that it needs. Keys of
the sky within the air are set in a daylight camera, because that sky fills the pixels of the small
design. `frame` uses all keys. Another fidelity refuses a key if it refuses that design. It leaves a
key out if it computes trials without reading the key, while `frame` reads it in the same trials.
The error budget also leaves out keys that it reports. `--write` writes
`catalogs/designs/fidelities.json`, the source of the column in `docs/list_keys.py` and `startrack
keys`; `--quick` compares the refusals of one key of each table with that file.

A key that is read may still have no effect on the result. The package radbelt must be installed
(`startrack[radiation]`).
"""

from __future__ import annotations

import argparse
import copy
import gc
import json
import re
import sys
import tomllib
import typing
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import one_thread  # noqa: F401  # isort: skip
import command

from startrack import Case, Fidelity, shipped
from startrack.budget import analytic, of_the_case, refuse_scans
from startrack.core import Field, fields_of
from startrack.design import item_of, range_of, with_product
from startrack.io import from_table, save_json, written
from startrack.montecarlo import Serial, run
from startrack.trial import require_fidelity

FILE = shipped("designs") / "fidelities.json"
BUDGET = "budget"
CHECKS = ("__post_init__", "__hash__", "__eq__", "__repr__", "replace", "of_the_case")
COMPUTED = ("seen_from", "believed_from")  # which the constructor of a case calls
COMPUTING = re.compile(
    r"startrack\.(attitude|budget|catalog|detect|identification|metrics|motion|optics|scene|trial)"
)
CHEAPER = (*list(Fidelity)[1:], BUDGET)
TABLES = ("instrument", "tracker", "scene", "catalog")
SEED, TRIALS, FIELDS = 5, 3, 16
SMALL = 0.01  # value, in the file's unit, of a key whose default is zero
TAKEN: dict[str, list[str]] = {"refused": [], "left_out": []}
CODE = "somelab.parts:one"  # named, never run
Table = dict[str, Any]
# Values without a rule.
VALUES: Table = {
    "instrument.optics.psf": "gaussian",
    "instrument.optics.object_distance": "1000 m",
    "instrument.optics.family_field": "10 deg",
    "instrument.structure.feet_span": "60 mm",  # above the thickness of the feet
    "instrument.structure.mean_profile": ["1 K", "2 K"],
    "instrument.structure.gradient_x_profile": ["1 K / m", "2 K / m"],
    "instrument.structure.gradient_y_profile": ["1 K / m", "2 K / m"],
    "instrument.structure.heat.epoch": "2026-06-21T12:00:00",
    "instrument.structure.heat.size": ["0.3 m", "0.3 m", "0.4 m"],
    "instrument.structure.heat.head_size": ["80 mm", "120 mm"],
    "instrument.optics.lens_file": "double_gauss",
    "instrument.optics.lens_family": "double-gauss",
    "instrument.optics.psf_file": "chandra-aca",
    "instrument.optics.aberrations.noll": 4,
    "instrument.optics.aberrations.rms": "20 nm",
    "instrument.optics.pupil.segments.x": 0.0,
    "instrument.optics.pupil.segments.y": 0.0,
    "instrument.optics.pupil.segments.size": 0.8,
    "instrument.detector.product": "has2",
    "instrument.detector.pixel_pitch_y": "24 um",  # value of the small design
    "instrument.detector.region.array_columns": 1024,
    "instrument.detector.region.array_rows": 1024,
    "instrument.detector.thermal.temperature": "293 K",
    "instrument.detector.scan.lines.row": 100.0,
    "instrument.detector.age.time": "1 yr",
    "instrument.detector.age.year": 2020.0,
    "instrument.detector.age.launch": 2019.0,
    "instrument.detector.age.inclination": "98 deg",
    "instrument.detector.age.shielding": "5 mm",
    "instrument.detector.scan.kind": "lines",
    "instrument.detector.scan.stages": 1,
    "instrument.detector.age.transfer_loss": "1e-4 yr-1",
    "instrument.structure.displacements": str(Path(__file__).parent / "displacements.csv"),
    "tracker.detection.window": 7,
    "tracker.detection.search": CODE,
    "tracker.identification.method": CODE,
    "tracker.attitude.method": CODE,
    "instrument.thermal.lens": "20 degC",
    "tracker.calibrated_at": "20 degC",
    "tracker.box.size": 8,
    "tracker.calibration.order": 5,
    "tracker.calibration.map": 3,
    "tracker.camera.residual.columns": 9,
    "tracker.camera.residual.rows": 9,
    "tracker.camera.residual.value": [0.01] * 162,
    "scene.place": ["1 AU", "0 AU", "0 AU"],
    "scene.background_g": 21.0,
    "scene.date": "2026-03-20T12:00:00",
    "scene.lights": ["zodiacal"],
    "scene.sky.height": "36 km",
    "scene.sky.elevation": "45 deg",
    "scene.sky.sun_elevation": "40 deg",
    "scene.sky.sun_distance": "90 deg",
    "scene.sky.latitude": "50 deg",  # where the Sun is 40 degrees high at noon of that date
    "scene.sky.longitude": "0 deg",
    "scene.sky.azimuth": "60 deg",
    "instrument.tube.length": "150 mm",
    "instrument.tube.diameter": "300 mm",
}
VALUES |= {"catalog.random_g": 9.0, "tracker.catalog.random_g": 8.0}  # the limit: none
for _axis in "xyz":  # a tracker's mounting must not swing
    VALUES[f"tracker.mounting.swing_{_axis}"] = "0 arcsec"
for _place in ("instrument", "tracker"):
    VALUES |= {
        f"{_place}.motion.broadband.frequency": ["1 Hz", "100 Hz"],
        f"{_place}.motion.broadband.density": ["0.1 arcsec2 / Hz", "0.001 arcsec2 / Hz"],
        f"{_place}.motion.jitter": [CODE],
    }
for _place in ("catalog", "tracker.catalog"):
    VALUES |= {
        f"{_place}.source": "bright",
        f"{_place}.orbital_velocity": ["1 km / s", "0 km / s", "0 km / s"],
        f"{_place}.format": "auto",
        f"{_place}.epoch": 2020.0,
        f"{_place}.columns": [],
        f"{_place}.limit_g": 6.5,
    }
for _colour in ("red", "green", "blue"):
    VALUES |= {
        f"instrument.detector.mosaic.{_colour}.wavelength": ["500 nm", "600 nm"],
        f"instrument.detector.mosaic.{_colour}.value": [0.3, 0.4],
    }
# Further keys that a key, or the keys of a table, need.
LENS = ("instrument.optics.lens_file",)
DATE, AGED = ("scene.date",), ("instrument.detector.age.time",)
PROFILES = tuple(
    f"instrument.structure.{name}_profile" for name in ("mean", "gradient_x", "gradient_y")
)
ORBIT = ("instrument.detector.age.inclination", "instrument.detector.age.shielding", *AGED)
BY_DATE = (*(f"scene.sky.{name}" for name in ("latitude", "longitude", "azimuth")), *DATE)
BESIDE: dict[str, tuple[str, ...]] = {
    "instrument.optics.pupil.vanes": ("instrument.optics.pupil.vane_width",),
    "instrument.optics.pupil.vane_width": ("instrument.optics.pupil.vanes",),
    "instrument.optics.family_field": ("instrument.optics.lens_family",),
    "instrument.optics.lens_field": LENS,
    "instrument.optics.lens_colour": LENS,
    "instrument.thermal": LENS,
    "instrument.ghosts": LENS,
    "instrument.detector.scan.kind": ("instrument.detector.scan.lines.row",),
    "instrument.detector.scan.lines": ("instrument.detector.scan.kind",),
    "instrument.detector.age": AGED,
    "instrument.detector.age.year": ("instrument.detector.age.launch",),
    "instrument.detector.age.launch": ("instrument.detector.age.year",),
    "instrument.detector.age.inclination": ("instrument.detector.age.shielding", *AGED),
    "instrument.detector.age.shielding": ("instrument.detector.age.inclination", *AGED),
    "instrument.structure.mean_profile": PROFILES,
    "instrument.structure.gradient_x_profile": PROFILES,
    "instrument.structure.gradient_y_profile": PROFILES,
    "instrument.detector.age.altitude": ORBIT,
    "instrument.detector.age.solar_events": ORBIT,
    "catalog.orbital_velocity": ("catalog.aberration",),
    "tracker.catalog.orbital_velocity": ("catalog.aberration", "tracker.catalog.aberration"),
    "instrument.motion.tones": ("instrument.motion.tones.rms_x",),
    "instrument.residual": ("instrument.residual.rms",),
    "instrument.detector.defects.hot_current": ("instrument.detector.defects.hot",),
    "tracker.motion.tones": ("tracker.motion.tones.rms_x",),
    "tracker.box": ("tracker.acquisition",),
    "scene.lights": DATE,
    "scene.sky": ("scene.sky.sun_elevation", "scene.sky.sun_distance"),
    **{f"scene.sky.{name}": BY_DATE for name in ("latitude", "longitude", "azimuth")},
    "tracker.calibrated_at": LENS,
    "tracker.focal_length_by_colour": LENS,
    "tracker.detection.dark_map_age": ("tracker.detection.dark_map.frames", *AGED),
}
for _colour in ("red", "green", "blue"):
    _curve = f"instrument.detector.mosaic.{_colour}"
    BESIDE |= {
        f"{_curve}.wavelength": (f"{_curve}.value",),
        f"{_curve}.value": (f"{_curve}.wavelength",),
    }


@cache
def classes() -> dict[str, tuple[type, Field]]:
    """The class of each key or table, and its field there."""

    def within(kind: type, place: str) -> Iterator[tuple[str, tuple[type, Field]]]:
        for name, field in fields_of(kind).items():
            yield f"{place}{name}", (kind, field)
            inner, _ = item_of(field)
            if hasattr(inner, "__dataclass_fields__"):
                yield from within(inner, f"{place}{name}.")

    return {name: one for name, one in within(Case, "") if name.split(".")[0] in TABLES}


def keys() -> list[str]:
    """All keys that are not tables."""
    return [name for name in classes() if not is_table(name)]


def is_table(name: str) -> bool:
    return hasattr(item_of(classes()[name][1])[0], "__dataclass_fields__")


def value_of(name: str) -> Any:
    """A value of a key in the form of a file, different from its default."""
    if name in VALUES:
        return VALUES[name]
    if held(small(), name):
        return got(small(), name)
    _, field = classes()[name]
    limits, (kind, _) = range_of(field), item_of(field)
    several = typing.get_origin(field.kind) is tuple
    if limits.choices:
        return next(one for one in limits.choices if one != field.default)
    if kind is bool:
        return not field.default
    if kind is str:
        return [CODE] if several else CODE
    default = field.default if isinstance(field.default, int | float) else 0
    if kind is int:
        return default + 1 if limits.holds(default + 1) else default - 1
    if several:
        number = f"{SMALL} {field.unit.shown}" if field.unit else SMALL
        return [number]
    value = 1.02 * default if limits.holds(1.02 * default) else 0.98 * default
    text = written(field, value)
    if value == 0:
        text = f"{SMALL} {field.unit.shown}" if field.unit else SMALL
    return text


def put(table: Table, name: str, value: Any) -> None:
    """Set a key, in the first table of a list of tables."""
    *places, last = name.split(".")
    held: Any = table
    for depth, place in enumerate(places, 1):
        several = typing.get_origin(classes()[".".join(places[:depth])][1].kind) is tuple
        held = held.setdefault(place, [{}] if several else {})
        held = held[0] if several else held
    held[last] = value


def design_with(name: str) -> Table:
    """The design of `base` with a key and the further keys that it needs."""
    table = copy.deepcopy(base(name))
    parts = name.split(".")
    places = [".".join(parts[:depth]) for depth in range(1, len(parts) + 1)]
    needed = BESIDE.get(name) or [one for place in places for one in BESIDE.get(place, ())]
    for other in (*needed, *required(places[:-1])):
        if not held(table, other):
            put(table, other, value_of(other))
    put(table, name, value_of(name))
    return table


def required(places: list[str]) -> list[str]:
    """Required keys of tables."""
    return [
        name
        for name, (_, field) in classes().items()
        if field.required and name.rpartition(".")[0] in places and not is_table(name)
    ]


def held(table: Any, name: str) -> bool:
    for part in name.split("."):
        table = table[0] if isinstance(table, list) else table
        if part not in table:
            return False
        table = table[part]
    return True


def got(table: Any, name: str) -> Any:
    for part in name.split("."):
        table = table[0] if isinstance(table, list) else table
        table = table[part]
    return table


@cache
def small() -> Table:
    table = tomllib.loads(shipped("designs/noise_only.toml").read_text(encoding="utf-8"))
    instrument = table["instrument"]
    del table["scene"]["background_g"], table["campaign"], instrument["optics"]["psf"]
    # The pixels of the shipped PSF file.
    instrument["detector"] |= {"columns": 256, "rows": 256, "pixel_pitch": "24 um"}
    instrument["optics"]["focal_length"] = "30 mm"
    return table


@cache
def daylight() -> Table:
    """A daylight camera, without its sky."""
    table = tomllib.loads(shipped("designs/daylight_balloon.toml").read_text(encoding="utf-8"))
    del table["scene"], table["campaign"]
    return table


def base(name: str) -> Table:
    """The design for a key: the daylight sky would fill the pixels of the small design."""
    return daylight() if name.startswith("scene.sky.") else small()


def case_of(table: Table) -> Case:
    return from_table(Case, with_product(copy.deepcopy(table)))


def refused(name: str) -> list[str]:
    """The fidelities that refuse a key."""
    case = case_of(design_with(name))

    def refuses(column: str) -> bool:
        try:
            if column == BUDGET:
                refuse_scans(case)
            else:
                require_fidelity(case, Fidelity(column))
        except ValueError:
            return True
        return False

    return [str(column) for column in CHEAPER if refuses(column)]


def said_left_out(name: str) -> bool:
    """Whether the budget reports that it leaves a key out.

    Its report on the sky by day concerns all fidelities, and no single key.
    """
    sky = name.startswith("scene.sky.")
    plain = of_the_case(case_of(design_with("scene.sky.height") if sky else small()))
    return not set(of_the_case(case_of(design_with(name)))) <= set(plain)


def together(names: list[str]) -> list[Table]:
    """Designs with all keys of a table together, and one design for each key that does not fit."""
    whole, alone = design_with(names[0]), []
    for name in names[1:]:
        trial = copy.deepcopy(whole)
        for other in (*BESIDE.get(name, ()), name):
            put(trial, other, value_of(other))
        try:
            case_of(trial)
            whole = trial
        except ValueError:
            alone.append(design_with(name))
    return [whole, *alone]


@contextmanager
def reading(table: str) -> Iterator[tuple[set[str], list[Any]]]:
    """The keys of a table that are read, except for checks, comparisons and copies.

    If several tables have the same class: keys of objects equal to one of the list.
    """
    names = {name.rpartition(".")[2] for name in classes() if name.rpartition(".")[0] == table}
    kind = next(kind for name, (kind, _) in classes().items() if name.rpartition(".")[0] == table)
    places = {name.rpartition(".")[0] for name, (one, _) in classes().items() if one is kind}
    found, parts, busy = set[str](), list[Any](), [False]

    def read(self: Any, key: str) -> Any:
        if key in names and not busy[0] and not checking():
            busy[0] = True
            if len(places) == 1 or any(self is one or self == one for one in parts):
                found.add(f"{table}.{key}")
            busy[0] = False
        return object.__getattribute__(self, key)

    with mock.patch.object(kind, "__getattribute__", read):
        yield found, parts


def part_of(case: Case, table: str) -> Any:
    """The object of a table, the first of several."""
    part: Any = case
    for place in table.split("."):
        part = getattr(part, place)
        part = part[0] if isinstance(part, tuple) else part
    return part


def checking() -> bool:
    """Whether a value is only checked, compared, copied or named."""
    frame: Any = sys._getframe(2)
    while frame:
        name = frame.f_code.co_name
        if name in COMPUTED:
            return False
        if name in CHECKS:
            return True
        frame = frame.f_back
    return False


def forget() -> None:
    """Empty the caches of the package, so that all keys are read again."""
    for one in gc.get_objects():
        if hasattr(type(one), "cache_clear") and COMPUTING.match(one.__module__):
            one.cache_clear()


def trials(case: Case, column: str) -> None:
    """Some trials of a fidelity, or a budget."""
    if column == BUDGET:
        analytic(case, FIELDS)
    else:
        found = run(case, TRIALS, SEED, Serial(), fidelity=Fidelity(column))
        if not found["solved"].any():
            raise ValueError("no trial is solved")


def keys_read(names: list[str], column: str) -> set[str]:
    """The keys of one table that a fidelity reads."""
    table, found = names[0].rpartition(".")[0], set[str]()
    for design in together(names):
        forget()
        with reading(table) as (read, parts):
            case = case_of(design)
            parts.append(part_of(case, table))
            try:
                trials(case, column)
            except ValueError as error:
                print(f"{table}, {column}: {error}", flush=True)
        found |= read
    return found & set(names)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--write", action="store_true", help="write catalogs/designs/fidelities.json"
    )
    parser.add_argument("--table", help="table whose keys are tried, such as tracker.detection")
    parser.add_argument(
        "--refusals",
        action="store_true",
        help="find refusals only, without trials; keys that are left out are read from the file",
    )
    options = command.read(parser)
    figures = of_all_keys(options)
    for name, one in figures.items():
        print(f"{name}: {one}")
    command.save(options, figures)
    if options.write:
        kept: dict[str, Any] = {} if options.table is None else json.loads(FILE.read_text("utf-8"))
        kept = {name: one for name, one in kept.items() if name.rpartition(".")[0] != options.table}
        save_json(FILE, dict(sorted((kept | figures).items())))
    if options.quick:
        known = json.loads(FILE.read_text(encoding="utf-8"))
        for name in figures:
            assert figures[name] == known.get(name, TAKEN), f"{name}: {figures[name]}; --write"


def of_all_keys(options: argparse.Namespace) -> dict[str, dict[str, list[str]]]:
    """Fidelities that refuse a key, and fidelities that leave it out; keys used by all are
    omitted."""
    known: dict[str, Any] = json.loads(FILE.read_text("utf-8")) if FILE.is_file() else {}
    tables, figures = dict[str, list[str]](), dict[str, dict[str, list[str]]]()
    for name in keys():
        tables.setdefault(name.rpartition(".")[0], []).append(name)
    for table, names in tables.items():
        if options.table not in (None, table):
            continue
        names = names[:1] if options.quick else names
        without = {} if options.quick or options.refusals else left_out(names)
        for name in names:
            refusing = refused(name)
            left = without.get(name, known.get(name, TAKEN)["left_out"])
            left = [one for one in left if one not in refusing]
            figures[name] = {"refused": refusing, "left_out": left}
    return figures if options.quick else {k: one for k, one in figures.items() if one != TAKEN}


def left_out(names: list[str]) -> dict[str, list[str]]:
    """Fidelities that leave a key of a table out; the budget also if it reports that."""
    refusing = {name: refused(name) for name in names}
    found = {name: [BUDGET] if said_left_out(name) else [] for name in names}
    run = [name for name in names if value_of(name) not in (CODE, [CODE])]
    by_frame = keys_read(run, Fidelity.FRAME) if run else set()
    if unread := sorted(set(run) - by_frame):
        print(f"not read by frame: {', '.join(unread)}", flush=True)
    for column in CHEAPER:
        wanted = [one for one in run if one in by_frame and column not in refusing[one]]
        for one in set(wanted) - (keys_read(wanted, column) if wanted else set()):
            found[one] = sorted({*found[one], str(column)}, key=CHEAPER.index)
    return found


if __name__ == "__main__":
    command.run(main)
