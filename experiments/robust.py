"""How many untrusted inputs end in anything other than a result or a message?

    python experiments/robust.py [--json FILE] [--cases 10000] [--kinds KIND ...] [--seed 1]
                                 [--kills 100] [--caches 30] [--designs 100] [--slow] [--keep DIR]
                                 [--compiled DIR] [--quick]

Cases come from the grammar of tests/fuzz and a seed. Each case runs a command in a process with a
limit of 1 GiB, as user nobody if this process is root and other users can run its Python. A case
hangs if it takes 36 s of CPU time without progress output, or six minutes. `silent_differences`:
results from damaged or replaced files that differ without a message. `replaced`: FIFOs, links or
devices that were replaced by files. `outside`: files written outside the folder of the cases; only
detected as nobody. `planted`: faults put into the package on purpose, and whether cases find them.
`caches`: damaged or foreign files of compiled code and of indexes that change a result or end a
command. `clusters`: Dask workers with different code that the command does not report. Then
commands are ended by SIGKILL, SIGTERM and SIGINT and started again. `lost`: final files with bytes
that differ from an undisturbed run. `orphans`: remaining processes. `words`: ends with a status
other than 143 and 130, or with more than one message. `resident_growth_mb`: growth of one process
over the designs. `slow_tests_failed`: number of failed slow tests (null without --slow).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import command
import tomli_w

from tests.fuzz.arena import NOBODY, Case, Verdict, is_unprivileged, make_folder, python_path
from tests.fuzz.caches import run_caches
from tests.fuzz.campaign import ALL, run_cases
from tests.fuzz.clusters import run_clusters
from tests.fuzz.grammar import bases
from tests.fuzz.kills import COMMANDS, kill_commands
from tests.fuzz.planted import SHOWN, is_found

ROOT = Path(__file__).parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    known = sorted({one.__name__.removesuffix("_case") for one in ALL})
    parser.add_argument(
        "--kinds",
        nargs="+",
        choices=known,
        default=known,
        metavar="KIND",
        help=f"kinds of cases: {', '.join(known)} (default: all)",
    )
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--caches", type=int, default=30, help="number of damaged caches")
    parser.add_argument(
        "--designs", type=int, default=100, help="number of designs that one process computes"
    )
    parser.add_argument(
        "--slow", action="store_true", help="run the slow tests too, which takes hours"
    )
    parser.add_argument("--keep", type=Path, help="folder that keeps the files of each fault")
    parser.add_argument(
        "--compiled", type=Path, help="folder of code that is already compiled for the cases"
    )
    options = command.read(parser, cases=3, kills=0, caches=0, designs=0)
    counted, kinds, statuses = Counter[str](), Counter[str](), Counter[int | None]()
    slowest: list[float] = [0.0]

    def report(case: Case, verdict: Verdict) -> None:
        kinds[case.kind] += 1
        statuses[verdict.status] += 1
        slowest[0] = max(slowest[0], verdict.seconds)
        if sum(kinds.values()) % 100 == 0:
            print(f"{sum(kinds.values())} of {options.cases} cases", flush=True)
        if verdict.fault:
            counted[verdict.fault] += 1
            print(f"{verdict.fault}: {case.kind}: {' '.join(case.arguments)!r}: {verdict.detail!r}")
            sys.stdout.flush()
            if options.keep:
                keep(options.keep / f"{sum(counted.values())}", case)

    outside = list[Path]()
    if options.cases:
        wanted = [one for one in ALL if one.__name__.removesuffix("_case") in options.kinds]
        primed = not options.quick and options.kinds == known
        outside = run_cases(
            options.cases,
            options.seed,
            report,
            kinds=wanted,
            primed=primed,
            compiled=options.compiled,
        )
    ended = {"kills": 0, "lost": 0, "orphans": 0, "words": 0}
    if options.kills:
        with tempfile.TemporaryDirectory() as folder:
            ended = kill_commands(Path(folder), options.kills, options.seed, tuple(COMMANDS))
    figures: dict[str, Any] = {
        "seed": options.seed,
        "user": NOBODY if is_unprivileged() else os.geteuid(),
        "cases": sum(kinds.values()),
        "kinds": dict(kinds),
        "statuses": {str(status): count for status, count in statuses.items()},
        "tracebacks": counted["traceback"],
        "hangs": counted["hang"],
        "memory": counted["memory"],
        "silent_nan": counted["silent_nan"],
        "silent_differences": counted["silent_difference"],
        "replaced": counted["replaced"],
        "outside": len(outside),
        "slowest_s": slowest[0],
        **ended,
        "planted": {} if options.quick else planted(options.seed, options.compiled),
        **(surroundings(options.caches, options.seed) if options.caches else {}),
        "resident_growth_mb": grown(options.designs) if options.designs else 0.0,
        "slow_tests_failed": slow_tests_failed() if options.slow else None,
    }
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


def planted(seed: int, compiled: Path | None) -> dict[str, bool]:
    """Whether each fault put into the package is found."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        if compiled is None:
            compiled = Path(folder) / "code"
            make_folder(compiled)
        for fault in SHOWN:
            found[fault] = is_found(fault, seed, compiled)
            print(f"planted: {fault}: {'found' if found[fault] else 'NOT FOUND'}", flush=True)
    return found


def surroundings(cases: int, seed: int) -> dict[str, int]:
    """Damaged caches, and Dask workers with other code, that a command does not tolerate."""
    figures = {}
    for name, run in (
        ("caches", lambda folder: run_caches(folder, cases, seed)),
        ("clusters", run_clusters),
    ):
        with tempfile.TemporaryDirectory() as folder:
            figures[name] = run(Path(folder))
    return figures


def grown(designs: int) -> float:
    """Growth of one process over the designs, MiB."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "design.toml").write_text(tomli_w.dumps(bases()["design"]))
        line = [sys.executable, "-m", "tests.fuzz.worker", "growth", str(designs)]
        environment = os.environ | {"PYTHONPATH": python_path()}
        ended = subprocess.run(
            line, cwd=folder, env=environment, check=True, stdout=subprocess.PIPE, text=True
        )
    return float(ended.stdout)


def slow_tests_failed() -> int:
    """Number of slow tests that fail or end with an error, without the tests of the fuzzer."""
    line = [sys.executable, "-m", "pytest", "-m", "slow", "-q", "--ignore", "tests/fuzz"]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*line, f"--junitxml={folder}/tests.xml"], cwd=ROOT)
        (suite,) = ElementTree.parse(f"{folder}/tests.xml").getroot()
    return int(suite.get("failures", 0)) + int(suite.get("errors", 0))


def keep(folder: Path, case: Case) -> None:
    """Write the files of a case, and its command."""
    for name, content in case.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if content is not None:
            path.write_bytes(content)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "command.json").write_text(json.dumps([case.kind, *case.arguments]))


if __name__ == "__main__":
    command.run(main)
