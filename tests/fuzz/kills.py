"""Commands that are ended at any instant and started again -> what was lost, and who stayed."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import tomli_w

from tests.fuzz.arena import python_path
from tests.fuzz.grammar import bases

LONGEST = 600.0  # second, of a command beside other programs
PATIENCE = 10.0  # second, in which all processes of a command must have ended
# Arguments, and the files that must have the same bytes in the end.
COMMANDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "montecarlo": (
        (
            "montecarlo",
            "design.toml",
            "--trials",
            "600",
            "--fidelity",
            "spots",
            "--workers",
            "2",
            "--out",
            "montecarlo",
        ),
        ("montecarlo/trials.csv",),
    ),
    "optimize": (
        ("optimize", "design.toml", "--workers", "2", "--out", "optimize"),
        ("optimize/best.toml", "optimize/evaluations.csv", "optimize/comparison.md"),
    ),
    "sample": (
        ("sample", "design.toml", "--workers", "1", "--out", "sample"),
        ("sample/samples.csv", "sample/tolerance.md"),
    ),
    "pareto": (
        ("pareto", "design.toml", "--points", "3", "--workers", "2", "--out", "pareto"),
        ("pareto/front.md", "pareto/result.json"),
    ),
    "report": (
        (
            "report",
            "done.sqlite",
            "--stars",
            "2",
            "--slews",
            "1",
            "--budget",
            "2",
            "--fidelity-trials",
            "2",
            "--worst",
            "1",
            "--out",
            "report.html",
        ),
        ("report.html",),
    ),
    "earth render": (("earth", "render", "survey.toml", "--out", "render"), ("render/*.fits",)),
    "mission": (
        ("mission", "mission.toml", "--out", "mission"),
        ("mission/summary.json", "mission/timeline.csv"),
    ),
    "sequence": (
        ("sequence", "design.toml", "--sequences", "2", "--workers", "2", "--out", "sequence"),
        ("sequence/frames.csv",),
    ),
}
ENDS = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}


# Of a page: the CPU times that it measures, the only thing in it that no seed decides.
MEASURED = re.compile(rb"(?<=Speed against error).*?(?=</table>)", re.DOTALL)
ATTEMPTS = 3  # for each kill; a signal that comes after the end of a command is none


def prepare(folder: Path) -> None:
    """Write what the commands read."""
    folder.mkdir(parents=True, exist_ok=True)
    design = dict(bases()["design"])
    design["campaign"] = design["campaign"] | {"trials": 20, "most_trials": 40, "evaluations": 8}
    design["campaign"]["variables"] = design["campaign"]["variables"][:2]
    (folder / "design.toml").write_text(tomli_w.dumps(design))
    survey = dict(bases()["survey"])
    survey |= {"lines": 64, "columns": 64}
    mission = bases()["mission"] | {"time": bases()["mission"]["time"] | {"duration": "60 d"}}
    (folder / "mission.toml").write_text(tomli_w.dumps(mission))
    (folder / "survey.toml").write_text(tomli_w.dumps(survey))
    begin(
        folder,
        (
            "montecarlo",
            "design.toml",
            "--trials",
            "16",
            "--fidelity",
            "spots",
            "--workers",
            "1",
            "--store",
            "done.sqlite",
        ),
    ).wait(LONGEST)


def begin(folder: Path, arguments: tuple[str, ...]) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": python_path()}
    return subprocess.Popen(
        [sys.executable, "-m", "startrack.cli", *arguments],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def contents(folder: Path, names: tuple[str, ...]) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): MEASURED.sub(b"", path.read_bytes())
        for name in names
        for path in sorted(folder.glob(name))
    }


def kill_commands(folder: Path, kills: int, seed: int, names: tuple[str, ...]) -> dict[str, int]:
    """End each of the commands so often, spread over its time; the signals take turns.

    Returns  kills: that met a running command; lost: ends with other bytes, or none; orphans:
             processes that outlived theirs; words: ends with another status or more than a line
    """
    counted: Counter[str] = Counter(kills=0, lost=0, orphans=0, words=0)
    rng = random.Random(seed)
    for turn, name in enumerate(names):
        arguments, wanted = COMMANDS[name]
        inputs, whole = folder / f"inputs-{turn}", folder / f"whole-{turn}"
        prepare(inputs)
        finish(shutil.copytree(inputs, folder / f"first-{turn}"), arguments)  # compiles
        shutil.copytree(inputs, whole)
        started = time.monotonic()
        finish(whole, arguments)
        lasted = time.monotonic() - started
        expected = contents(whole, wanted)
        assert expected, name
        missing = kills // len(names) + (turn < kills % len(names))
        for attempt in range(ATTEMPTS * missing):
            place = folder / f"killed-{turn}-{attempt}"
            shutil.copytree(inputs, place)
            for _ in range(min(missing, 4)):
                missing -= end_once(place, arguments, rng, lasted, counted)
            finish(place, arguments)
            found = contents(place, wanted)
            if found != expected:
                counted["lost"] += 1
                other = [file for file in expected | found if expected.get(file) != found.get(file)]
                print(f"{name}: other bytes after kills in {place}: {', '.join(sorted(other))}")
            if not missing:
                break
    return dict(counted)


def finish(folder: Path, arguments: tuple[str, ...]) -> None:
    begin(folder, arguments).communicate(timeout=2 * LONGEST)


def end_once(
    folder: Path, arguments: tuple[str, ...], rng: random.Random, lasted: float, counted: Counter
) -> bool:
    """Begin a command and end it; whether the signal met it before its own end."""
    process = begin(folder, arguments)
    kind, met = rng.choice(list(ENDS)), False
    try:
        process.communicate(timeout=rng.uniform(0.2, 1.0) * lasted)
    except subprocess.TimeoutExpired:
        process.send_signal(kind)
        try:
            _, words = process.communicate(timeout=PATIENCE + LONGEST)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            _, words = process.communicate()
            words += f"still there {PATIENCE + LONGEST:g} s after the signal"
        met = process.returncode not in (0, 3)
        told = [line for line in words.splitlines() if "stopped" in line]
        fine = process.returncode == ENDS[kind] and "Traceback" not in words
        if met and not (fine and len(told) == (kind is not signal.SIGKILL)):
            counted["words"] += 1
            print(f"{arguments[0]}: {kind.name}: {process.returncode}: {words[-300:]!r}")
    counted["kills"] += met
    counted["orphans"] += orphans(process.pid)
    return met


def orphans(leader: int) -> int:
    """Processes of a session that are still there after some time."""
    end = time.monotonic() + PATIENCE
    while members := session(leader):
        if time.monotonic() > end:
            for pid in members:
                os.kill(pid, signal.SIGKILL)
            return len(members)
        time.sleep(0.1)
    return 0


def session(leader: int) -> list[int]:
    found = []
    for path in Path("/proc").iterdir():
        if not path.name.isdecimal():
            continue
        try:
            fields = (path / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if fields[0] != "Z" and int(fields[3]) == leader:
            found.append(int(path.name))
    return found
