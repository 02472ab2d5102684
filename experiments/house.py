"""How large is the package, and does it lean on names that other packages do not publish?

python experiments/house.py [--json FILE] [--quick]

Counts lines and files of the package, public names, and names of other packages that begin with an
underscore or stand in numba's inside, outside the one file that may use them
(startrack/core/compiler.py). Then times the first and a later `startrack simulate`, which --quick
leaves out. `python experiments/speed.py --against COMMIT` times the stages beside another commit.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import command

import startrack

HOME = Path(startrack.__file__).parent
OPTIONAL = HOME / "core" / "compiler.py"  # may use what numba does not publish


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options = command.read(parser)
    files = [path for path in HOME.rglob("*.py*") if path.suffix in (".py", ".pyi")]
    private = [name for path in files if path != OPTIONAL for name in private_names(path)]
    figures: dict[str, Any] = {
        "lines": sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files),
        "files": len(files),
        "public_names": public_names(),
        "private_names": len(private),
        "private": sorted(private),
    }
    if not options.quick:
        with tempfile.TemporaryDirectory() as folder:
            for name in ("simulate_cold_s", "simulate_warm_s"):
                figures[name] = simulate(Path(folder))
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


def public_names() -> int:
    """Names of the package, and those in `__all__` of the packages among them."""
    listed, waiting = 0, [startrack.__name__]
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
    """What a file imports from other packages under a name that they do not publish."""
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


def simulate(folder: Path) -> float:
    """Seconds of `startrack simulate`, kernels compiled into a folder that is kept."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "kernels")}
    words = [sys.executable, "-m", "startrack.cli", "simulate", "--out", str(folder / "out")]
    began = time.perf_counter()
    subprocess.run(words, env=environment, check=True, capture_output=True)
    return time.perf_counter() - began


if __name__ == "__main__":
    command.run(main)
