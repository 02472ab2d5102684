"""How large is the package, and does it use private names of other packages?

python experiments/house.py [--json FILE] [--quick] [--numba VERSION ...]

Counts lines and files of the package, measures of readability (`house_reader.py`), public names,
and private names of other packages (with an underscore, or from numba's internal modules) outside
startrack/core/compiler.py, which may use them. Then it times the first and a later `startrack
simulate`, compares trials on plain numba, counts the places that an addition needs by the tests
that make it, and compares times of the stages with commit 975808b; --quick leaves these parts out.
Results are compared with recorded results (`same_bytes.py`; --quick compares a few). With --numba a
few tests run on other versions of numba, which pip installs in addition.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import command
import house_reader
import same_bytes
import speed_against

import startrack

HOME = Path(startrack.__file__).parent
OPTIONAL = HOME / "core" / "compiler.py"  # may use private names of numba
REFERENCE = "975808b"  # commit for the comparison of kernels
PLACES = {"one": 1, "two": 2, "three": 3}
TESTS = ("tests/core/test_kernel.py", "tests/test_places_to_add.py")  # tests for a version of numba
TRIALS = """
import hashlib, sys
if len(sys.argv) > 1:
    sys.modules["startrack.core.compiler"] = None  # as where numba has other names
from startrack import Fidelity, load_design, run_trials, shipped
case = load_design(shipped("designs/noise_only.toml")).case
for fidelity in Fidelity:
    print(hashlib.sha256(run_trials(case, 1, range(2), fidelity).tobytes()).hexdigest())
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--numba",
        nargs="+",
        default=[],
        metavar="VERSION",
        help="other versions of numba to test with",
    )
    options = command.read(parser)
    files = [path for path in HOME.rglob("*.py*") if path.suffix in (".py", ".pyi")]
    private = [name for path in files if path != OPTIONAL for name in private_names(path)]
    figures: dict[str, Any] = {
        "lines": sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files),
        "files": len(files),
        "public_names": public_names(),
        "private_names": len(private),
        "private": sorted(private),
        **house_reader.measures(),
        **same_bytes.compare(options.quick),
    }
    if not options.quick:
        with tempfile.TemporaryDirectory() as folder:
            figures["simulate_cold_s"] = seconds_of(Path(folder), "simulate")
            # The first run compiles in a process that continues after the run's end.
            seconds_of(Path(folder), "warm", "--part", "identification", "--part", "fidelity frame")
            figures["simulate_warm_s"] = seconds_of(Path(folder), "simulate")
            figures["plain_numba_same"] = int(plain_numba_same(Path(folder)))
        figures["places_to_add"] = places_to_add()
        if speed_against.is_checkout():
            stages = speed_against.compare(REFERENCE, False)
            figures["kernel_ratio"] = {name: row["ratio"] for name, row in stages.items()}
    if options.numba:
        figures["numba_versions"] = {version: passed_on(version) for version in options.numba}
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


def public_names() -> int:
    """Names of the package, and names in `__all__` of the packages of its stub."""
    stub = (HOME / "__init__.pyi").read_text(encoding="utf-8")
    rooms = re.findall(r"^from \. import (\w+)", stub, re.M)
    listed, waiting = 0, [startrack.__name__, *(f"startrack.{room}" for room in rooms)]
    while waiting:
        module = import_module(waiting.pop())
        for name in module.__all__:
            inner = f"{module.__name__}.{name}"
            if (HOME / inner.removeprefix("startrack.").replace(".", "/")).is_dir():
                waiting.append(inner)
            else:
                listed += 1
    return listed


def private_names(path: Path) -> list[str]:
    """Private names of other packages that a file imports."""
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    foreign = [name for name in names if name.split(".")[0] not in ("startrack", "__future__")]
    return [
        f"{path.relative_to(HOME)}: {name}"
        for name in foreign
        if name.startswith("numba.core.") or any(part.startswith("_") for part in name.split("."))
    ]


def seconds_of(folder: Path, *words: str) -> float:
    """Seconds of a command; compiled kernels are kept in a folder."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "kernels")}
    environment["PYTHONPATH"] = str(HOME.parent)
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "startrack.cli", *words],
        env=environment,
        cwd=folder,
        check=True,
        capture_output=True,
    )
    return time.perf_counter() - began


def plain_numba_same(folder: Path) -> bool:
    """Whether trials of all fidelities are equal, to the bit, without private names of numba."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "kernels")}
    outcomes = [
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", TRIALS, *words],
            env=environment,
            check=True,
            capture_output=True,
        ).stdout
        for words in ([], ["plain"])
    ]
    return outcomes[0] == outcomes[1]


def places_to_add() -> dict[str, int | None]:
    """Number of places for each kind of addition, by the tests that make it; None if a test
    fails."""
    words = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", TESTS[1]]
    shown = subprocess.run(words, cwd=HOME.parent, capture_output=True, text=True).stdout
    found = re.findall(r"::test_an?_(\w+)_is_(one|two|three)_places? (PASSED|FAILED)", shown)
    return {name: PLACES[count] if end == "PASSED" else None for name, count, end in found}


def passed_on(version: str) -> bool:
    """Whether TESTS pass on a version of numba that pip installs into a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["-m", "pip", "install", "--quiet", "--target", folder, f"numba=={version}"]
        subprocess.run([sys.executable, *words], check=True)
        paths = [folder, str(HOME.parent)]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(paths),
            "NUMBA_CACHE_DIR": f"{folder}/kernels",
        }
        words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", *TESTS]
        ended = subprocess.run([sys.executable, *words], cwd=HOME.parent, env=environment)
    return ended.returncode == 0


if __name__ == "__main__":
    command.run(main)
