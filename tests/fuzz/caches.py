"""Caches on disk that are damaged or belong to another user -> whether a command's result
changes."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import tomli_w

from tests.fuzz.arena import NOBODY, UNEXPECTED, is_unprivileged, make_folder, python_path, timeless
from tests.fuzz.grammar import bases, pictures

STRANGER = 1  # a user who is neither root nor nobody
LONGEST = 300.0  # second: a command that compiles all that it needs
COMMANDS = (
    ("montecarlo", "design.toml", "--trials", "3", "--fidelity", "window", "--workers", "1"),
    ("montecarlo", "design.toml", "--trials", "3", "--fidelity", "frame", "--workers", "1"),
    ("solve", "a.png", "--fov", "12"),
)


def run_caches(
    folder: Path, cases: int, seed: int, report: Callable[[str, str], object] = print
) -> int:
    """Damage caches repeatedly, run a command with each, and count the ends that differ.

    report   called with the damage and the output of a command that ended differently
    """
    rng = random.Random(seed)
    if is_unprivileged():
        folder.chmod(0o755)
    whole = folder / "whole"
    for place in (whole, whole / "code", whole / "indexes"):
        make_folder(place)
    expected = [_end(folder, whole, number, command) for number, command in enumerate(COMMANDS)]
    assert all(status in (0, 3) for status, _, _ in expected), expected
    found = 0
    for case in range(cases):
        number = case % len(COMMANDS)
        place = folder / f"case-{case}"
        # Links, so that a copy takes no time: what is damaged is replaced, and never written to.
        shutil.copytree(whole, place, copy_function=os.link)
        words = [_damage(rng, place) for _ in range(1 + rng.randrange(3))]
        if is_unprivileged():
            for path in (place, *place.rglob("*")):
                if path.is_symlink() or path.lstat().st_uid not in (STRANGER, NOBODY):
                    os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
        status, out, err = _end(folder, place, number, COMMANDS[number])
        if (status, out) != expected[number][:2] or UNEXPECTED.search(err):
            found += 1
            report(", ".join(words), f"status {status}: {(out + err)[-500:]!r}")
        shutil.rmtree(place, ignore_errors=True)
    return found


def _damage(rng: random.Random, place: Path) -> str:
    """Damage a file of a cache; what was done."""
    files = sorted(path for path in place.rglob("*") if path.is_file() and path.suffix)
    kind = rng.choice((".nbi", ".nbc", ".npz"))
    path = rng.choice([path for path in files if path.suffix == kind] or files)
    other = rng.choice([one for one in files if one.suffix == path.suffix])
    data, foreign = path.read_bytes(), other.read_bytes()
    path.unlink()
    what = rng.choice(("cut", "bit", "empty", "other", "fifo", "folder", "loop", "foreign", "open"))
    match what:
        case "fifo":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path.name)
        case "cut":
            path.write_bytes(data[: rng.randrange(len(data))])
        case "bit":
            at = rng.randrange(len(data))
            path.write_bytes(data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :])
        case "empty":
            path.write_bytes(b"")
        case "other":
            path.write_bytes(foreign)
        case "open":
            path.write_bytes(foreign)
            path.chmod(0o666)
        case "foreign":
            path.write_bytes(foreign)
            if os.geteuid() == 0:
                os.chown(path, STRANGER, STRANGER)
    return f"{path.name}: {what}"


def _end(
    folder: Path, caches: Path, number: int, command: tuple[str, ...]
) -> tuple[int | None, str, str]:
    """Status, output and messages of a command in a process of its own."""
    work = folder / f"work-{number}"
    shutil.rmtree(work, ignore_errors=True)
    make_folder(work)
    (work / "design.toml").write_bytes(tomli_w.dumps(bases()["design"]).encode())
    (work / "a.png").write_bytes(pictures()["a.png"])
    environment = os.environ | {
        "PYTHONPATH": python_path(),
        "NUMBA_CACHE_DIR": str(caches / "code"),
        "STARTRACK_CACHE": str(caches / "indexes"),
        "HOME": str(work),
    }
    line = [sys.executable, "-m", "startrack.cli", *command, "--json"]
    user = {"user": NOBODY, "group": NOBODY, "extra_groups": []} if is_unprivileged() else {}
    try:
        ended = subprocess.run(
            line, cwd=work, env=environment, capture_output=True, text=True, timeout=LONGEST, **user
        )  # type: ignore[call-overload]
    except subprocess.TimeoutExpired:
        return None, "", f"still there after {LONGEST:g} s"
    return ended.returncode, timeless(ended.stdout), ended.stderr
