"""Case -> verdict, by a process of its own with limits of time and memory."""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

ROOT = Path(__file__).parents[2]
SECONDS = 30.0  # of CPU, or without any, after which a case has hung
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
    files      content by name; None: a FIFO
    undamaged  the same files as they were; where they are given, the result must be refused, or be
               that of these
    """

    kind: str
    arguments: tuple[str, ...]
    files: Mapping[str, bytes | None] = field(default_factory=dict)
    undamaged: Mapping[str, bytes | None] | None = None


@dataclass(frozen=True)
class Verdict:
    """What became of a case.

    fault    "" where it was done or refused well; else traceback, hang, memory, silent_nan or
             silent_difference
    detail   the words that show it
    status   exit status, None after a hang or a crash
    seconds, bytes  that it took
    """

    fault: str
    detail: str
    status: int | None
    seconds: float
    bytes: int


class Arena:
    """Runs cases one after the other in a worker process, which is made anew where it ended."""

    def __init__(self, seconds: float = SECONDS, memory: int = MEMORY, fault: str = ""):
        self.seconds, self.memory, self.fault = seconds, memory, fault
        self._worker: subprocess.Popen[str] | None = None
        self._folder = Path(tempfile.mkdtemp(prefix="startrack-fuzz-"))
        self._results = dict[tuple[str, ...], str]()
        self._errors = (self._folder / "worker.txt").open("w+")

    def __enter__(self) -> Arena:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        self._errors.close()
        shutil.rmtree(self._folder, ignore_errors=True)

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
        folder.mkdir()
        for name, content in case.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            os.mkfifo(path) if content is None else path.write_bytes(content)
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
        return Verdict(fault, detail, status, seconds, size), out

    def prime(self, case: Case) -> None:
        """Let the worker compile what a command needs, which is no part of later cases."""
        self.judge(case, COMPILING)

    @staticmethod
    def _answers(worker: subprocess.Popen[str], seconds: float) -> bool:
        """Whether it answers before it has used so much CPU, or has used none for so long."""
        used = first = since = _cpu(worker.pid)
        waited = 0.0
        while not select.select([worker.stdout], [], [], STEP)[0]:
            waited, used = waited + STEP, _cpu(worker.pid)
            if used - since > IDLE * waited:
                waited, since = 0.0, used
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
            if not self._answers(worker, self.seconds * times):
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
        environment = os.environ | {"PYTHONPATH": str(ROOT), "STARTRACK_CACHE": str(self._folder)}
        return subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.worker", self.fault],
            cwd=ROOT, env=environment, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=self._errors,
        )  # fmt: skip

    def _end(self) -> None:
        if self._worker:
            self._worker.kill()
            self._worker.communicate()
            self._worker = None


def timeless(out: str) -> str:
    """A result without what depends on the speed of the machine."""
    return re.sub(r'"(\w*seconds|trials_per_s|\w*_s)": [^,}]*', "", out)


def _cpu(pid: int) -> float:
    """Second of CPU that a process has used."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


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
