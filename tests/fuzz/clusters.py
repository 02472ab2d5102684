"""Dask workers with missing or different code of a design -> whether a command reports it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import tomli_w

from tests.fuzz.arena import python_path
from tests.fuzz.grammar import bases

LONGEST = 300.0  # second
CODE = """import numpy as np


def centroid(given):
    flux = given.signal.sum(axis=(1, 2))
    return np.column_stack([0 * flux, 0 * flux, flux])
"""
# What a worker has of the module that the command may run; None: nothing.
OTHERS = {"none": None, "other": CODE + "# another\n", "damaged": "def ("}


def run_clusters(folder: Path, report: Callable[[str, str], object] = print) -> int:
    """Run a command on clusters whose worker has other code; how often it does not say so.

    report  called with the state of the worker and the output of a command that does not say so
    """
    table = {**bases()["design"], "tracker": {**bases()["design"]["tracker"]}}
    table["tracker"]["detection"] = table["tracker"]["detection"] | {"centroid": "mine:centroid"}
    found = 0
    for name, code in {"the same": CODE, **OTHERS}.items():
        here, there = folder / name / "here", folder / name / "there"
        for place, text in ((here, CODE), (there, code)):
            place.mkdir(parents=True)
            if text is not None:
                (place / "mine.py").write_text(text)
        (here / "design.toml").write_text(tomli_w.dumps(table))
        status, words = _end(here, there)
        refused = status in (1, 2) and words.count("\n") == 1 and "mine" in words
        fine = status in (0, 3) if code == CODE else refused
        if not fine or "Traceback" in words or ": unexpected " in words:
            found += 1
            report(name, f"status {status}: {words[-600:]!r}")
    return found


def _end(here: Path, there: Path) -> tuple[int | None, str]:
    """Status and messages of a command whose cluster has one worker with the files of a folder."""
    known = there / "scheduler.json"
    file = ("--scheduler-file", str(known), "--no-dashboard")
    local = (*file, "--nthreads", "1", "--local-directory", str(there))
    begun = [
        _begin(there, "distributed.cli.dask_scheduler", *file, "--port", "0"),
        _begin(there, "distributed.cli.dask_worker", *local),
    ]
    try:
        end = time.monotonic() + 60
        while not known.exists() and time.monotonic() < end:
            time.sleep(0.2)
        time.sleep(0.2)
        command = _begin(
            here,
            "startrack.cli",
            "montecarlo",
            "design.toml",
            "--allow-code",
            "--trials",
            "4",
            "--fidelity",
            "frame",
            "--workers",
            "1",
            "--out",
            "out",
            "--scheduler",
            json.loads(known.read_text())["address"],
        )
        begun.append(command)
        words = command.communicate(timeout=LONGEST)[1]
        lines = [line for line in words.splitlines(True) if "not part of startrack\n" not in line]
        return command.returncode, "".join(lines)
    except subprocess.TimeoutExpired:
        return None, f"still there after {LONGEST:g} s"
    finally:
        for process in reversed(begun):
            process.terminate()
            process.communicate()


def _begin(folder: Path, module: str, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", module, *words],
        cwd=folder,
        text=True,
        env=os.environ | {"PYTHONPATH": python_path(folder)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
