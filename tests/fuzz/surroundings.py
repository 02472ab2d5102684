"""Random draws -> cases of what surrounds a computation: extreme sizes, odd outputs, SPICE kernels.

As in `grammar`.
"""

from __future__ import annotations

import copy
import os
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import tomli_w

from tests.fuzz.arena import Case, is_unprivileged
from tests.fuzz.exchange import sketches
from tests.fuzz.grammar import (
    DESIGN_COMMANDS,
    Draw,
    Kind,
    bases,
    damaged,
    pictures,
    plain,
    star_table,
    zemax_page,
)

# Changes of a small design, each at the end of what a tracker may be or beyond it.
EXTREMES: tuple[tuple[tuple[str, object], ...], ...] = (
    (("instrument.detector.columns", 20_000), ("instrument.detector.rows", 20_000)),
    (("instrument.detector.columns", 20_000), ("instrument.detector.rows", 16)),
    (("instrument.detector.columns", 1), ("instrument.detector.rows", 1)),
    (("catalog.limit_g", 2.0),),
    (("catalog.limit_g", -1.5),),
    (("catalog.limit_g", 9.5),),
    (("instrument.optics.focal_length", "1.6 mm"), ("instrument.optics.blur", "20 um")),
    (("instrument.optics.focal_length", "1 mm"), ("instrument.optics.f_number", 0.5)),
    (("instrument.optics.focal_length", "30 m"), ("instrument.optics.f_number", 300.0)),
    (("instrument.optics.f_number", 0.5),),
    (("instrument.optics.f_number", 200.0),),
    (("instrument.optics.blur", "1 nm"),),
    (("instrument.optics.blur", "1 mm"),),
    (("instrument.detector.pixel_pitch", "0.5 um"),),
    (("instrument.detector.exposure", "1 us"),),
    (("instrument.detector.exposure", "1000 s"),),
    (("instrument.detector.dark_current", "1e7 electron / s"),),
    (("instrument.detector.read_noise", "0 electron"), ("instrument.detector.prnu", 0.0)),
    (("instrument.detector.read_noise", "5000 electron"),),
    (("instrument.detector.full_well", "100 electron"),),
    (("instrument.detector.bits", 1),),
    (("instrument.motion.rate_x", "100 deg / s"),),
    (("instrument.motion.rate_z", "3600 deg / s"),),
    (("tracker.detection.threshold", 0.01),),
    (("tracker.detection.threshold", 1e6),),
    (("tracker.detection.saturation", 1.0),),
    (("catalog.epoch", 1700.0),),
    (("catalog.epoch", 2400.0),),
)
POLES = (
    ("simulate", "design.toml", "--ra", "0", "--dec", "90", "--out", "out"),
    ("simulate", "design.toml", "--ra", "360", "--dec", "-90", "--roll", "720", "--out", "out"),
    ("export", "catalogue", "design.toml", "--out", "out"),
    ("export", "aocs", "design.toml", "--units", "2", "--out", "out"),
)


def extreme_case(draw: Draw) -> Case:
    """A design at the end of what a tracker may be: pixels, stars, fields, light; at the poles."""
    table = copy.deepcopy(bases()["design"])
    for _ in range(1 + draw.below(2)):
        for name, value in draw.one_of(EXTREMES):
            *path, last = name.split(".")
            held = table
            for key in path:
                held = held.setdefault(key, {})
            held[last] = value
    files = plain() | {"design.toml": tomli_w.dumps(table).encode()}
    return Case("extreme", (*draw.one_of((*DESIGN_COMMANDS, *POLES)), "--json"), files)


ODD = (
    "",
    ".",
    "..",
    "/",
    " ",
    "fifo",
    "link",
    "dangling",
    "loop",
    "folder",
    "file",
    "file/x",
    "loop/x",
    "fifo/x",
    "dangling/x",
    "readonly/x",
    "readonly",
    "a" * 300,
    "a/" * 1200 + "b",
    "new\nline",
    "\udcff",
    "$\\frac",
    "x.toml",
    "x.fits",
    "-",
    "%s%n",
    "folder/../x",
    "/proc/self/mem",
    "/proc/kmsg",
    "/dev/fd/77",
    "/dev/stdout",
    "/nosuch/x",
)
DEVICES = ("/dev/null", "/dev/full", "/dev/zero", "/dev/tty")  # which root would replace
OUTPUTS = (
    ("montecarlo", "design.toml", "--trials", "2", "--fidelity", "covariance", "--workers", "1"),
    ("merge", "a.json", "b.json"),
    ("lens", "import", "page.txt"),
    ("calibrate", "stars.csv"),
    ("detect", "a.png"),
    ("solve", "a.png", "--fov", "12"),
    ("simulate", "design.toml"),
    ("psf", "design.toml"),
    ("mission", "m.toml"),
    ("export", "aocs", "design.toml", "--units", "2"),
    ("export", "catalogue", "design.toml"),
    ("earth", "render", "s.toml"),
    ("earth", "geometry", "s.toml"),
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
    ("sequence", "design.toml", "--profile", "p.toml", "--sequences", "1", "--workers", "1"),
)
OPTIONS = {
    "montecarlo": ("--out", "--store", "--sketch", "--log", "--table"),
    "detect": ("--overlay",),
    "solve": ("--overlay", "--tables"),
    "calibrate": ("--out", "--camera"),
}


def output_case(draw: Draw) -> Case:
    """An output on a path where nothing, something else or no file can be."""
    command = draw.one_of(OUTPUTS)
    option = draw.one_of(OPTIONS.get(command[0], ("--out",)))
    path = draw.one_of((*ODD, *DEVICES) if is_unprivileged() or os.geteuid() else ODD)
    is_file = command[0] in ("merge", "lens", "calibrate") or option in OPTIONS["montecarlo"][1:]
    if is_file and path == "fifo":
        path = "fifo/x"  # nobody reads here what waits for a reader, as it should
    if draw.below(8) == 0:
        command, last = ("init",), (path if path != "fifo" else "fifo/x",)
    else:
        last = (f"{option}={path}",)
    files = plain() | sketches()
    files |= {
        "design.toml": tomli_w.dumps(bases()["design"]).encode(),
        "m.toml": tomli_w.dumps(bases()["mission"]).encode(),
        "p.toml": tomli_w.dumps(bases()["sequence"]).encode(),
        "s.toml": tomli_w.dumps(bases()["survey" if "render" in command else "scene"]).encode(),
        "a.png": pictures()["a.png"],
        "stars.csv": star_table(),
        "page.txt": zemax_page().encode(),
        "file": b"mine",
        "target": b"mine",
        "folder/mine": b"mine",
        "readonly/": b"",
        "fifo": None,
    }
    links = {"link": "target", "dangling": "nosuch", "loop": "loop"}
    more = () if path == "/dev/stdout" else ("--json",)  # where the result stands beside it
    return Case("output", (*command, *last, *more), files, links=links)


@cache
def kernels() -> dict[str, bytes]:
    """An orbit and an attitude as SPICE kernels, with the clock of the attitude."""
    from astropy.time import Time, TimeDelta

    from startrack.core import installed_tables
    from startrack.mission.files import write_ck, write_spk

    minutes = np.arange(0.0, 90.0, 5.0)
    with installed_tables():
        date = Time("2026-03-20T12:00:00", scale="utc") + TimeDelta(60 * minutes, format="sec")
    angle = 2 * np.pi * minutes / 96.5
    zero = np.zeros_like(angle)
    place = 6.978e6 * np.column_stack([np.cos(angle), np.sin(angle), zero])
    speed = 7558.0 * np.column_stack([-np.sin(angle), np.cos(angle), zero])
    turned = np.column_stack([zero, zero, np.sin(angle / 2), np.cos(angle / 2)])
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        write_spk(Path(folder) / "o.bsp", date, place, speed)
        write_ck(Path(folder) / "a.bc", date, turned)
        for name in ("o.bsp", "a.bc", "a.tsc"):
            found[name] = (Path(folder) / name).read_bytes()
    return found


def kernel_case(draw: Draw) -> Case:
    """A mission along SPICE kernels, of which one is damaged, foreign, empty or a FIFO."""
    files: dict[str, bytes | None] = dict(kernels())
    name = draw.one_of(files)
    match draw.below(8):
        case 0:
            files[name] = None
        case 1:
            files[name] = draw.one_of((b"", b"DAF/SPK ", b"KPL/MK\n\\begindata\n", b"\0" * 4096))
        case 2:
            files[name] = kernels()[draw.one_of(kernels())]
        case 3 if name == "a.tsc":
            text = kernels()[name].split(b" ")
            text[draw.below(len(text))] = draw.one_of((b"0", b"-1", b"1e308", b"x", b"("))
            files[name] = b" ".join(text)
        case _:
            # Within a record: three in four lie in the descriptors of the file and its segments.
            data = bytearray(kernels()[name])
            for _ in range(1 + draw.below(4)):
                at = draw.below(min(len(data), 4096) if draw.below(4) else len(data))
                data[at : at + 8] = draw.one_of((b"\0" * 8, b"\xff" * 8, draw.bytes(8)))
            files[name] = damaged(draw, bytes(data)) if draw.below(4) == 0 else bytes(data)
    table = copy.deepcopy(bases()["mission"])
    table["time"]["duration"] = "0.02 d"
    table["orbit"] = {"oem": "o.bsp"}
    if name != "o.bsp" or draw.below(2):
        table["attitude"] = {"law": "aem", "aem": "a.bc"}
    files |= {
        "m.toml": tomli_w.dumps(table).encode(),
        "design.toml": tomli_w.dumps(bases()["design"]).encode(),
    }
    return Case("kernel", ("mission", "m.toml", "--out", "out", "--json"), files)


def whole_surroundings() -> list[Case]:
    """A case of each command that is in no other list, with valid files."""
    design = plain() | {"design.toml": tomli_w.dumps(bases()["design"]).encode()}
    return [Case("whole", (*command, "--json"), design) for command in POLES]


# Kernels are written by spiceypy.
SURROUNDINGS: tuple[Kind, ...] = (
    *(extreme_case,) * 3,
    *(output_case,) * 3,
    *((kernel_case,) if find_spec("spiceypy") else ()),
)
