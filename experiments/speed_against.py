"""CPU times of the stages of this tree and of another commit, in alternating runs; for `speed.py
--against`.

The other commit is checked out temporarily. A process of each tree waits for the name of a stage
and answers with the shortest CPU time of a piece of its work, so that both trees have the same load
of the machine.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

HERE = Path(__file__).parents[1]
HISTORY = Path(__file__).with_suffix("").with_name("speed_history.csv")
COLUMNS = ("commit", "date", "stage", "us", "against", "ratio")
ROUNDS = 4
LEAST = 0.3  # CPU second of a stage in a round; at least one call
SLOWER = 1.1  # least ratio of a marked stage
TRIALS = {"frame": 8, "window": 24, "spots": 80, "covariance": 400}

Work = tuple[Callable[[], Any], int]  # a call, and its number of pieces of work


def compare(commit: str, quick: bool) -> dict[str, Any]:
    """CPU times of all stages by tree, microsecond, and ratios of this tree to the other.

    quick  one stage of this tree compared with itself; its figures have no meaning
    """
    with ExitStack() as stack:
        other = HERE if quick else stack.enter_context(checked_out(commit))
        workers = {
            "here": stack.enter_context(worker(HERE)),
            commit: stack.enter_context(worker(other)),
        }
        stages = ["stamping"] if quick else list(work())
        least = {name: dict.fromkeys(workers, float("inf")) for name in stages}
        for number in range(1 if quick else ROUNDS):
            turn = list(workers) if number % 2 else list(workers)[::-1]
            for stage in stages:
                for tree in turn:
                    seconds = asked(workers[tree], stage)
                    least[stage][tree] = min(least[stage][tree], seconds)
    return {
        stage: {
            "us": 1e6 * times["here"],
            "us_against": 1e6 * times[commit],
            "ratio": times["here"] / times[commit],
        }
        for stage, times in least.items()
        if max(times.values()) < float("inf")  # stages of both trees
    }


def table(found: dict[str, Any], commit: str) -> str:
    """A line for each stage; slower stages are marked."""
    lines = [f"{'stage':16} {'us':>12} {commit[:12]:>12} {'ratio':>6}"]
    for stage, row in found.items():
        mark = " slower" if row["ratio"] > SLOWER else ""
        lines.append(
            f"{stage:16} {row['us']:12.4g} {row['us_against']:12.4g} {row['ratio']:6.3f}{mark}"
        )
    return "\n".join(lines)


def remember(found: dict[str, Any], commit: str) -> None:
    """Append the times of this tree to the table of CPU times by commit."""
    new = not HISTORY.exists()
    here = git("rev-parse", "--short=7", "HEAD")
    if git("status", "--porcelain", "--untracked-files=no"):
        here += "+"  # with uncommitted changes
    with HISTORY.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for stage, row in found.items():
            writer.writerow(
                (
                    here,
                    git("log", "-1", "--format=%cs"),
                    stage,
                    f"{row['us']:.4g}",
                    git("rev-parse", "--short=7", commit),
                    f"{row['ratio']:.3f}",
                )
            )


def git(*words: str) -> str:
    """Output of a git command in this tree."""
    done = subprocess.check_output(["git", "-C", str(HERE), *words], text=True)
    return done.strip()


def is_checkout() -> bool:
    """Whether this tree is a git checkout."""
    return (HERE / ".git").exists()


@contextmanager
def checked_out(commit: str) -> Iterator[Path]:
    """A temporary tree of another commit."""
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        git("worktree", "add", "--quiet", "--detach", str(tree), commit)
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))


@contextmanager
def worker(tree: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that measures stages of a tree."""
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__))],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=tree,
        env={**os.environ, **one_thread, "PYTHONPATH": str(tree)},
    )
    with process:
        yield process
        process.terminate()


def asked(process: subprocess.Popen[str], stage: str) -> float:
    """CPU time of a piece of a stage, second; infinite if the tree has no such stage."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(f"{stage}\n")
    process.stdin.flush()
    answer = json.loads(process.stdout.readline())
    return float("inf") if answer is None else float(answer)


def work() -> dict[str, Callable[[], Work]]:
    """Stage -> the function that prepares it. Imports are inside functions, because modules move
    between commits."""

    def bench(name: str) -> Work:
        from startrack.benchmark import STAGES

        stage = STAGES[name]()
        return next(iter(stage.ways.values())), stage.pieces

    def of_noise_alone() -> Path:
        from startrack import shipped

        try:
            return shipped("designs/noise_only.toml")
        except FileNotFoundError:  # in a commit where the nanosatellite was that camera
            return shipped("designs/nanosatellite.toml")

    def trials(fidelity: str) -> Work:
        from startrack import Fidelity, load_design, run_trials

        case, count = load_design(of_noise_alone()).case, TRIALS[fidelity]
        return lambda: run_trials(case, 5, range(count), Fidelity(fidelity)), count

    def budget() -> Work:
        from startrack import load_design
        from startrack.budget import analytic

        case = load_design(of_noise_alone()).case
        return lambda: analytic(case), 1

    def shadows() -> Work:
        from startrack.earth.terrain import index

        # In some commits the room's `__init__` does not name it.
        blocked = import_module("startrack.earth.terrain.trace").blocked
        try:
            site = import_module("startrack.benchmark.earth")
        except ImportError:  # in a commit where the stage had a separate file
            site = import_module("startrack.benchmark.terrain")
        surface, rays = index(*site.mountains(512)), site.rays_down()
        return lambda: blocked(surface, rays, 0.0), len(rays)

    stages = ("psf", "stamping", "noise", "detection", "centroid", "identification", "attitude")
    made: dict[str, Callable[[], Work]] = {}
    for name in (*stages, "terrain"):
        made[name] = partial(bench, name)
    made["shadows"] = shadows
    for name in TRIALS:
        made[f"trial {name}"] = partial(trials, name)
    return made | {"budget": budget}


def serve() -> None:
    """Answer each name of a stage on standard input with CPU seconds, or null."""
    prepared: dict[str, Work | None] = {}
    for line in sys.stdin:
        stage = line.strip()
        if stage not in prepared:
            try:
                call, pieces = work()[stage]()
                call()  # compiles and fills caches
                prepared[stage] = call, pieces
            except (ImportError, AttributeError, KeyError, TypeError) as error:
                print(f"{stage}: {error}", file=sys.stderr)
                prepared[stage] = None
        ready = prepared[stage]
        print(json.dumps(ready and measured(*ready)), flush=True)


def measured(call: Callable[[], Any], pieces: int) -> float:
    """The shortest CPU time of a piece over some calls."""
    least, end = float("inf"), time.process_time() + LEAST
    while True:
        began = time.process_time()
        call()
        now = time.process_time()
        least = min(least, now - began)
        if now > end:
            return least / pieces


if __name__ == "__main__":
    serve()
