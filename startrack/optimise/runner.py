"""TrialRunner: trials of any design; it keeps each outcome, so that no trial is repeated."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import startrack
from startrack.core import POINTS, Refused, is_code, origin_of
from startrack.design import Campaign, Case, Fidelity
from startrack.detection import STREAK
from startrack.montecarlo import Serial, run
from startrack.optimise.ledger import Ledger
from startrack.population import Units
from startrack.trial import OUTCOMES, known_smear

Item = TypeVar("Item")
Result = TypeVar("Result")
FRESH = 10**6  # number of the first fresh trial, beyond all that tuning uses
VERIFYING = 10**8  # number of the first trial of a verification, beyond all others
FRESH_UNIT = 10**5  # number of the first fresh unit, beyond all that tuning uses
VERIFYING_UNIT = 10**7  # number of the first unit of a verification, beyond all others


class TrialRunner:
    """Trials of any design with the same attitudes and random streams.

    A study is deterministic: restarted with the ledger of an interrupted run, it does the missing
    trials only and has the same result.

    seed    of all random numbers
    ledger  keeps the outcomes; None for one in memory
    """

    def __init__(
        self,
        seed: int,
        executor: Executor | None = None,
        workers: int = 1,
        ledger: Ledger | None = None,
    ):
        self.seed = seed
        self._asked = dict[bytes, tuple[Fidelity, int]]()
        self._executor = executor or Serial()
        self._workers = workers
        self.ledger = ledger or Ledger()

    @property
    def tried(self) -> dict[Fidelity, int]:
        """Number of trials that were asked for, per fidelity, each once; also those of the ledger.

        So that it is the same for a study that was interrupted.
        """
        found = dict[Fidelity, int]()
        for fidelity, trials in self._asked.values():
            found[fidelity] = found.get(fidelity, 0) + trials
        return found

    def run(
        self,
        case: Case,
        trials: int,
        fidelity: Fidelity = Fidelity.FRAME,
        first: int = 0,
        progress: Callable[[int], None] | None = None,
        units: Units | None = None,
    ) -> NDArray[np.void]:
        """The outcomes of trials first ... first + trials - 1 of a design.

        units     how these go over its units; None: all are of the unit as designed
        progress  called with the number of trials that were just done
        Raises    Refused where the design cannot be built or rendered, also on each later call;
                  any other exception is a fault, of which the ledger knows nothing.
        """
        key = self._key(case, fidelity, first, units)
        if reason := self.ledger.refusal(key):
            raise Refused(reason)
        held = self.ledger.held(key)
        lacking = trials - len(held)
        if lacking <= 0:
            self._count(key, fidelity, trials)
            return held[:trials]
        try:
            new = run(
                case,
                lacking,
                self.seed,
                self._executor,
                first + len(held),
                self._workers,
                progress,
                fidelity,
                units,
            )
        except Refused as error:
            if error.lasting:
                self.ledger.keep_refusal(key, str(error))
            raise
        self._count(key, fidelity, trials)
        self.ledger.keep(key, len(held), new)
        return np.concatenate([held, new]).astype(OUTCOMES)

    def _count(self, key: bytes, fidelity: Fidelity, trials: int) -> None:
        self._asked[key] = fidelity, max(trials, self._asked.get(key, (fidelity, 0))[1])

    def map(self, call: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """A pure function of each item, in the workers; what a worker's end loses, in this process.

        Raises  what a call raises.
        """
        every = list(items)
        if isinstance(self._executor, Serial):
            return [call(one) for one in every]
        futures = [self._executor.submit(call, one) for one in every]
        results = []
        for one, future in zip(every, futures, strict=True):
            try:
                results.append(future.result())
            except BrokenExecutor:
                results.append(call(one))
        return results

    @property
    def workers(self) -> int:
        """Number of workers."""
        return self._workers

    def forecast_key(self, case: Case, campaign: Campaign, limits: tuple[float, ...]) -> bytes:
        """Of a design's forecast, by all that it depends on.

        limits  on what is forecast
        """
        judged = case, campaign.requirements, campaign.conditions, campaign.over_units(case)
        text = f"{startrack.__version__} {self.seed} forecast {campaign.objective} {limits} "
        text += described(judged)
        return hashlib.blake2b(text.encode(), digest_size=16).digest()

    def _key(self, case: Case, fidelity: Fidelity, first: int, units: Units | None = None) -> bytes:
        written = described(case)
        if not math.hypot(*known_smear(case)) > STREAK:  # trials are as without a known smear
            detection = replace(case.tracker.detection, smear_x=0.0, smear_y=0.0)
            written = described(replace(case, tracker=replace(case.tracker, detection=detection)))
        text = f"{startrack.__version__} {self.seed} {fidelity} {first} {written}"
        if units:
            text += f" {units}"
        return hashlib.blake2b(text.encode(), digest_size=16).digest()


def described(value: Any, name: str = "") -> str:
    """All that a parameter object holds, with all digits, but for what is as by default.

    So that a new parameter changes no text of a design that does not name it. A file is described
    by its content, too, and code by its files.

    name  of the field that the value is of
    """
    if is_dataclass(value):
        inner = [
            f"{each.name}={described(getattr(value, each.name), each.name)}{_code(each, value)}"
            for each in fields(value)
            if each.init and not _is_default(each, getattr(value, each.name))
        ]
        return f"{type(value).__name__}({', '.join(inner)})"
    if isinstance(value, tuple):
        return f"({', '.join(described(one) for one in value)})"
    if isinstance(value, str) and (name == "source" or name.endswith("_file")):
        path = Path(value)
        if path.is_file():
            status = path.stat()
            return f"{value!r} {_digest(path, status.st_mtime_ns, status.st_size)}"
    return repr(value)


def _code(field: Field[Any], value: Any) -> str:
    """Packages and digests of the code that a field names; empty for none."""
    if "code" not in field.metadata:
        return ""
    held, key = getattr(value, field.name), POINTS[field.metadata["code"]]
    names = [one for one in (held if isinstance(held, tuple) else (held,)) if is_code(one)]
    origins = [origin_of(key, name) for name in names]
    return "".join(f" {one.package} {one.digest}" for one in origins)


def _is_default(field: Field[Any], value: Any) -> bool:
    default = field.default if field.default is not MISSING else None
    if field.default_factory is not MISSING:
        default = field.default_factory()
    return type(value) is type(default) and bool(value == default)


@lru_cache(maxsize=64)
def _digest(path: Path, modified: int, size: int) -> str:
    """Of the content of a file that has not changed since."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
