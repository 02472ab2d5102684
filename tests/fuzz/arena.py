"""Case -> verdict, by a process of its own with limits of time and memory."""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from startrack.identification.cache import cache_folder

ROOT = Path(__file__).parents[2]
# Of CPU, or without any, after which a case that says nothing has hung; what takes long says every
# 30 s how far it is.
SECONDS = 36.0
LONG = 10  # times as long, after which it has hung whatever it says
COMPILING = 20  # times as long may a first case of a command take, which compiles
MEMORY = 2**30  # byte that a case may take, as it is told by --memory
STEP = 0.5  # second between two looks at the worker
IDLE = 0.01  # second of CPU in a second, below which it waits for something
EXCESS = 1.1  # of that, at which the limit is broken: libraries take some, too
STATUSES = {0, 1, 2, 3}
# What no sentence of a refusal holds; trials that fail by anything but a refusal are a fault, too.
UNEXPECTED = re.compile(
    r"Traceback \(most recent|: unexpected |On entry to D|RuntimeWarning|divide by zero enc"
    r"|invalid value enc|failed.*?: .*?\b(?<!raised )(?!ValueError)\w+Error: "
)
# Keys of JSON that may be null, each with the reason; `docs/json.md` documents them.
NULLS = ROOT / "docs" / "json.md"


@dataclass(frozen=True)
class Case:
    """Files, and a command that reads them.

    kind       of the input, for the figures
    arguments  of the command; the files stand in its folder
    files      content by name; None: a FIFO; a name with / at its end: a folder that cannot be
               written to
    undamaged  the same files as they were; where they are given, the result must be refused, or be
               that of these
    links      symbolic links: target by name; like FIFOs they must be there in the end
    """

    kind: str
    arguments: tuple[str, ...]
    files: Mapping[str, bytes | None] = field(default_factory=dict)
    undamaged: Mapping[str, bytes | None] | None = None
    links: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Verdict:
    """What became of a case.

    fault    "" where it was done or refused well; else traceback, hang, memory, silent_nan,
             silent_difference or replaced (a FIFO, link or device by a file)
    detail   the words that show it
    status   exit status, None after a hang or a crash
    seconds, bytes  that it took
    """

    fault: str
    detail: str
    status: int | None
    seconds: float
    bytes: int


NOBODY = 65534
FOLDER = "startrack-fuzz-"  # begin of the name of an arena's folder
DEVICES = ("/dev/null", "/dev/full", "/dev/zero", "/dev/tty")
# Where any user can write, and so where a command could leave something.
OPEN = ("/tmp", "/var/tmp", "/dev/shm", "/run/lock", "/dev/mqueue")


@cache
def is_unprivileged() -> bool:
    """Whether the worker runs as nobody: where this process is root and others can run Python."""
    if os.geteuid():
        return False
    needed = (Path(sys.executable).resolve(), ROOT, *(Path(one) for one in sys.path if one))
    parts = {part for path in needed if path.exists() for part in (path, *path.parents)}
    return all(part.stat().st_mode & 0o005 == 0o005 for part in parts if part.is_dir())


def python_path(*before: Path) -> str:
    """PYTHONPATH of processes that import these sources, and what this one finds there."""
    known = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return os.pathsep.join(filter(None, [*map(str, before), str(ROOT), *known]))


def make_folder(folder: Path) -> None:
    """Make a folder of the user of the workers."""
    folder.mkdir()
    if is_unprivileged():
        os.chown(folder, NOBODY, NOBODY)


def copy_caches(folder: Path) -> None:
    """Copy the kernels and indexes of this process into a folder, for the user of the workers."""
    kernels = importlib.import_module("startrack.core.kernel").kernel_folder()
    indexes = cache_folder().glob("index-*.npz")
    found = {path: folder / path.name for path in indexes}
    if kernels:
        files = (path for path in kernels.rglob("*") if path.suffix in (".nbi", ".nbc"))
        found |= {path: folder / path.relative_to(kernels.parent) for path in files}
    folder.mkdir(parents=True, mode=0o700)
    for path, target in found.items():
        target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with contextlib.suppress(FileNotFoundError):  # another process keeps those used last
            shutil.copyfile(path, target)
    if is_unprivileged():
        for path in (folder.parent, folder, *folder.rglob("*")):
            os.chown(path, NOBODY, NOBODY)


class Arena:
    """Runs cases one after the other in a worker process, which is made anew where it ended.

    Where this process is root, the worker is nobody, with a home in its folder.

    compiled  folder of the worker's user to keep compiled code in; None: its own
    """

    def __init__(
        self,
        seconds: float = SECONDS,
        memory: int = MEMORY,
        fault: str = "",
        compiled: Path | None = None,
    ):
        self.seconds, self.memory, self.fault, self._compiled = seconds, memory, fault, compiled
        self._worker: subprocess.Popen[str] | None = None
        self._nobody, self._begun = is_unprivileged(), time.time()
        self._folder = Path(tempfile.mkdtemp(prefix=FOLDER))
        for name in ("home", "tmp"):
            make_folder(self._folder / name)
        copy_caches(self._folder / "home" / ".cache" / "startrack")
        self._folder.chmod(0o755)
        self._results = dict[tuple[str, ...], str]()
        self._errors = (self._folder / "worker.txt").open("w+")

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        self._errors.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def outside(self) -> list[Path]:
        """What the worker's user has written outside of its folder, and others', since it began."""
        if not self._nobody:
            return []
        found, own = [], (self._compiled,)
        for place in OPEN:
            for folder, names, files in os.walk(place):
                names[:] = [
                    one for one in names if Path(folder, one) not in own and FOLDER not in one
                ]
                for path in (Path(folder, one) for one in (*names, *files)):
                    with contextlib.suppress(OSError):
                        state = path.lstat()
                        if state.st_uid == NOBODY and state.st_mtime >= self._begun:
                            found.append(path)
        return found

    def judge(self, case: Case, times: float = 1.0) -> Verdict:
        """Run a case and look at its status, its output and what it took.

        times  as long as usual may it take
        """
        verdict, out = self._run(case, times)
        if case.undamaged is None or verdict.fault or verdict.status not in (0, 3):
            return verdict
        if case.arguments not in self._results:
            whole = replace(case, files=case.undamaged)
            self._results[case.arguments] = timeless(self._run(whole, COMPILING)[1])
        if timeless(out) == self._results[case.arguments]:
            return verdict
        return replace(verdict, fault="silent_difference", detail=out[-300:])

    def _run(self, case: Case, times: float) -> tuple[Verdict, str]:
        """The verdict on a case by itself, and what it printed."""
        folder = self._folder / "case"
        shutil.rmtree(folder, ignore_errors=True)
        make_folder(folder)
        for name, content in case.files.items():
            path = folder / name
            if name.endswith("/"):
                path.mkdir(mode=0o555)
                continue
            path.parent.mkdir(parents=True, exist_ok=True)
            os.mkfifo(path) if content is None else path.write_bytes(content)
        for name, target in case.links.items():
            (folder / name).symlink_to(target)
        if self._nobody:
            for path in folder.rglob("*"):
                os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
        arguments = [*case.arguments, "--memory", str(self.memory)]
        answer = self._ask({"folder": str(folder), "arguments": arguments}, times)
        out, err = (
            path.read_text(errors="replace") if (path := folder / name).is_file() else ""
            for name in ("out.txt", "err.txt")
        )
        if answer is None:
            return Verdict("hang", err[-300:], None, self.seconds, 0), out
        if not answer:
            self._errors.flush()
            died = Path(self._errors.name).read_text(errors="replace")[-300:]
            return Verdict("traceback", f"the process died: {died}{err[-300:]}", None, 0.0, 0), out
        status, seconds, size = answer["status"], answer["seconds"], answer["bytes"]
        fault, detail = _fault(case, status, out, err, answer["escaped"])
        if not fault and size > self.memory * EXCESS:
            fault, detail = "memory", f"{size / 2**20:.0f} MiB; {err[-200:]}"
        if replaced := _replaced(folder, case):
            fault, detail = "replaced", f"{', '.join(replaced)}; {err[-200:]}"
        return Verdict(fault, detail, status, seconds, size), out

    def prime(self, case: Case) -> None:
        """Let the worker compile what a command needs, which is no part of later cases."""
        self.judge(case, COMPILING)

    @staticmethod
    def _answers(worker: subprocess.Popen[str], seconds: float, words: Path) -> bool:
        """Whether it answers before it uses so much CPU, or none for so long, without a word."""
        used = begun = first = since = _cpu(worker.pid)
        waited, said = 0.0, 0
        while not select.select([worker.stdout], [], [], STEP)[0]:
            waited, used = waited + STEP, _cpu(worker.pid)
            # Beside other programs it may get hardly any time while it has work.
            if used - since > IDLE * waited or _is_runnable(worker.pid):
                waited, since = 0.0, used
            if used - first > seconds and used - begun < LONG * seconds and _size(words) > said:
                first, said = used, _size(words)
            if used - first > seconds or waited > seconds:
                return False
        return True

    def _ask(self, question: dict, times: float) -> dict | None:
        """The worker's answer; {} where it died, None where it hung."""
        worker = self._worker = self._worker or self._begin()
        assert worker.stdin
        assert worker.stdout
        try:
            worker.stdin.write(json.dumps(question) + "\n")
            worker.stdin.flush()
            words = Path(question["folder"]) / "err.txt"
            if not self._answers(worker, self.seconds * times, words):
                self._end()
                return None
            line = worker.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self._end()
            return {}
        return json.loads(line)

    def _begin(self) -> subprocess.Popen[str]:
        environment = os.environ | {
            "PYTHONPATH": python_path(),
            "HOME": str(self._folder / "home"),
            "TMPDIR": str(self._folder / "tmp"),
        }
        for name in ("STARTRACK_CACHE", "XDG_CACHE_HOME"):
            environment.pop(name, None)
        if self._compiled:
            environment["NUMBA_CACHE_DIR"] = str(self._compiled)
        nobody: dict[str, Any] = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
        return subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.worker", self.fault],
            cwd=ROOT,
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            **(nobody if self._nobody else {}),
        )

    def _end(self) -> None:
        if self._worker:
            self._worker.kill()
            self._worker.communicate()
            self._worker = None


def _replaced(folder: Path, case: Case) -> list[str]:
    """The FIFOs, links and devices that are none any more."""
    found = [
        name
        for name, content in case.files.items()
        if content is None and not (folder / name).is_fifo()
    ]
    found += [name for name in case.links if not (folder / name).is_symlink()]
    return found + [name for name in DEVICES if os.path.lexists(name) and Path(name).is_file()]


def timeless(out: str) -> str:
    """A result without what depends on the speed of the machine."""
    return re.sub(r'"(\w*seconds|trials_per_s|\w*_s)": [^,}]*', "", out)


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def _stat(pid: int) -> list[str]:
    """The state of a process and what follows it in `stat` of proc(5); nothing where it ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def _is_runnable(pid: int) -> bool:
    """Whether a process waits for nothing but a processor or a disk."""
    return _stat(pid)[:1] in (["R"], ["D"])


def _cpu(pid: int) -> float:
    """Second of CPU that a process has used."""
    fields = _stat(pid)
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def _fault(case: Case, status: int, out: str, err: str, escaped: str) -> tuple[str, str]:
    if UNEXPECTED.search(out + err):
        return "traceback", (out + err)[-600:]
    if escaped or status not in STATUSES:
        return "traceback", f"status {status} {escaped} {err[-300:]}"
    if status in (1, 2) and not err.strip():
        return "traceback", f"status {status} without a word"
    if "--json" not in case.arguments:
        return "", ""
    try:
        rows = [json.loads(line, parse_constant=_refuse) for line in out.splitlines()]
    except ValueError as error:
        return "silent_nan", f"no JSON: {error}: {out[-200:]}"
    known = NULLS.read_text(encoding="utf-8") if NULLS.is_file() else ""
    for row in rows:
        for names in _nulls(row):
            if not any(f"`{name}`" in known for name in names):
                return "silent_nan", f"{'.'.join(names)} is null with status {status}"
    return "", ""


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is no JSON")


def _nulls(value: object, names: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """The keys of what is null, from the outermost on; items of a list have the key of the list."""
    if isinstance(value, dict):
        return [found for key, one in value.items() for found in _nulls(one, (*names, key))]
    if isinstance(value, list):
        return [found for one in value for found in _nulls(one, names)]
    return [names] if value is None else []
