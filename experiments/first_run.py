"""How long does a new user wait from installation to first results, and how large is the
installation?

Makes a virtual environment, installs the project with pip, and runs three commands there: cold
(with the caches of the installation alone) and, for some, warm (a second time). `--before COMMIT`
does the same with another commit, alternately. Times are wall-clock times, for an idle processor;
CPU times, with child processes, are also given. A command may leave a process that compiles kernels
for the next command: `simulate_left_s` is the duration of that process after the command's end; its
CPU time is in `simulate_left_cpu_s` and in `compile_cpu_s`. pip uses its usual cache and index:
`install_s` without a cache is mainly the network.

`installed_mb` is the size of all installed distributions except pip and setuptools (1 MB = 1e6
bytes), listed by distribution. `import_ms` is the time of `import startrack` by `python -X
importtime`, the shortest of several.

    python experiments/first_run.py [--json FILE] [--before COMMIT] [--photo FILE] [--quick]

Without `--photo` an image of STARTRACK_DATA is solved, or else a frame rendered by `simulate`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import command

ROOT = Path(__file__).parents[1]
IMPORTS = 15  # processes; the shortest time counts
SIMULATE = ("simulate", "--ra", "83", "--dec", "-5", "--out", "frame")
OPTIMIZE = ("optimize", "--out", "better")
WEIGH = """
import importlib.metadata, json
told = {}
for one in importlib.metadata.distributions():
    files = [file.locate() for file in one.files or ()]
    told[one.name] = sum(file.stat().st_size for file in files if file.is_file())
print(json.dumps(told))
"""
NOT_OURS = ("pip", "setuptools", "wheel")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--before", metavar="COMMIT", help="commit to measure alternately with this tree"
    )
    parser.add_argument("--photo", type=Path, metavar="FILE", help="image of a night sky to solve")
    options = command.read(parser)
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder).resolve()
        figures = here(empty) if options.quick else fresh(empty, options)
    print()
    for name, value in figures.items():
        if isinstance(value, float):
            print(f"{name:32} {value:9.2f}")
    command.save(options, figures)


class Spent(NamedTuple):
    """Seconds of a process and of its children."""

    wall: float
    cpu: float


class Place(NamedTuple):
    """An interpreter with an empty home folder for caches.

    installed   installed files of startrack; none if another installation is used
    """

    python: Path
    home: Path
    installed: frozenset[Path] = frozenset()

    def environment(self) -> dict[str, str]:
        """The environment of a new user: no cache, path or home from elsewhere."""
        own = ("PYTHON", "NUMBA_", "STARTRACK_", "XDG_", "MPL")
        kept = {name: text for name, text in os.environ.items() if not name.startswith(own)}
        return kept | {"HOME": str(self.home)}

    def run(self, *words: str) -> Spent:
        """Seconds of `startrack` with the given arguments."""
        return clocked(
            [str(self.python), "-m", "startrack.cli", *words], self.home, self.environment()
        )

    def forget(self) -> None:
        """Remove all files made since the installation."""
        shutil.rmtree(self.home)
        self.home.mkdir()
        for path in self.sources() - self.installed:
            path.unlink()

    def sources(self) -> frozenset[Path]:
        """All files in the folder of the installed startrack."""
        told = subprocess.run(
            [self.python, "-c", "import startrack; print(startrack.__path__[0])"],
            capture_output=True,
            text=True,
            check=True,
            cwd=self.home,
            env=self.environment(),
        )
        folder = Path(told.stdout.strip())
        if not folder.is_relative_to(self.python.parents[1]):
            raise SystemExit(f"{self.python} imports startrack from {folder}")
        return frozenset(path for path in folder.rglob("*") if path.is_file())


def clocked(words: list[str], folder: Path, environment: dict[str, str]) -> Spent:
    """Seconds of a command, which must succeed."""
    began, before = time.perf_counter(), os.times()
    done = subprocess.run(
        words,
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    after = os.times()
    if done.returncode:
        raise SystemExit(f"{' '.join(words)} ended with {done.returncode}:\n{done.stdout[-2000:]}")
    cpu = after.children_user + after.children_system
    return Spent(time.perf_counter() - began, cpu - before.children_user - before.children_system)


def left_behind(folder: Path) -> Spent:
    """Seconds until all processes that a command left in its folder have ended (Linux)."""
    began, ticks = time.perf_counter(), {}
    while left := [one for one in Path("/proc").glob("[0-9]*") if works_in(one, folder)]:
        for process in left:
            with contextlib.suppress(OSError):
                fields = (process / "stat").read_text().rpartition(")")[2].split()
                ticks[process.name] = int(fields[11]) + int(fields[12])
        time.sleep(0.05)
    return Spent(time.perf_counter() - began, sum(ticks.values()) / os.sysconf("SC_CLK_TCK"))


def works_in(process: Path, folder: Path) -> bool:
    """Whether a process of /proc is alive in a folder."""
    try:
        alive = (process / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
        return alive and (process / "cwd").resolve() == folder.resolve()
    except OSError:  # it has ended, or belongs to another user
        return False


def here(folder: Path) -> dict[str, Any]:
    """For --quick: the running environment with its caches, and the simplest design."""
    design = str(ROOT / "catalogs" / "designs" / "noise_only.toml")
    words = [sys.executable, "-m", "startrack.cli", *SIMULATE, design]
    spent = clocked(words, folder, dict(os.environ))
    return {
        "simulate_warm_s": spent.wall,
        "simulate_warm_cpu_s": spent.cpu,
        "import_ms": import_ms(Path(sys.executable), dict(os.environ), 1),
        **weights(Path(sys.executable), dict(os.environ)),
    }


def fresh(folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Install and measure the present project and, with --before, another commit, alternately."""
    photo = (options.photo or first_photo() or Path("frame/frame.png")).expanduser()
    photo = photo.resolve() if photo.exists() else photo
    figures: dict[str, Any] = {"photo": photo.name}
    with contextlib.ExitStack() as stack:
        trees = {"": ROOT}
        if options.before:
            trees["before_"] = stack.enter_context(worktree(options.before, folder / "before"))
        places = {}
        for prefix, tree in trees.items():
            places[prefix], spent = installed(tree, folder / f"{prefix}environment")
            tell(figures, f"{prefix}install", spent)
        for name, words in (
            ("simulate", SIMULATE),
            ("solve", ("solve", str(photo))),
            ("optimize", OPTIMIZE),
        ):
            for prefix, place in places.items():
                place.forget()
                if name == "solve" and not photo.is_absolute():
                    place.run(*SIMULATE)
                    keep = (place.home / photo).read_bytes()
                    place.forget()
                    (place.home / photo).parent.mkdir()
                    (place.home / photo).write_bytes(keep)
                tell(figures, f"{prefix}{name}_cold", place.run(*words))
                tell(figures, f"{prefix}{name}_left", left_behind(place.home))
            for prefix, place in places.items():
                shutil.rmtree(place.home / "better", ignore_errors=True)
                tell(figures, f"{prefix}{name}_warm", place.run(*words))
        for prefix, place in places.items():
            figures[f"{prefix}compile_cpu_s"] = (
                figures[f"{prefix}simulate_cold_cpu_s"]
                + figures[f"{prefix}simulate_left_cpu_s"]
                - figures[f"{prefix}simulate_warm_cpu_s"]
            )
            figures[f"{prefix}optimize_cold_over_warm"] = (
                figures[f"{prefix}optimize_cold_s"] / figures[f"{prefix}optimize_warm_s"]
            )
            figures[f"{prefix}import_ms"] = import_ms(place.python, place.environment(), IMPORTS)
            weighed = weights(place.python, place.environment())
            figures |= {f"{prefix}{name}": one for name, one in weighed.items()}
    return figures


def tell(figures: dict[str, Any], name: str, spent: Spent) -> None:
    """Keep and print both times of a step."""
    figures |= {f"{name}_s": spent.wall, f"{name}_cpu_s": spent.cpu}
    print(f"{name:24} {spent.wall:8.1f} s   CPU {spent.cpu:8.1f} s", flush=True)


def first_photo() -> Path | None:
    """A photograph of the folder of real images."""
    folder = command.images("a photograph is")
    return next(iter(sorted(folder.glob("*.jpg"))), None) if folder else None


@contextlib.contextmanager
def worktree(commit: str, folder: Path) -> Iterator[Path]:
    """The project at another commit."""
    git = ["git", "-C", str(ROOT), "worktree"]
    subprocess.run([*git, "add", "--detach", str(folder), commit], check=True, capture_output=True)
    try:
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def installed(tree: Path, folder: Path) -> tuple[Place, Spent]:
    """A new environment with the project of a tree, and the seconds of `pip install`."""
    venv.create(folder, with_pip=True, symlinks=os.name != "nt")
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    words = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "."]
    outside = {name: text for name, text in os.environ.items() if not name.startswith("PYTHON")}
    spent = clocked(words, tree, outside)
    home = folder / "home"
    home.mkdir()
    bare = Place(python, home)
    return bare._replace(installed=bare.sources()), spent


def import_ms(python: Path, environment: dict[str, str], times: int) -> float:
    """Milliseconds of `import startrack`, the best of several processes."""
    found = []
    for _ in range(times):
        told = subprocess.run(
            [python, "-X", "importtime", "-c", "import startrack"],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        ).stderr
        # import time: self [us] | cumulative | imported package
        line = next(
            line for line in told.splitlines() if line.split("|")[-1].strip() == "startrack"
        )
        found.append(float(line.split("|")[1]) / 1e3)
    return min(found)


def weights(python: Path, environment: dict[str, str]) -> dict[str, Any]:
    """MB of each installed distribution and of all, printed as a table."""
    told = subprocess.run(
        [python, "-c", WEIGH], capture_output=True, text=True, check=True, env=environment
    )
    found = {
        name: size / 1e6 for name, size in json.loads(told.stdout).items() if name not in NOT_OURS
    }
    ordered = dict(sorted(found.items(), key=lambda each: -each[1]))
    print("\ndistribution                       MB")
    for name, size in list(ordered.items())[:25]:
        print(f"{name:30} {size:6.1f}")
    return {"installed_mb": sum(found.values()), "installed_mb_of": ordered}


if __name__ == "__main__":
    command.run(main)
