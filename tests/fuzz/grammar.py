"""Random draws -> cases: files of each kind, valid, mutated or damaged, and a command."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import gzip
import io
import os
import sqlite3
import struct
import subprocess
import sys
import tempfile
import tomllib
import typing
import zlib
from collections.abc import Callable
from enum import StrEnum
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import tomli_w

from startrack.catalog import Selection, open_sky
from startrack.core import Camera
from startrack.design import Campaign, Fidelity, load_design
from startrack.design import Case as Design
from startrack.earth.geometry import EarthScene
from startrack.io import shipped
from startrack.io.tables import fields_of
from startrack.mission import Mission
from startrack.montecarlo import Sampling, Serial, Store, resume
from startrack.motion import Motion
from startrack.sequence import Sequence
from tests.catalog import layouts
from tests.fuzz.arena import Case, python_path

# Each size of a number occurs, from what no float holds to what no machine holds.
NUMBERS = (
    0,
    1,
    -1,
    2,
    3,
    64,
    0.5,
    -0.5,
    1e-3,
    1e-9,
    1e-15,
    1e-30,
    1e-320,
    1e3,
    1e6,
    1e9,
    1e12,
    1e20,
    1e30,
    1e308,
    -1e308,
    65536,
    2**31,
    2**63,
    10**50,
    float("nan"),
    float("inf"),
    -float("inf"),
)
OTHERS: tuple[Any, ...] = (
    "",
    "x",
    "auto",
    "1",
    "1 m",
    "1e999999999 s",
    "1e-999999999 m",
    "5 parsnips",
    "\x00",
    "ü\U0001f600",
    " " * 200,
    "a" * 5000,
    "(a+)+$" * 30,
    "9" * 400 + " m",
    "1 m**(2**99)",
    "../../etc/passwd",
    "/dev/zero",
    "2026-13-45T99:99:99",
    "0001-01-01",
    "9999-12-31T23:59:60",
    True,
    False,
    [],
    {},
    [[]],
    [[[]]],
    [1, "x"],
    [None] * 0,
    {"a": 1},
    {"value": []},
    [{}],
    ["1 m"] * 3,
    [0.0] * 200,
)
SCALES = (1e-30, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 2, 10, 1e3, 1e6, 1e12, 1e30, -1, 0)
SMALL = (
    ("columns = 512", "columns = 96"),
    ("rows = 512", "rows = 96"),
    ('pixel_pitch = "11 um"', 'pixel_pitch = "58 um"'),
    ('blur = "5 um"', 'blur = "26 um"'),
    ('high = "15 um"', 'high = "60 um"'),
    ("limit_g = 7.0", "limit_g = 5.5"),
    ("\ntrials = 50\nmost_trials = 200", "\ntrials = 2\nmost_trials = 2\nsample_trials = 2"),
    ("evaluations = 120", "evaluations = 2\nanalytic_evaluations = 2"),
    ("fresh_trials = 1000", "fresh_trials = 2"),
)

# Leaves the ledger that is damaged, and reads it.
WHAT_MATTERS = ("what-matters", "design.toml", "--designs", "2", "--workers", "1", "--out", "out")


def changed(text: str, changes: tuple[tuple[str, str], ...]) -> dict[str, Any]:
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    return tomllib.loads(text)


@cache
def bases() -> dict[str, dict[str, Any]]:
    """Valid tables that run quickly."""
    scenes, designs = shipped("scenes"), shipped("designs")
    return {
        "design": changed((designs / "noise_only.toml").read_text(), SMALL),
        "scene": changed(
            (scenes / "mountains.toml").read_text(),
            (
                ("sky_rays = 16", "sky_rays = 0"),
                ("= 480", "= 12"),
                ('"20 um"', '"800 um"'),
                ("cells = 768", "cells = 200"),
            ),
        ),
        "survey": changed(
            (scenes / "hsrs.toml").read_text(),
            (
                ("lines = 300", "lines = 8"),
                ("columns = 300", "columns = 8"),
                ("cells = 1024", "cells = 200"),
            ),
        ),
        "mission": {
            "time": {"begin": "2026-03-20T12:00:00", "duration": "0.05 d", "step": "60 s"},
            "orbit": {"altitude": "600 km", "local_time": "10.5 h"},
            "attitude": {"law": "nadir", "yaw": "ground"},
            "heads": [
                {
                    "name": name,
                    "design": "design.toml",
                    "azimuth": azimuth,
                    "elevation": "-60 deg",
                    "exclusion": {"sun": "40 deg", "moon": "15 deg", "earth": "25 deg"},
                }
                for name, azimuth in (("left", "-90 deg"), ("right", "90 deg"))
            ],
            "requirements": {"max_blind": "60 s", "max_error": "30 arcsec"},
        },
        "goals": tomllib.loads((scenes / "goals.toml").read_text()),
        "sequence": {"period": "0.25 s", "legs": [{"duration": "0.5 s", "rate_x": "0.06 deg / s"}]},
    }


@cache
def varied() -> dict[str, Any]:
    """A design whose units differ."""
    table = copy.deepcopy({k: v for k, v in bases()["design"].items() if k != "campaign"})
    table["lifetime"] = "5 yr"
    table["instrument"]["residual"] = {"rms": 0.05, "drift": 0.002, "seed": 3}
    table["tracker"]["calibration"] = {"place": "ground", "positions": 40, "order": 3}
    table["variation"] = [
        {"name": "instrument.optics.focal_length", "sigma": 0.001, "vary": "relative"},
        {
            "name": "instrument.residual.temperature",
            "law": "sinusoid",
            "amplitude": "10 K",
            "per": "environment",
            "group": "orbit",
        },
        {
            "name": "instrument.mounting.x",
            "law": "uniform",
            "low": "-2 arcsec",
            "high": "2 arcsec",
            "per": "launch",
        },
        {
            "name": "instrument.detector.dark_current",
            "law": "lognormal",
            "sigma": 0.02,
            "vary": "relative",
            "per": "life",
        },
    ]
    table["campaign"] = {"requirements": {"max_across": "60 arcsec"}}
    return table


@cache
def aged() -> dict[str, Any]:
    """A design with an old detector, whose tracker searches boxes."""
    table = copy.deepcopy({k: v for k, v in bases()["design"].items() if k != "campaign"})
    detector, tracker = table["instrument"]["detector"], table["tracker"]
    detector["thermal"] = {"temperature": "268 K", "reference": "268 K"}
    detector["age"] = {"time": "5 yr", "fluence": "2e9 cm-2 / yr", "flicker": {"step": 0.117}}
    tracker["acquisition"] = "box"
    tracker["box"] = {"half_width": "600 arcsec", "size": 6, "prior": "20 arcsec", "stars": 4}
    tracker["detection"]["dark_map_age"] = "30 d"
    tracker["detection"]["dark_map"] = {"frames": 8}
    return table


KINDS: dict[str, type] = {"design": Design, "scene": EarthScene, "sequence": Sequence}


class Draw:
    """What the grammar draws."""

    def __init__(self, source: Random):
        self._source = source

    def one_of(self, choices: Any) -> Any:
        choices = tuple(choices)
        return copy.deepcopy(choices[self.below(len(choices))])  # which mutations change

    def below(self, count: int) -> int:
        return self._source.randrange(max(count, 1))

    def bytes(self, most: int) -> bytes:
        return self._source.randbytes(1 + self.below(most))


def value_of(draw: Draw, kind: Any, unit: Any, depth: int = 0) -> Any:
    """A value for a field: of its type three times in four, and of any size."""
    if draw.below(4) == 0:
        return draw.one_of(NUMBERS + OTHERS)
    if dataclasses.is_dataclass(kind):
        return table_of(draw, typing.cast(type, kind), depth + 1) if depth < 4 else {}
    if typing.get_origin(kind) is tuple:
        inner = typing.get_args(kind)[0]
        return [value_of(draw, inner, unit, depth + 1) for _ in range(draw.below(4))]
    if unit and kind is float:
        return f"{draw.one_of(NUMBERS)} {unit.shown}"
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return draw.one_of(kind).value
    if kind is bool:
        return bool(draw.below(2))
    return draw.one_of((*OTHERS[:2], "x", "y", "airy", "sun") if kind is str else NUMBERS)


def table_of(draw: Draw, kind: type, depth: int = 0) -> dict[str, Any]:
    """A table of a class: its required keys, and some of the others."""
    fields = fields_of(kind)
    return {
        name: value_of(draw, each.kind, each.unit, depth)
        for name, each in fields.items()
        if each.required or draw.below(3) == 0
    }


def places(table: Any, path: tuple = ()) -> list[tuple]:
    """The paths of all values in a table."""
    items = table.items() if isinstance(table, dict) else enumerate(table)
    found = []
    for key, value in items:
        found.append((*path, key))
        if isinstance(value, dict | list):
            found += places(value, (*path, key))
    return found


def mutated(draw: Draw, table: dict[str, Any], kind: type | None) -> dict[str, Any]:
    """The table with one to three changes: a refused one hides the others."""
    table = copy.deepcopy(table)
    for _ in range(1 + draw.below(3)):
        path = draw.one_of(places(table) or [()])
        if not path:
            break
        holder: Any = table
        for key in path[:-1]:
            holder = holder[key]
        held = holder[path[-1]]
        match draw.below(6):
            case 0:
                del holder[path[-1]]
            case 1:
                holder[path[-1]] = draw.one_of(NUMBERS + OTHERS)
            case 2 | 3:
                holder[path[-1]] = scaled(draw, held)
            case _:
                added(draw, table, kind)
    return table


def scaled(draw: Draw, held: Any) -> Any:
    """Another number in place of one; a quantity keeps its unit."""
    if isinstance(held, bool) or not isinstance(held, int | float | str):
        return draw.one_of(NUMBERS + OTHERS)
    if isinstance(held, str):
        number, _, unit = held.partition(" ")
        try:
            return f"{float(number) * draw.one_of(SCALES):.9g} {unit}"
        except ValueError:
            return draw.one_of(OTHERS)
    factor = draw.one_of(SCALES)
    return round(held * factor) if isinstance(held, int) and draw.below(2) else held * factor


def added(draw: Draw, table: dict[str, Any], kind: type | None) -> None:
    """Add a key somewhere that its class knows."""
    if kind is None:
        table[draw.one_of(("x", "campaign", "camera", "terrain"))] = draw.one_of(NUMBERS + OTHERS)
        return
    holder: Any = table
    while True:
        fields = fields_of(kind)
        name = draw.one_of(fields)
        each = fields[name]
        inner = holder.get(name) if isinstance(holder, dict) else None
        if dataclasses.is_dataclass(each.kind) and isinstance(inner, dict) and draw.below(4):
            holder, kind = inner, typing.cast(type, each.kind)
            continue
        if isinstance(holder, dict):
            holder[name] = value_of(draw, each.kind, each.unit)
        return


def toml(draw: Draw, table: dict[str, Any]) -> bytes:
    """The text of a table; sometimes damaged."""
    try:
        data = tomli_w.dumps(_writable(table)).encode("utf-8", "surrogateescape")
    except (TypeError, ValueError):
        data = repr(table).encode("utf-8", "replace")
    return damaged(draw, data) if draw.below(12) == 0 else data


def _writable(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _writable(one) for key, one in value.items()}
    return [_writable(one) for one in value] if isinstance(value, list | tuple) else value


HOSTILE_TOML = (
    b"",
    b"\0" * 100,
    b"\xff\xfe",
    b"a = " + b"[" * 9000 + b"]" * 9000,
    b"a" + b".a" * 60_000 + b"=1",
    b"a = " + b"9" * 5000,
    b"#" * 2**21,
    b"a = {" * 2000,
    b"[[a]]\n" * 2000,
    b'"' * 999,
    b"a='" + b"'" * 999,
)


def damaged(draw: Draw, data: bytes) -> bytes:
    """Bytes cut, changed, repeated or put in."""
    if not data:
        return draw.bytes(64)
    at = draw.below(len(data))
    match draw.below(5):
        case 0:
            return data[:at]
        case 1:
            return data[:at] + draw.bytes(8) + data[at + 8 :]
        case 2:
            return data[:at] + draw.bytes(40) + data[at:]
        case 3:
            return data[:at] + bytes([data[at] ^ (1 << draw.below(8))]) + data[at + 1 :]
    return data[at:] + data[:at]


def text_case(draw: Draw) -> Case:
    """A text that is no table, or hardly one."""
    data = draw.one_of(HOSTILE_TOML)
    return Case("text", ("requirements", "design.toml", "--json"), {"design.toml": data})


DESIGN_COMMANDS = (
    ("requirements", "design.toml"),
    ("montecarlo", "design.toml", "--trials", "2", "--fidelity", "covariance", "--workers", "1"),
    ("montecarlo", "design.toml", "--trials", "2", "--fidelity", "spots", "--workers", "1"),
    ("simulate", "design.toml", "--out", "out"),
    ("montecarlo", "design.toml", "--trials", "1", "--fidelity", "window", "--workers", "1"),
    ("psf", "design.toml", "--out", "out"),
    ("budget", "design.toml", "--out", "out", "--workers", "1"),
    (
        "verify",
        "design.toml",
        "--trials",
        "2",
        "--first",
        "2",
        "--fidelity",
        "covariance",
        "--workers",
        "1",
    ),
    (
        "compare",
        "design.toml",
        "plain.toml",
        "--trials",
        "2",
        "--fidelity",
        "covariance",
        "--workers",
        "1",
    ),
)


def design_case(draw: Draw) -> Case:
    text = draw.one_of(HOSTILE_TOML) if draw.below(25) == 0 else None
    table = mutated(draw, {k: v for k, v in bases()["design"].items() if k != "campaign"}, Design)
    table.setdefault("campaign", {"requirements": {}})
    data = toml(draw, table) if text is None else text
    return Case(
        "design", (*draw.one_of(DESIGN_COMMANDS), "--json"), plain() | {"design.toml": data}
    )


def plain() -> dict[str, bytes]:
    """A valid design."""
    return {"plain.toml": tomli_w.dumps(bases()["design"]).encode()}


UNIT_COMMANDS = (
    (
        "montecarlo",
        "design.toml",
        "--units",
        "2",
        "--trials",
        "2",
        "--fidelity",
        "covariance",
        "--workers",
        "1",
    ),
    (
        "montecarlo",
        "design.toml",
        "--units",
        "2",
        "--trials",
        "1",
        "--fidelity",
        "window",
        "--workers",
        "1",
    ),
    ("montecarlo", "design.toml", "--trials", "2", "--fidelity", "spots", "--workers", "1"),
    ("budget", "design.toml", "--units", "2", "--workers", "1"),
)


def unit_case(draw: Draw) -> Case:
    """A design whose units differ."""
    data = toml(draw, mutated(draw, varied(), Design))
    return Case("units", (*draw.one_of(UNIT_COMMANDS), "--json"), {"design.toml": data})


AGED_COMMANDS = (
    ("simulate", "design.toml", "--out", "out"),
    ("montecarlo", "design.toml", "--trials", "1", "--fidelity", "window", "--workers", "1"),
    ("montecarlo", "design.toml", "--trials", "1", "--fidelity", "frame", "--workers", "1"),
    ("export", "aocs", "design.toml", "--out", "out"),
    ("export", "catalogue", "design.toml", "--out", "out"),
)


def aged_case(draw: Draw) -> Case:
    """A design with an old detector, whose tracker searches boxes."""
    table = mutated(draw, aged(), Design)
    table.setdefault("campaign", {"requirements": {}})
    command = draw.one_of(AGED_COMMANDS)
    return Case("aged", (*command, "--json"), {"design.toml": toml(draw, table)})


MISSION_COMMANDS = (
    ("mission", "m.toml", "--out", "out"),
    ("mission", "m.toml", "--out", "out", "--frame", "600"),
    ("mission", "m.toml", "--out", "out", "--place"),
)


def mission_case(draw: Draw) -> Case:
    data = toml(draw, mutated(draw, bases()["mission"], Mission))
    design = tomli_w.dumps(bases()["design"]).encode()
    command = draw.one_of((MISSION_COMMANDS[0], *MISSION_COMMANDS))
    return Case("mission", (*command, "--json"), {"m.toml": data, "design.toml": design})


@cache
def star_table() -> bytes:
    """Stars of a camera, by angles, pixels and temperature."""
    rng = np.random.default_rng(5)
    angle = rng.uniform(-4000, 4000, (60, 2))
    warm = rng.normal(20, 3, 60)
    pixel = angle / [-5, 5] * (1 + 1e-5 * (warm[:, None] - 20)) + rng.normal(0, 0.02, (60, 2))
    rows = np.column_stack([angle, pixel, warm])
    head = "y_angle_arcsec,z_angle_arcsec,row_px,column_px,camera_temperature_c\n"
    return (head + "".join(",".join(f"{v:.5f}" for v in row) + "\n" for row in rows)).encode()


TABLE_COMMANDS = (
    ("calibrate", "stars.csv"),
    ("calibrate", "stars.csv", "--distortion", "2"),
    ("calibrate", "stars.csv", "--distortion", "full", "--temperature-terms", "linear"),
)


def star_table_case(draw: Draw) -> Case:
    """A table of stars with cells, columns or bytes changed."""
    lines = star_table().decode().splitlines()
    for _ in range(1 + draw.below(4)):
        row = draw.below(len(lines)) if draw.below(3) else 0
        cells = lines[row].split(",")
        match draw.below(4):
            case 0:
                cells = cells[: draw.below(len(cells) + 1)]
            case 1:
                cells.append(cells[draw.below(len(cells))] if cells else "x")
            case 2 if cells:
                cells[draw.below(len(cells))] = str(draw.one_of(NUMBERS + OTHERS))[:300]
            case _:
                lines = lines[: 1 + draw.below(len(lines))]
                continue
        lines[row] = ",".join(cells)
    data = ("\n".join(lines) + "\n").encode("utf-8", "replace")
    data = damaged(draw, data) if draw.below(6) == 0 else data
    return Case("table", (*draw.one_of(TABLE_COMMANDS), "--json"), {"stars.csv": data})


def zemax_page() -> str:
    """A Huygens PSF as Zemax saves it."""
    x, y = np.meshgrid(np.arange(-16, 16), np.arange(-16, 16))
    image = np.exp(-(x**2 + y**2) / 18.0)
    head = (
        "Listing of Huygens PSF Data\n\nFile : lens.zmx\n0.5876 \u00b5m at 0.0000, 0.0000 (deg).\n"
        "Data spacing is 0.500 \u00b5m.\nData area is 16.000 by 16.000 \u00b5m.\n"
        "Strehl ratio: 0.8\nPupil grid size: 64 by 64\nImage grid size: 32 by 32\n"
        "Center point is: 17, 17\n\nValues are relative to diffraction limit.\n\n"
    )
    return head + "\n".join("\t".join(f"{v:.6E}" for v in row) for row in image) + "\n"


def page_case(draw: Draw) -> Case:
    """Text of a lens program with bytes or lines changed."""
    lines = zemax_page().splitlines()
    for _ in range(draw.below(4)):
        at = draw.below(16) if draw.below(2) else draw.below(len(lines))
        if draw.below(2):
            del lines[at % len(lines)]
        else:
            lines[at % len(lines)] = str(draw.one_of(NUMBERS + OTHERS))[:300]
    text = "\n".join(lines)
    data = text.encode(draw.one_of(("utf-16", "utf-8", "latin-1")), "replace")
    data = damaged(draw, data) if draw.below(4) == 0 else data
    return Case(
        "page", ("lens", "import", "page.txt", "--out", "psf.fits", "--json"), {"page.txt": data}
    )


def campaign_case(draw: Draw) -> Case:
    base = bases()["design"]
    table = base | {"campaign": mutated(draw, base["campaign"], Campaign)}
    command = draw.one_of(("requirements", "requirements", "requirements", "what-matters"))
    more = ("--designs", "2", "--workers", "1", "--out", "out") if command == "what-matters" else ()
    return Case(
        "campaign", (command, "design.toml", *more, "--json"), {"design.toml": toml(draw, table)}
    )


def scene_case(draw: Draw) -> Case:
    if draw.below(3) == 0:
        data = toml(draw, mutated(draw, bases()["survey"], None))
        command = draw.one_of(
            (("earth", "render", "s.toml", "--out", "out"), ("requirements", "s.toml"))
        )
        return Case("scene", (*command, "--json"), {"s.toml": data})
    if draw.below(10) == 0:
        data = toml(draw, mutated(draw, bases()["goals"], None))
        return Case("scene", ("requirements", "s.toml", "--json"), {"s.toml": data})
    table = mutated(draw, bases()["scene"], EarthScene)
    if draw.below(4) == 0:
        table["motion"] = table_of(draw, Motion)
    data = toml(draw, table)
    return Case(
        "scene", ("earth", "geometry", "s.toml", "--out", "out", "--json"), {"s.toml": data}
    )


def sequence_case(draw: Draw) -> Case:
    data = toml(draw, mutated(draw, bases()["sequence"], Sequence))
    files = {"p.toml": data, "design.toml": tomli_w.dumps(bases()["design"]).encode()}
    arguments = (
        "sequence",
        "design.toml",
        "--profile",
        "p.toml",
        "--sequences",
        "1",
        "--workers",
        "1",
        "--out",
        "out",
        "--json",
    )
    return Case("sequence", arguments, files)


@cache
def pictures() -> dict[str, bytes]:
    """Whole images of some stars."""
    from astropy.io import fits

    image = np.random.default_rng(1).normal(100, 3, (48, 64))
    for x, y in ((10, 10), (40, 20), (20, 40), (55, 30)):
        image[y - 1 : y + 2, x - 1 : x + 2] += 500
    deep = image.astype(np.uint16)
    found = {
        f"a.{suffix}": cv2.imencode(f".{suffix}", picture)[1].tobytes()
        for suffix, picture in (("png", deep), ("tiff", deep), ("jpg", image.astype(np.uint8)))
    }
    for name, part in (
        ("a.fits", fits.ImageHDU(image)),
        ("b.fits", fits.ImageHDU(deep)),
        ("rice.fits", fits.CompImageHDU(deep.astype(np.int16))),
    ):
        file = io.BytesIO()
        fits.HDUList([fits.PrimaryHDU(), part]).writeto(file)
        found[name] = file.getvalue()
    found["a.fits.gz"] = gzip.compress(found["a.fits"], mtime=0)
    return found


def camera_case(draw: Draw) -> Case:
    """A calibrated camera that is not one."""
    camera = {
        "columns": 64, "rows": 48, "focal_length_px": 300.0, "principal_x": 32.0,
        "principal_y": 24.0, "k1": -0.1,
    }  # fmt: skip
    data = toml(draw, {"tracker": {"camera": mutated(draw, camera, Camera)}})
    return Case(
        "camera",
        ("solve", "a.png", "--camera", "camera.toml", "--json"),
        {"a.png": pictures()["a.png"], "camera.toml": data},
    )


def lens_case(draw: Draw) -> Case:
    """A lens table with other numbers and right checksums, or with damage."""
    from astropy.io import fits

    data = shipped("lenses/double_gauss.fits").read_bytes()
    if draw.below(4) == 0:
        data = damaged(draw, data)
    else:
        with fits.open(io.BytesIO(data)) as parts:
            for _ in range(1 + draw.below(3)):
                part = parts[draw.below(len(parts))]
                if part.data is None or draw.below(6) == 0:
                    number = draw.one_of(NUMBERS)
                    if abs(number) < 2**63:
                        part.header[draw.one_of(("FOCAL", "FNUMBER", "LENS", "NAME"))] = number
                elif draw.below(4) == 0 and len(parts) > 2:
                    parts.remove(part)
                else:
                    _change_values(draw, part)
            file = io.BytesIO()
            parts.writeto(file, checksum=True, output_verify="ignore")
        data = file.getvalue()
    table = copy.deepcopy({k: v for k, v in bases()["design"].items() if k != "campaign"})
    table["instrument"]["optics"] |= {"lens_file": "lens.fits", "psf": "auto", "blur": "5 um"}
    table["instrument"]["detector"] |= {"pixel_pitch": "11 um"}
    command = draw.one_of(
        (
            ("lens", "show", "lens.fits"),
            ("simulate", "design.toml", "--out", "out"),
            (
                "montecarlo",
                "design.toml",
                "--trials",
                "1",
                "--fidelity",
                "window",
                "--workers",
                "1",
            ),
            ("requirements", "design.toml"),
        )
    )
    files = {"lens.fits": data, "design.toml": tomli_w.dumps(table).encode()}
    return Case("lens", (*command, "--json"), files)


def _change_values(draw: Draw, part: Any) -> None:
    """Other values, another order, or another shape of an array."""
    match draw.below(4):
        case 0:
            part.data = part.data[..., ::-1].copy()
        case 1 if part.data.shape[-1] > 1:
            part.data = part.data[..., : draw.below(part.data.shape[-1])].copy()
        case 2:
            part.data = part.data * draw.one_of(SCALES)
        case _:
            number = float(draw.one_of(NUMBERS))
            place = draw.below(part.data.size)
            part.data = part.data.astype(float)
            part.data.flat[place] = number


CARDS = (
    b"NAXIS",
    b"NAXIS1",
    b"NAXIS2",
    b"BITPIX",
    b"BZERO",
    b"BSCALE",
    b"ZNAXIS1",
    b"ZTILE1",
    b"PCOUNT",
)
CARD_VALUES = (b"0", b"-1", b"1", b"99999999", b"1e308", b"'x'", b"T", b"", b"nan", b"7", b"2.5")
BOMB = gzip.compress(b"SIMPLE  = T".ljust(2880) + b"\0" * 2**23, mtime=0)


def image_case(draw: Draw) -> Case:
    name = draw.one_of(pictures())
    data = pictures()[name]
    match draw.below(5):
        case 0 | 1 if name.endswith(".fits"):
            card = draw.one_of(CARDS).ljust(8) + b"="
            at = data.rfind(card)
            if at >= 0:
                new = (card + b" " + draw.one_of(CARD_VALUES).rjust(20)).ljust(80)
                data = (
                    data[:at] + (new if draw.below(4) else b"COMMENT".ljust(80)) + data[at + 80 :]
                )
        case 0 if name == "a.png":
            size = struct.pack(
                ">II", draw.one_of((0, 1, 2**16, 2**31 - 1)), draw.one_of((0, 1, 2**16))
            )
            head = b"IHDR" + size + data[24:29]
            data = data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]
        case 1:
            data = draw.one_of((b"", b"\0" * 3000, BOMB, b"II*\0" + b"\xff" * 99, b"SIMPLE" * 700))
        case _:
            for _ in range(1 + draw.below(3)):
                data = damaged(draw, data)
    command = draw.one_of(
        (
            ("detect",),
            ("detect", "--overlay", "out"),
            ("solve", "--fov", "12"),
            ("calibrate", "--fov", "12"),
        )
    )
    # A name that is no UTF-8 cannot be an argument of a line of JSON: surrogates stand for it.
    name = draw.one_of((name, name, "$\\frac" + name, "\udcff" + name))
    return Case("image", (*command, name, "--json"), {name: data})


@cache
def star_files() -> dict[str, bytes]:
    """Whole catalogues of few stars."""
    from astropy.table import Table

    files = {
        name: text.encode()
        for name, text in (
            ("hip.dat", layouts.HIP_MAIN),
            ("tyc2.dat", layouts.TYCHO2),
            ("bsc.dat", layouts.BSC),
            ("hyg.csv", layouts.HYG),
            ("gaia.csv", layouts.GAIA),
        )
    }
    files["gaia.csv.gz"] = gzip.compress(files["gaia.csv"], mtime=0)
    table = Table(
        {"source_id": [1, 2], "ra": [1.0, 2.0], "dec": [3.0, 4.0], "phot_g_mean_mag": [5.0, 6.0]}
    )
    for name, form in (("gaia.fits", "fits"), ("gaia.vot", "votable")):
        file = io.BytesIO()
        table.write(file, format=form)
        files[name] = file.getvalue()
    record = struct.pack("<qddfff", 1, 10.0, 20.0, 5.0, 5.5, 4.5)
    files["gaia.bin"] = b"GDR3" + struct.pack("<IQ", 1, 1) + record
    return files


FIELDS = (
    b"",
    b"nan",
    b"-1e308",
    b"1e308",
    b"x",
    b'"',
    b"999",
    b",",
    b"|",
    b"null",
    b"1e-320",
    b"\n",
)


def catalog_case(draw: Draw) -> Case:
    name = draw.one_of(star_files())
    data = star_files()[name]
    match draw.below(5):
        case 0:
            data = damaged(draw, data)
        case 1 | 2:
            between = b"|" if b"|" in data else b","
            parts = data.split(between)
            for _ in range(1 + draw.below(3)):
                parts[draw.below(len(parts))] = draw.one_of(FIELDS)
            data = between.join(parts)
        case 3:
            lines = data.splitlines(keepends=True)
            lines.insert(draw.below(len(lines)), draw.one_of(lines))
            if draw.below(2):  # a column twice
                lines = [
                    lines[0].rstrip(b"\n") + b",ra\n",
                    *(x.rstrip(b"\n") + b",1\n" for x in lines[1:]),
                ]
            data = b"".join(lines)
        case _:
            data = draw.one_of(
                (
                    b"",
                    b"\0" * 99,
                    b"\n" * 99,
                    b"source_id\n",
                    b"<VOTABLE>",
                    gzip.compress(bytes(2**22)),
                    data[:-1],
                )
            )
    if draw.below(3):
        files = {name: data, "a.png": pictures()["a.png"]}
        return Case(
            "catalogue", ("solve", "a.png", "--fov", "12", "--catalog", name, "--json"), files
        )
    table = copy.deepcopy(bases()["design"])
    table["catalog"] = {"source": name, "epoch": draw.one_of((2026.0, 1991.25))}
    files = {name: data, "design.toml": tomli_w.dumps(table).encode()}
    return Case("catalogue", (*draw.one_of(DESIGN_COMMANDS[:2]), "--json"), files)


@cache
def stores() -> dict[str, bytes]:
    """Whole stores of few trials of two fidelities, and a ledger."""
    import tempfile

    found = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "design.toml"
        path.write_bytes(tomli_w.dumps(bases()["design"]).encode())
        case = load_design(path).case
        for fidelity in (Fidelity.SPOTS, Fidelity.COVARIANCE):
            path = Path(folder) / f"{fidelity}.sqlite"
            with Store(path, case, 1, Sampling(fidelity)) as store:
                resume(store, Serial(), 1, 16, block=4)
            found[path.name] = path.read_bytes()
        environment = os.environ | {"PYTHONPATH": python_path()}
        subprocess.run(
            [sys.executable, "-m", "tests.fuzz.worker", "run", *WHAT_MATTERS],
            cwd=folder,
            env=environment,
            capture_output=True,
        )
        found["ledger.sqlite"] = (Path(folder) / "out" / "ledger.sqlite").read_bytes()
    return found


STATEMENTS = (
    "DELETE FROM about WHERE name = 'seed'",
    "DELETE FROM about WHERE name = 'case'",
    "DELETE FROM about WHERE name = 'fields'",
    "DELETE FROM about WHERE name = 'fidelity'",
    "DELETE FROM about WHERE name = 'startrack'",
    "DELETE FROM about",
    "UPDATE about SET value = '' WHERE name = 'seed'",
    "UPDATE about SET value = '-1' WHERE name = 'seed'",
    "UPDATE about SET value = 'x' WHERE name = 'fidelity'",
    "UPDATE about SET value = '{' WHERE name = 'case'",
    "UPDATE about SET value = '[[' || hex(zeroblob(50000)) WHERE name = 'case'",
    "UPDATE about SET value = replace(hex(zeroblob(50000)), '0', '[') WHERE name = 'case'",
    "UPDATE about SET value = '[]' WHERE name = 'fields'",
    "UPDATE about SET value = '[[\"trial\", \"<i8\"]]' WHERE name = 'fields'",
    "UPDATE about SET value = '[[\"trial\", \"O\"]]' WHERE name = 'fields'",
    "UPDATE about SET value = 7",
    "UPDATE blocks SET outcomes = 'text'",
    "UPDATE blocks SET outcomes = zeroblob(8)",
    "UPDATE blocks SET outcomes = zeroblob(length(outcomes))",
    "UPDATE blocks SET outcomes = substr(outcomes, 9) || zeroblob(8)",
    "UPDATE blocks SET outcomes = replace(outcomes, x'00', x'ff')",
    "UPDATE blocks SET trials = -1",
    "UPDATE blocks SET trials = 9223372036854775807",
    "UPDATE blocks SET trials = 'x'",
    "UPDATE blocks SET first = first - 5",
    "UPDATE blocks SET first = first + 2 WHERE first = 12",
    "DELETE FROM blocks",
    "INSERT INTO failures VALUES (99, 1, 1, '')",
    "INSERT INTO failures VALUES (99, 'x', 'y', zeroblob(9))",
    "INSERT INTO sessions VALUES ('x', '{')",
    "DROP TABLE blocks",
    "DROP TABLE about",
    "DROP TABLE failures",
    "PRAGMA user_version = 99",
    "PRAGMA application_id = 1",
    "UPDATE about SET value = '7' WHERE name = 'seed'",
    "UPDATE about SET value = replace(value, ' mm', ' cm') WHERE name = 'case'",
    "UPDATE rows SET data = zeroblob(length(data))",
    "UPDATE rows SET number = number + 1",
    "UPDATE rows SET data = substr(data, 1, length(data) - 82)",
    "DELETE FROM rows WHERE number = 0",
    "DROP TABLE rows",
)


def store_case(draw: Draw) -> Case:
    files = dict(stores())
    name = draw.one_of(files)
    files[name] = changed_store(draw, files[name])
    plain_design = {"design.toml": tomli_w.dumps(bases()["design"]).encode()}
    files |= plain_design
    if name == "ledger.sqlite":
        files = {"out/ledger.sqlite": files[name], "design.toml": files["design.toml"]}
        whole = files | {"out/ledger.sqlite": stores()["ledger.sqlite"]}
        return Case("store", (*WHAT_MATTERS, "--json"), files, whole)
    fidelity = Path(name).stem
    arguments = draw.one_of(
        (
            ("combine", "spots.sqlite", "covariance.sqlite"),
            (
                "montecarlo",
                "design.toml",
                "--trials",
                "16",
                "--fidelity",
                fidelity,
                "--workers",
                "1",
                "--store",
                name,
            ),
        )
    )
    return Case("store", (*arguments, "--json"), files, stores() | plain_design)


def changed_store(draw: Draw, data: bytes) -> bytes:
    match draw.below(4):
        case 0:
            return damaged(draw, data)
        case 1:
            # Within the pages of the file, where SQLite looks for no damage.
            at = 4096 + draw.below(max(len(data) - 4096, 1))
            return data[:at] + draw.bytes(16) + data[at + 16 :]
    base = sqlite3.connect(":memory:", isolation_level=None)
    try:
        base.deserialize(data[:18] + b"\1\1" + data[20:])  # no write-ahead log in memory
        for _ in range(1 + draw.below(2)):
            try:
                base.execute(draw.one_of(STATEMENTS))
            except sqlite3.Error:
                continue
        return base.serialize()
    finally:
        base.close()


@cache
def bright_stars() -> bytes:
    """The stars to G = 5.5 in Gaia's columns: trials have attitudes, which other files change."""
    stars = open_sky(Selection.whole("bright", 2026.0)).stars
    stars = stars[stars.magnitude_g < 5.5]
    x, y, z = stars.direction.T
    ra, dec = np.degrees(np.arctan2(y, x)) % 360, np.degrees(np.arcsin(z))
    rows = enumerate(zip(ra, dec, stars.magnitude_g, strict=True), 1)
    lines = [f"{n},{a:.6f},{d:.6f},{g:.3f}" for n, (a, d, g) in rows]
    return "\n".join(["source_id,ra,dec,phot_g_mean_mag", *lines, ""]).encode()


@cache
def begun() -> dict[str, bytes]:
    """Inputs of a design, and a store and a sketch of its trials."""
    from startrack.montecarlo import resume_sketch

    table = copy.deepcopy(bases()["design"])
    table["catalog"] = {"source": "stars.csv", "epoch": 2026.0}
    table["tracker"]["catalog"] = {"source": "guide.csv", "epoch": 2026.0}
    # Slow enough for all lenses, with images that are computed in a second.
    optics = {"psf": "auto", "lens_file": "lens.fits", "f_number": 4.0, "psf_tolerance": 0.05}
    table["instrument"]["optics"] |= optics
    found = {
        "design.toml": tomli_w.dumps(table).encode(),
        **dict.fromkeys(("stars.csv", "guide.csv"), bright_stars()),
        "lens.fits": shipped("lenses/double_gauss.fits").read_bytes(),
    }
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, content in found.items():
            Path(name).write_bytes(content)
        case, sampling = load_design("design.toml").case, Sampling(Fidelity.COVARIANCE)
        with Store(Path("a.sqlite"), case, 1, sampling) as store:
            resume(store, Serial(), 1, 4)
        resume_sketch(Path("a.json"), case, 1, sampling, range(4), Serial())
        for name in ("a.sqlite", "a.json"):
            found[name] = Path(name).read_bytes()
    return found


def replaced_case(draw: Draw) -> Case:
    """Trials that go on where a file of the design has another content, under the same name."""
    files = dict(begun())
    name = draw.one_of(("stars.csv", "guide.csv", "lens.fits", "nothing"))
    if name == "lens.fits":
        other = draw.one_of(("triplet", "petzval", "catadioptric"))
        files[name] = shipped(f"lenses/{other}.fits").read_bytes()
    elif name != "nothing":
        head, *lines = files[name].splitlines(keepends=True)
        files[name] = b"".join([head, *lines[draw.below(3) :: 2 + draw.below(3)]])
    kept = draw.one_of((("--store", "a.sqlite"), ("--sketch", "a.json")))
    command = ("montecarlo", "design.toml", "--trials", "8", "--fidelity", "covariance")
    return Case("replaced", (*command, "--workers", "1", *kept, "--json"), files, begun())


def prescription_case(draw: Draw) -> Case:
    """A prescription of Zemax, damaged or with other numbers."""
    data = shipped(f"lenses/{draw.one_of(('triplet', 'double_gauss'))}.zmx").read_bytes()
    if draw.below(2):
        data = damaged(draw, data)
    else:
        words = data.split(b" ")
        for _ in range(1 + draw.below(3)):
            words[draw.below(len(words))] = str(draw.one_of(NUMBERS)).encode()
        data = b" ".join(words)
    command = ("lens", "import", "a.zmx", "--out", "lens.fits", "--json")
    return Case("prescription", command, {"a.zmx": data})


SPECIAL = (
    Case("special", ("simulate", "fifo", "--json"), {"fifo": None}),
    Case("special", ("requirements", "/dev/zero", "--json")),
    Case("special", ("detect", "fifo.png", "--json"), {"fifo.png": None}),
    Case("special", ("detect", "/dev/zero", "--json")),
    Case("special", ("solve", "fifo.fits", "--fov", "9", "--json"), {"fifo.fits": None}),
    Case("special", ("combine", "fifo", "/dev/zero", "--json"), {"fifo": None}),
    Case("special", ("earth", "geometry", "fifo", "--json"), {"fifo": None}),
    Case("special", ("earth", "render", "fifo", "--json"), {"fifo": None}),
    Case("special", ("earth", "terrain", "fifo", "--json"), {"fifo": None}),
    Case("special", ("sequence", "--profile", "fifo", "--json"), {"fifo": None}),
    Case("special", ("report", "fifo", "--json"), {"fifo": None}),
)


def special_case(draw: Draw) -> Case:
    return draw.one_of(SPECIAL)


def whole_cases() -> list[Case]:
    """A case of each command with valid files."""
    design = plain() | {"design.toml": tomli_w.dumps(bases()["design"]).encode()}
    image = {"a.png": pictures()["a.png"]}
    survey, scene = (
        {"s.toml": tomli_w.dumps(bases()[name]).encode()} for name in ("survey", "scene")
    )
    profile = design | {"p.toml": tomli_w.dumps(bases()["sequence"]).encode()}
    mission = design | {"m.toml": tomli_w.dumps(bases()["mission"]).encode()}
    return [
        *(Case("whole", (*command, "--json"), design) for command in DESIGN_COMMANDS),
        Case(
            "whole",
            ("what-matters", "design.toml", "--designs", "2", "--workers", "1", "--json"),
            design,
        ),
        Case(
            "whole",
            (
                "sequence",
                "design.toml",
                "--profile",
                "p.toml",
                "--sequences",
                "1",
                "--workers",
                "1",
                "--json",
            ),
            profile,
        ),
        *(
            Case("whole", (*command, "--json"), {"design.toml": tomli_w.dumps(varied()).encode()})
            for command in UNIT_COMMANDS
        ),
        *(
            Case("whole", (*command, "--json"), {"design.toml": tomli_w.dumps(aged()).encode()})
            for command in AGED_COMMANDS
        ),
        *(Case("whole", (*command, "--json"), mission) for command in MISSION_COMMANDS),
        *(
            Case("whole", (*command, "--json"), {"stars.csv": star_table()})
            for command in TABLE_COMMANDS
        ),
        Case(
            "whole",
            ("lens", "import", "page.txt", "--out", "psf.fits", "--json"),
            {"page.txt": zemax_page().encode()},
        ),
        Case("whole", ("earth", "geometry", "s.toml", "--json"), scene),
        Case("whole", ("earth", "render", "s.toml", "--json"), survey),
        Case("whole", ("detect", "a.png", "--overlay", "out", "--json"), image),
        Case("whole", ("solve", "a.png", "--fov", "12", "--json"), image),
        Case("whole", ("calibrate", "a.png", "--fov", "12", "--json"), image),
    ]


Kind = Callable[[Draw], Case]
WEIGHTS: tuple[Kind, ...] = (
    *(design_case,) * 6,
    campaign_case,
    text_case,
    *(scene_case,) * 4,
    sequence_case,
    *(image_case,) * 4,
    *(catalog_case,) * 4,
    *(store_case,) * 3,
    camera_case,
    *(lens_case,) * 2,
    *(unit_case,) * 2,
    *(aged_case,) * 2,
    mission_case,
    star_table_case,
    page_case,
    *(replaced_case,) * 2,
    prescription_case,
)


def any_case(draw: Draw, kinds: tuple[Kind, ...] = WEIGHTS) -> Case:
    """A case of any of these kinds."""
    if draw.below(100) == 0:
        return special_case(draw)
    return draw.one_of(kinds)(draw)
