"""Everyday use: omissions of exports, silent times of commands, and keys that are found.

    python experiments/day.py [--json FILE] [--quick]

export_gaps      number of effects of a unit that the files of its AOCS model neither contain nor
                 name, over all shipped designs and trackers
silent_seconds   longest time in which a command writes nothing to its terminal, with kernels
                 compiled before; silent_cpu_seconds is the CPU time of the longest such interval
resumed          fraction of the commands that continue where they were stopped
stars_visible    fraction of the shipped designs whose first picture shows its matched stars: in the
                 drawn image, each exceeds the background by five standard deviations
datasheet_keys   fraction of the words of datasheets for which `startrack keys` finds a key
wheel_same       1 if trials from the installed wheel are those of the checkout
pythons, lowest_versions   results of .ci/versions; not in the quick mode

A quick run takes one design and one command.
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import contextlib
import json
import os
import pty
import select
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import command
import numpy as np

from startrack import Refused, Streams, load_design, observe, random_attitude, shipped
from startrack.mission import UnitChoice, head_model, write_model
from startrack.plots import stretch
from startrack.trial import searched

ROOT = Path(__file__).parents[1]
CLI = (sys.executable, "-m", "startrack.cli")
WORDS = (
    "field of view",
    "aperture",
    "focal length",
    "f-number",
    "frame rate",
    "update rate",
    "exposure",
    "integration time",
    "pixel pitch",
    "read noise",
    "full well",
    "dark current",
    "quantum efficiency",
    "PRNU",
    "accuracy",
    "NEA",
    "slew rate",
    "Sun exclusion",
    "mass",
    "power",
    "lifetime",
    "radiation",
    "star catalogue",
    "magnitude limit",
    "distortion",
    "temperature",
    "blur",
    "jitter",
    "latency",
    "bits",
)
COMMANDS = (
    ("simulate",),
    ("psf",),
    ("requirements",),
    ("budget", "--units", "6"),
    ("budget",),
    ("export", "aocs"),
    ("export", "catalogue"),
    ("montecarlo", "--trials", "200"),
    ("sequence", "--sequences", "2"),
    ("mission", "--set", "time.duration=1 d"),
    ("verify", "--trials", "200"),
    ("compare", "nanosatellite", "noise_only", "--trials", "100"),
)
RESUMING = (
    ("montecarlo", "--trials", "2000"),
    ("verify", "--trials", "2000", "--first", "200"),
    ("optimize",),
    ("mission",),
)
BEGUN = 30_000  # byte of stores
GOING = 10.0  # second, for which a command goes on after it began its store
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
    }
    silent = {" ".join(words): silence(words) for words in COMMANDS[: 1 if options.quick else None]}
    values["silent_seconds"] = {name: wall for name, (wall, _) in silent.items()}
    values["silent_cpu_seconds"] = {name: cpu for name, (_, cpu) in silent.items()}
    if not options.quick:
        values["resumed"] = float(np.mean([goes_on(words) for words in RESUMING]))
        values["wheel_same"] = int(passes("tests/test_release.py"))
        found = dict(line.split(": ", 1) for line in versions() if ": " in line)
        values["lowest_versions"] = int(found.pop("lowest", "") == "passed")
        values["pythons"] = found
    print(json.dumps(values, indent=1))
    command.save(options, values)


def gaps(path: Path, units: int) -> int:
    """Classes of error of a unit, and phrases on omitted effects, that the exported files lack."""
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
    if case.varying and not np.any([model.at_rest["swing"], model.at_rest["bias"]]):
        lacking.append("bias and swing")
    return len(lacking)


def visible(path: Path) -> bool:
    """Whether most matched stars of the first frame are visible in its picture."""
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


def silence(words: tuple[str, ...]) -> tuple[float, float]:
    """Longest time in which a command writes nothing to its terminal, and its CPU time in it, s."""
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
        moments = [(time.monotonic(), 0.0)]
        while run.poll() is None:
            if select.select([near], [], [], 0.1)[0]:
                with contextlib.suppress(OSError):  # the other side is closed
                    os.read(near, 65536)
                moments.append((time.monotonic(), max(cpu_of(run.pid), moments[-1][1])))
            used = cpu_of(run.pid)
        moments.append((time.monotonic(), max(used, moments[-1][1])))
    os.close(near)
    assert run.returncode in (0, 3), words
    wall, cpu = np.diff(np.array(moments), axis=0).max(axis=0)
    return round(float(wall), 1), round(float(cpu), 1)


def cpu_of(pid: int) -> float:
    """Second of CPU that a process has used; 0 where it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def goes_on(words: tuple[str, ...]) -> bool:
    """Whether a stopped command continues: it computes no row of its stores again.

    Its rows are marked by where they stand in their file, which has to be the same file.
    """
    with tempfile.TemporaryDirectory() as folder:
        call = [*CLI, *words, "--out", "out"]
        more = {
            "cwd": folder,
            "env": os.environ | {"PYTHONPATH": str(ROOT)},
            "stdout": subprocess.DEVNULL,
            "stderr": subprocess.DEVNULL,
        }
        run = subprocess.Popen(call, **more)  # type: ignore[call-overload]
        # Nobody reads a store beside its writer; the log beside the file grows with each row.
        while run.poll() is None and size_of_stores(Path(folder)) < BEGUN:
            time.sleep(0.5)
        time.sleep(GOING)
        size = size_of_stores(Path(folder))  # on a busy machine of the design alone
        while run.poll() is None and size_of_stores(Path(folder)) == size:
            time.sleep(0.5)
        run.send_signal(signal.SIGTERM)
        stopped, kept = run.wait(), rows_of(Path(folder))
        if stopped != 143:
            print(f"{' '.join(words)}: it ended with {stopped} before it was stopped")
        again = subprocess.run(call, **more)  # type: ignore[call-overload]
        print(f"{' '.join(words)}: {len(kept)} rows when it was stopped")
        return again.returncode in (0, 3) and bool(kept) and kept <= rows_of(Path(folder))


def size_of_stores(folder: Path) -> int:
    size = 0
    for path in folder.rglob("*.sqlite*"):
        with contextlib.suppress(OSError):  # its log comes and goes
            size += path.stat().st_size
    return size


def rows_of(folder: Path) -> set[tuple[object, ...]]:
    """The rows of trials, forecasts and steps in all stores: file, table and values.

    A store that was begun anew is another file.
    """
    found = set[tuple[object, ...]]()
    for path in folder.rglob("*.sqlite"):
        with contextlib.closing(sqlite3.connect(path)) as base:
            tables = base.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
            for (table,) in tables:
                if table not in ("about", "sessions", "checksums"):
                    rows = base.execute(f'SELECT * FROM "{table}"')
                    found |= {(path.stat().st_ino, table, *row) for row in rows}
    return found


def passes(test: str) -> bool:
    run = [sys.executable, "-m", "pytest", "-q", "-m", "slow or not slow", test]
    return subprocess.run(run, cwd=ROOT, stdout=subprocess.DEVNULL).returncode == 0


def versions() -> list[str]:
    run = subprocess.run([ROOT / ".ci" / "versions"], cwd=ROOT, capture_output=True, text=True)
    return run.stdout.splitlines()


if __name__ == "__main__":
    command.run(main)
