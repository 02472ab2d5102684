"""Random draws -> cases of files for exchange with other programs.

The same as `grammar` for user code of a design, sketches of trials, guide stars for flight, and SER
and raw images.
"""

from __future__ import annotations

import copy
import json
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tomli_w

from startrack.design import Fidelity, load_design
from startrack.io.recordings import PATTERNS, RAW_TYPES, SER_HEADER, SER_MAGIC
from startrack.montecarlo import Sampling, Serial, resume_sketch
from tests.fuzz import parts
from tests.fuzz.arena import Case
from tests.fuzz.grammar import FIELDS, NUMBERS, Draw, Kind, bases, damaged, mutated, plain

STRANGE = (
    "math:sqrt",
    "numpy:zeros",
    "builtins:print",
    "json:JSONDecoder",
    "time:sleep",
    "nosuch:thing",
    "nosuch.deep.er:thing",
    "math:nosuch",
    "math:pi",
    "math",
    ":x",
    "x:",
    ":",
    "a:b:c",
    "..:x",
    ".x:y",
    "tests.fuzz.parts:_like",
    "tests.fuzz:parts",
    "ü:é",
    "",
    " ",
    "a" * 5000 + ":b",
)
POINTS = (
    ("tracker.detection.centroid", False), ("tracker.detection.search", False),
    ("tracker.identification.method", False), ("tracker.attitude.method", False),
    ("instrument.optics.psf", False), ("instrument.motion.jitter", True),
    ("instrument.detector.charge_effects", True), ("instrument.detector.signal_effects", True),
    ("instrument.detector.image_effects", True), ("scene.lights", True),
    ("campaign.requirements.cost_model", False), ("campaign.requirements.checks", True),
)  # fmt: skip
CODE_COMMANDS = (
    ("requirements", "design.toml"),
    ("simulate", "design.toml", "--out", "out"),
    ("montecarlo", "design.toml", "--trials", "1", "--fidelity", "frame", "--workers", "1"),
    ("montecarlo", "design.toml", "--trials", "1", "--fidelity", "window", "--workers", "1"),
    ("montecarlo", "design.toml", "--trials", "2", "--fidelity", "spots", "--workers", "1"),
    ("budget", "design.toml", "--out", "out", "--workers", "1"),
)


def code_case(draw: Draw) -> Case:
    """A design that names code: without a permission, what is none, or what does wrong."""
    table = copy.deepcopy(bases()["design"])
    for _ in range(1 + draw.below(2)):
        place, several = draw.one_of(POINTS)
        name = draw.one_of(parts.NAMES if draw.below(3) else STRANGE)
        *path, last = place.split(".")
        held: Any = table
        for key in path:
            held = held.setdefault(key, {})
        held[last] = [name] * (1 + draw.below(2)) if several else name
    command = (*draw.one_of(CODE_COMMANDS), *(("--allow-code",) if draw.below(5) else ()))
    return Case("code", (*command, "--json"), {"design.toml": tomli_w.dumps(table).encode()})


@cache
def sketches() -> dict[str, bytes]:
    """Two parts of one campaign."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "design.toml"
        path.write_bytes(tomli_w.dumps(bases()["design"]).encode())
        case = load_design(path).case
        for name, numbers in (("a.json", range(8)), ("b.json", range(8, 16))):
            path = Path(folder) / name
            resume_sketch(path, case, 1, Sampling(Fidelity.COVARIANCE), numbers, Serial())
            found[name] = path.read_bytes()
    return found


def sketch_case(draw: Draw) -> Case:
    """Parts of a campaign, of which one is changed or damaged."""
    files = dict(sketches())
    if draw.below(3) == 0:
        files["a.json"] = damaged(draw, files["a.json"])
    else:
        table = json.loads(files["a.json"])
        part = draw.one_of((None, "counts", "sums", "bins", "about"))
        if part:
            table[part] = mutated(draw, table[part], None)
        else:
            table = mutated(draw, table, None)
        files["a.json"] = json.dumps(table).encode("utf-8", "replace")
    files["design.toml"] = tomli_w.dumps(bases()["design"]).encode()
    command = draw.one_of(
        (
            ("merge", "a.json", "b.json", "--out", "m.json"),
            ("merge", "b.json", "a.json", "b.json", "--out", "m.json"),
            (
                "montecarlo",
                "design.toml",
                "--sketch",
                "a.json",
                "--trials",
                "8",
                "--fidelity",
                "covariance",
                "--workers",
                "1",
            ),
        )
    )
    return Case("sketch", (*command, "--json"), files)


def guide_case(draw: Draw) -> Case:
    """Guide stars for flight, with options and a list of variables from anybody."""
    options = draw.one_of(
        (
            (),
            ("--limit", "nan"),
            ("--limit", "-2"),
            ("--limit", "20"),
            ("--epoch", "1e308"),
            ("--epoch", "-1"),
            ("--resolution", "1e9"),
            ("--resolution", "1e-9"),
            ("--per-field", "3"),
            ("--pattern-stars", "12"),
            ("--variables", "omit"),
            ("--doubles", "omit"),
        )
    )
    listed = b"ra,dec\n10.0,20.0\n83.8,-1.2\n"
    match draw.below(3):
        case 0:
            listed = damaged(draw, listed)
        case 1:
            cells = listed.split(b",")
            cells[draw.below(len(cells))] = draw.one_of(FIELDS)
            listed = b",".join(cells)
    design = mutated(draw, bases()["design"], None) if draw.below(2) else bases()["design"]
    try:
        data = tomli_w.dumps(design).encode("utf-8", "replace")
    except (TypeError, ValueError):
        data = b""
    command = ("export", "catalogue", "design.toml", "--out", "out", "--variable-list", "v.csv")
    return Case("guide", (*command, *options, "--json"), {"design.toml": data, "v.csv": listed})


@cache
def recording() -> tuple[list[Any], bytes]:
    """The fields of the header of a SER file, and its frames and times."""
    image = np.random.default_rng(2).normal(200, 4, (2, 48, 64))
    for x, y in ((10, 10), (40, 20), (20, 40), (55, 30)):
        image[:, y - 1 : y + 2, x - 1 : x + 2] += 900
    head = [SER_MAGIC, 0, 0, 0, 64, 48, 16, 2, b"", b"", b"", 0, 0]
    return head, image.astype("<u2").tobytes() + np.zeros(2, "<i8").tobytes()


@cache
def videos() -> dict[str, bytes]:
    """A video without loss, and one of colours."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, code, grey in (("a.mkv", "FFV1", True), ("a.avi", "MJPG", False)):
            path = Path(folder) / name
            form = [cv2.VIDEOWRITER_PROP_IS_COLOR, int(not grey)]
            video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 5.0, (64, 48), form)
            image = np.full((48, 64) if grey else (48, 64, 3), 9, np.uint8)
            image[20:22, 30:32] = 200
            video.write(image)
            video.release()
            found[name] = path.read_bytes()
    return found


def recording_case(draw: Draw) -> Case:
    """A SER, raw or video file, with another header, cut or damaged."""
    head, data = recording()
    head, name = list(head), "a.ser"
    options: tuple[str, ...] = ()
    kind = draw.below(4)
    if kind == 3:
        name = draw.one_of(videos())
        data = damaged(draw, videos()[name])
    elif kind == 0:
        name = "a.raw"
        size = draw.one_of(("64x48", "48x64", "1x1", "65536x65536", "0x3", "64x", "x", "-4x4"))
        options = ("--raw", f"{size}:{draw.one_of((*RAW_TYPES, 'int', ''))}")
    else:
        for _ in range(draw.below(3)):
            whole = [int(one) for one in NUMBERS if one == one and abs(one) < 2**31]
            head[1 + draw.below(7)] = draw.one_of((*whole, 8, 9, 100, 2**31 - 1))
        data = SER_HEADER.pack(*head) + data
    if draw.below(3) == 0:
        data = damaged(draw, data)
    if draw.below(3) == 0:
        options += ("--plane", str(draw.one_of((0, 1, 2, 2**31))))
    if draw.below(3) == 0:
        options += ("--bayer", draw.one_of((*PATTERNS, "none")))
    command = draw.one_of((("detect",), ("solve", "--fov", "12"), ("calibrate", "--fov", "12")))
    return Case("recording", (*command, name, *options, "--json"), {name: data})


def whole_exchanges() -> list[Case]:
    """A case of each command with valid files."""
    design = plain() | {"design.toml": tomli_w.dumps(bases()["design"]).encode()} | sketches()
    head, data = recording()
    merged = ("merge", "a.json", "b.json", "--out", "m.json", "--json")
    return [
        Case("whole", merged, design),
        Case("whole", ("detect", "a.ser", "--json"), {"a.ser": SER_HEADER.pack(*head) + data}),
    ]


EXCHANGES: tuple[Kind, ...] = (*(code_case,) * 3, sketch_case, guide_case, *(recording_case,) * 2)
