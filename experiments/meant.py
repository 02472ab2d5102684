"""Does startrack read files as their writers meant, and do its laws hold at their limits?

    python experiments/meant.py [--parts files laws slews promises orders] [--json FILE] [--quick]

files        files written by other programs, in all formats that startrack reads: right, refused,
             wrong or crashed; `wrong` and `crashed` are numbers of files, `refused` the number
             refused with a message
laws         laws with a closed form at a limit; laws_off: laws that deviate from it by more than
             their stated accuracy
covariance_over_spots  error of fidelity `covariance` over error of `spots` about each axis, in
             slews of up to 2 deg/s: the worst ratio, upward
network, foreign_code, hangs  number of test files that made a reader use the network, run code or
             hang
orders_green number of passed runs of all tests, of three in random orders with 2, 1 and 4 workers
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import collections
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import command
import meant_attitudes
import meant_images
import meant_laws
import meant_promises
import meant_terrain
from meant_check import Check, Verdict

PARTS = ("files", "laws", "slews", "promises", "orders")
FILES = (meant_attitudes.checks, meant_images.checks, meant_terrain.checks)
ORDERS = {1: 2, 2: 1, 3: 4}  # seed of an order: workers
ROOT = Path(__file__).parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, metavar="PART")
    options = command.read(parser, parts=PARTS[:4])
    run: dict[str, Callable[[bool], dict[str, Any]]] = {
        "files": files,
        "laws": laws,
        "slews": slews,
        "promises": promises,
        "orders": orders,
    }
    figures: dict[str, Any] = {}
    for part in options.parts:
        figures |= run[part](options.quick)
        print(f"{part}: {figures}", flush=True)
    command.save(options, figures, partial=set(options.parts) != set(PARTS))


def files(quick: bool) -> dict[str, Any]:
    """Verdicts of all files, by format."""
    with tempfile.TemporaryDirectory() as name:
        done = list(_each_in_its_folder(Path(name), quick))
    counts = _counted(done)
    return {
        "files": len(done),
        "wrong": counts[Verdict.WRONG],
        "crashed": counts[Verdict.CRASHED],
        "refused": counts[Verdict.REFUSED],
    }


def _each_in_its_folder(folder: Path, quick: bool) -> Iterator[Check]:
    for number, checks in enumerate(FILES):
        own = folder / str(number)
        own.mkdir()
        with warnings.catch_warnings():
            # warnings of the writing programs; readers report problems
            warnings.simplefilter("ignore")
            yield from checks(own, quick)


def _counted(done: list[Check]) -> collections.Counter[Verdict]:
    """Counts of verdicts. Prints a table by kind, and all verdicts except right."""
    kinds = sorted({check.kind for check in done})
    for kind in kinds:
        counts = collections.Counter(check.verdict for check in done if check.kind == kind)
        words = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
        print(f"  {kind}: {words}")
    for check in done:
        if check.verdict is not Verdict.RIGHT:
            print(f"    {check.verdict}: {check.kind}, {check.name}: {check.note}")
    return collections.Counter(check.verdict for check in done)


def laws(quick: bool) -> dict[str, Any]:
    """Limits of laws; a law refused at its limit counts as deviating."""
    with tempfile.TemporaryDirectory() as name:
        done = list(meant_laws.checks(Path(name), quick))
    right = _counted(done)[Verdict.RIGHT]
    return {"laws": len(done), "laws_off": len(done) - right}


def slews(quick: bool) -> dict[str, Any]:
    """Errors with drawn spots of known identity, over errors with identified spots, in slews."""
    return {"covariance_over_spots": meant_laws.covariance_over_spots(quick)}


def promises(quick: bool) -> dict[str, Any]:
    """Promises of SECURITY.md on untrusted files."""
    kept = meant_promises.promises(quick)
    for note in kept.notes:
        print(f"    {note}")
    return {
        "baits": kept.baits,
        "network": kept.network,
        "foreign_code": kept.foreign_code,
        "hangs": kept.hangs,
    }


def orders(quick: bool) -> dict[str, Any]:
    """All tests in random orders, without the folder of external data."""
    green = 0
    for seed, workers in ORDERS.items():
        environment = {name: os.environ[name] for name in os.environ if name != "STARTRACK_DATA"}
        path = os.pathsep.join([str(ROOT / "experiments"), environment.get("PYTHONPATH", "")])
        environment |= {"ORDER": str(seed), "PYTHONPATH": path.rstrip(os.pathsep)}
        words = [sys.executable, "-m", "pytest", "-q", "-n", str(workers), "-p", "meant_order"]
        done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True)
        lines = done.stdout.strip().splitlines()
        failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
        print("\n".join([*failed, f"  order {seed}, {workers} workers: {lines[-1]}"]))
        green += done.returncode == 0
    return {"orders_green": green}


if __name__ == "__main__":
    command.run(main)
