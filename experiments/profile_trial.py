"""Which parts take the time of a trial, in each fidelity, and of a fresh process?

The shipped design, on random attitudes: CPU time of a trial without a profiler, and the fraction of
each file of startrack with a profiler. Calls of a file outside startrack (numpy, OpenCV, compiled
kernels) count for that file. The profiler overestimates the time of many small calls. Fresh
processes are timed from start to end, with compiled kernels.

    python experiments/profile_trial.py [--trials N] [--markdown FILE] [--json FILE] [--quick]

`--markdown` writes the page.
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import cProfile
import os
import pstats
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import command
import cv2

import startrack
from startrack import Case, Fidelity, load_design, run_trials, shipped
from startrack.benchmark import spent, versions
from startrack.io import save_text

HOME = Path(startrack.__file__).parent
DESIGN = "designs/noise_only.toml"
ROUNDS = 3
AT_ONCE = 50  # trials of drawn spots that are computed together
FILES = 5  # listed files of a fidelity
CALLS = 50  # largest depth of calls among functions outside startrack
LEAST = 0.01  # least fraction of a listed room

OUTCOME = f"""
from startrack import run_random_trial
from startrack.design import load_design
from startrack import shipped
run_random_trial(load_design(shipped("{DESIGN}")).case, 1, 0)
"""
STARTS = {
    "import startrack": ("-c", "import startrack"),
    "import startrack.trial": ("-c", "import startrack.trial"),
    "outcome of a first trial": ("-c", OUTCOME),
    "startrack simulate": ("-m", "startrack.cli", "simulate"),
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--trials", type=int, default=100, help="trials of each fidelity (default: 100)"
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="file for the page")
    options = command.read(parser, trials=1)
    quick = options.quick
    cv2.setNumThreads(1)
    case = load_design(shipped(DESIGN)).case
    profiles = {
        each: profile(case, each, options.trials, 1 if quick else ROUNDS) for each in Fidelity
    }
    starts = {
        name: start(call, 0 if quick else ROUNDS)
        for name, call in STARTS.items()
        if OUTCOME in call or not quick
    }
    text = markdown(profiles, starts, options.trials)
    if options.markdown:
        save_text(options.markdown, text)
    fidelities = {str(each): found._asdict() for each, found in profiles.items()}
    fresh = {name: each._asdict() for name, each in starts.items()}
    values = {"versions": versions(), "fidelities": fidelities, "fresh": fresh}
    command.save(options, values)
    print(text)


class Profile(NamedTuple):
    """Profile of one fidelity.

    seconds  CPU time of a trial, without the profiler
    fractions  1, fraction of each file, the largest first
    """

    seconds: float
    fractions: dict[str, float]


def profile(case: Case, fidelity: Fidelity, count: int, rounds: int) -> Profile:
    if fidelity is Fidelity.COVARIANCE:
        count *= AT_ONCE
    run(case, fidelity, count)  # computations done once for a design
    seconds = min(clocked(lambda: run(case, fidelity, count)) for _ in range(rounds)) / count
    profiler = cProfile.Profile(time.process_time)
    profiler.runcall(run, case, fidelity, count)
    return Profile(seconds, fractions(pstats.Stats(profiler).stats))  # type: ignore[attr-defined]


def run(case: Case, fidelity: Fidelity, count: int) -> Any:
    return run_trials(case, 1, range(count), fidelity)


def clocked(call: Callable[[], Any]) -> float:
    """CPU time, second."""
    began = time.process_time()
    call()
    return time.process_time() - began


Function = tuple[str, int, str]


def fractions(stats: Mapping[Function, tuple[Any, ...]]) -> dict[str, float]:
    """The fraction of each file: its functions and their calls outside startrack."""
    found = summed(spendings(stats))
    total = sum(found.values())
    return {name: own / total for name, own in found.items()}


def summed(parts: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Sums by name, the largest first."""
    found: defaultdict[str, float] = defaultdict(float)
    for name, part in parts:
        found[name] += part
    return dict(sorted(found.items(), key=lambda each: -each[1]))


def rooms(found: Profile) -> dict[str, float]:
    """Sums of the files' fractions by room."""
    return summed((Path(name).parts[0], fraction) for name, fraction in found.fractions.items())


def spendings(stats: Mapping[Function, tuple[Any, ...]]) -> Iterator[tuple[str, float]]:
    """Files and their CPU time in seconds.

    The time of a function outside startrack is assigned to its callers, in proportion to the time
    of their calls, and so on up to a file of startrack.
    """
    outside = {}
    for function, (_, _, own, _, _) in stats.items():
        if file := ours(function):
            yield file, own
        else:
            outside[function] = own
    for _ in range(CALLS):
        above: defaultdict[Function, float] = defaultdict(float)
        for function, seconds in outside.items():
            callers = {caller: within for caller, (_, _, _, within) in stats[function][4].items()}
            total = sum(callers.values())
            for caller, within in callers.items():
                part = seconds * within / total if total else 0.0
                if file := ours(caller):
                    yield file, part
                else:
                    above[caller] += part
        outside = dict(above)


def ours(function: Function) -> str:
    """The file of a function of startrack; empty for other functions."""
    path = Path(function[0])
    return str(path.relative_to(HOME)) if path.is_relative_to(HOME) else ""


class Start(NamedTuple):
    """A fresh process: CPU time and wall-clock time, shortest of some, second."""

    cpu: float
    wall: float


def start(call: tuple[str, ...], rounds: int) -> Start:
    """The shortest of some rounds; the first of several rounds does not count."""
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, *call]
        found = [once(words, folder) for _ in range(rounds + 1)][min(rounds, 1) :]
    return Start(min(each.cpu for each in found), min(each.wall for each in found))


def once(words: list[str], folder: str) -> Start:
    before, began = children(), time.perf_counter()
    subprocess.run(
        words,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(HOME.parent)},
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return Start(children() - before, time.perf_counter() - began)


def children() -> float:
    """CPU time of all ended processes, second."""
    times = os.times()
    return times.children_user + times.children_system


def markdown(profiles: Mapping[Fidelity, Profile], starts: Mapping[str, Start], count: int) -> str:
    lines = [
        "# Time of a trial by parts",
        f"{command.source(f'profile_trial.py --trials {count} --markdown FILE')}, {versions()}; "
        f"one thread, the smallest of {ROUNDS} rounds.",
        "",
        "## A trial",
        "The shipped design on 512 x 512 pixels, random attitudes, without computations done "
        "once for a design. Fractions by a profiler, which overestimates the time of many small "
        "calls.",
        "",
        row("part", profiles),
        "|---" * (len(profiles) + 1) + "|",
        row("**a trial**", (f"**{spent(found.seconds)}**" for found in profiles.values())),
    ]
    columns = [rooms(found) for found in profiles.values()]
    for name in summed(part for column in columns for part in column.items()):
        cells = [column.get(name, 0.0) for column in columns]
        if max(cells) >= LEAST:
            lines.append(row(name, (f"{100 * cell:.0f} %" for cell in cells)))
    lines += ["", "The files with the largest fractions:", ""]
    for fidelity, found in profiles.items():
        most = list(found.fractions.items())[:FILES]
        named = ", ".join(f"{name} {100 * fraction:.0f} %" for name, fraction in most)
        lines.append(f"- {fidelity}: {named}")
    lines += ["", "## A fresh process", "| until | CPU time | wall-clock time |", "|---|---|---|"]
    for name, each in starts.items():
        lines.append(f"| {name} | {each.cpu:.2f} s | {each.wall:.2f} s |")
    return "\n".join([*lines, ""])


def row(name: str, cells: Iterable[str]) -> str:
    """A row of a table."""
    return f"| {name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    command.run(main)
