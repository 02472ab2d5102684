"""An engineer's day: what exports leave out, how long a command is silent, what a newcomer finds.

    python experiments/day.py [--json FILE] [--quick]

export_gaps      what the unit of an AOCS model has and its files neither hold nor name, over all
                 shipped designs and trackers
silent_seconds   longest time in which a command writes nothing to its terminal, compiled before
resumed          fraction of the commands that go on where they were stopped
stars_visible    fraction of the shipped designs whose first picture shows its matched stars: on the
                 image as it is drawn, each is above the background by five times its spread
datasheet_keys   fraction of the words of datasheets for which `startrack keys` finds a key
wheel_same       1 if trials from the installed wheel are those of the checkout
pythons, lowest_versions   what .ci/versions says; not in the quick mode

A quick run takes one design and one command.
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import os
import pty
import select
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack import Refused, Streams, load_design, random_attitude, shipped
from startrack.mission import UnitChoice, head_model, write_model
from startrack.plots.frames import stretch
from startrack.trial import observe, searched

ROOT = Path(__file__).parents[1]
CLI = (sys.executable, "-m", "startrack.cli")
WORDS = (
    "field of view", "aperture", "focal length", "f-number", "frame rate", "update rate",
    "exposure", "integration time", "pixel pitch", "read noise", "full well", "dark current",
    "quantum efficiency", "PRNU", "accuracy", "NEA", "slew rate", "Sun exclusion", "mass", "power",
    "lifetime", "radiation", "star catalogue", "magnitude limit", "distortion", "temperature",
    "blur", "jitter", "latency", "bits",
)  # fmt: skip
COMMANDS = (
    ("simulate",), ("psf",), ("requirements",), ("budget", "--units", "6"), ("budget",),
    ("export", "aocs"), ("export", "catalogue"), ("montecarlo", "--trials", "200"),
    ("sequence", "--sequences", "2"), ("mission", "--set", "time.duration=1 d"),
    ("verify", "--trials", "200"), ("compare", "--trials", "100"),
)  # fmt: skip
RESUMING = (
    ("montecarlo", "--trials", "2000"), ("verify", "--trials", "2000"), ("optimize",), ("mission",),
)  # fmt: skip
BRIGHT = 5.0  # spreads of the background


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    options = command.read(parser)
    names = sorted(path.stem for path in shipped("designs").glob("*.toml"))
    designs = [shipped(f"designs/{name}.toml") for name in names if name != "scanner"]
    trackers = sorted(shipped("trackers").glob("*.toml"))
    if options.quick:
        designs, trackers = designs[-1:], []
    values: dict[str, Any] = {
        "export_gaps": sum(gaps(path, 2 if options.quick else 6) for path in designs + trackers),
        "stars_visible": float(np.mean([visible(path) for path in designs])),
        "datasheet_keys": float(
            np.mean([known(words) for words in WORDS[: 3 if options.quick else None]])
        ),
        "silent_seconds": {
            " ".join(words): silence(words) for words in COMMANDS[: 1 if options.quick else None]
        },
    }
    if not options.quick:
        values["resumed"] = float(np.mean([goes_on(words) for words in RESUMING]))
        values["wheel_same"] = int(passes("tests/test_release.py"))
        found = dict(line.split(": ", 1) for line in versions() if ": " in line)
        values["lowest_versions"] = int(found.pop("lowest", "") == "passed")
        values["pythons"] = found
    print(json.dumps(values, indent=1))
    command.save(options, values)


def gaps(path: Path, units: int) -> int:
    """Classes of error of a unit, and phrases that its budget leaves out, that the files lack."""
    case = load_design(path).case
    try:
        model = head_model(case, path.stem, UnitChoice("worst", units))
    except Refused as error:
        print(f"{path.stem}: no model, {error}")
        return 0  # refused is not left out
    with tempfile.TemporaryDirectory() as folder:
        write_model(Path(folder), model)
        written = json.loads((Path(folder) / "startrack_head.json").read_text())
        header = " ".join((Path(folder) / "startrack_head_data.h").read_text().split())
    lacking = [one for one in model.left_out if one not in written["left_out"]]
    lacking += [one for one in (model.unit, *model.left_out) if one[1:] not in header]
    for name, (across, about) in model.at_rest.items():
        kept = np.ravel([np.ravel(part)[:1] for part in written[name]])
        lacking += [name] * int(not np.allclose(kept, (across, about), rtol=1e-9))
    if case.varying and model.at_rest["swing"] == model.at_rest["bias"] == (0, 0):
        lacking.append("bias and swing")
    return len(lacking)


def visible(path: Path) -> bool:
    """Whether most matched stars of the first frame stand out of its picture."""
    case = load_design(path).case
    streams = Streams(1, 0)
    record = observe(case, random_attitude(streams), streams)
    shown = stretch(searched(case, record.frame).image)
    spots, seen = record.spots, []
    for k in record.matches.spot:
        x, y = (round(float(part)) // shown.block for part in (spots.x[k], spots.y[k]))
        part = shown.image[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        seen.append(float(part.max()) > shown.black + (BRIGHT - 1.5) * shown.noise)
    return bool(seen) and float(np.mean(seen)) > 0.8


def known(words: str) -> bool:
    run = subprocess.run([*CLI, "keys", *words.split(), "--json"], capture_output=True, text=True)
    return run.returncode == 0 and bool(run.stdout.strip())


def silence(words: tuple[str, ...]) -> float:
    """Longest time, second, in which a command writes nothing to its terminal."""
    near, far = pty.openpty()
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.Popen(
            [*CLI, *words],
            cwd=folder,
            stdout=far,
            stderr=far,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        os.close(far)
        last, longest = time.monotonic(), 0.0
        while run.poll() is None:
            if select.select([near], [], [], 0.1)[0]:
                try:
                    os.read(near, 65536)
                except OSError:  # the other side is closed
                    break
                longest, last = max(longest, time.monotonic() - last), time.monotonic()
        run.wait()
    os.close(near)
    return round(max(longest, time.monotonic() - last), 1)


def goes_on(words: tuple[str, ...]) -> bool:
    """Whether a command that was stopped takes up what it had: its second run does less."""
    with tempfile.TemporaryDirectory() as folder:
        call = [*CLI, *words, "--out", "out"]
        more = {
            "cwd": folder,
            "env": os.environ | {"PYTHONPATH": str(ROOT)},
            "stdout": subprocess.DEVNULL,
        }
        run = subprocess.Popen(call, stderr=subprocess.DEVNULL, **more)  # type: ignore[call-overload]
        store: list[Path] = []
        while run.poll() is None and not store:
            time.sleep(1.0)
            store = [
                path for path in Path(folder).rglob("*.sqlite") if path.stat().st_size > 20_000
            ]
        time.sleep(20.0)
        run.send_signal(signal.SIGTERM)
        run.wait()
        kept = {path: path.stat().st_size for path in Path(folder).rglob("*.sqlite")}
        again = subprocess.run(call, stderr=subprocess.PIPE, text=True, **more)  # type: ignore[call-overload]
        grown = all(path.exists() and path.stat().st_size >= size for path, size in kept.items())
        return again.returncode in (0, 3) and bool(kept) and grown


def passes(test: str) -> bool:
    run = [sys.executable, "-m", "pytest", "-q", "-m", "slow or not slow", test]
    return subprocess.run(run, cwd=ROOT, stdout=subprocess.DEVNULL).returncode == 0


def versions() -> list[str]:
    run = subprocess.run([ROOT / ".ci" / "versions"], cwd=ROOT, capture_output=True, text=True)
    return run.stdout.splitlines()


if __name__ == "__main__":
    command.run(main)
