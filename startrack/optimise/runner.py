"""TrialRunner: trials of any design; it keeps each outcome, so that no trial is repeated."""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from typing import Any, TypeVar

from startrack.core import Advance, Rows, described, inputs_of, software
from startrack.design import Campaign, Case, Fidelity
from startrack.montecarlo import Serial, run
from startrack.optimise.ledger import Ledger
from startrack.population import AS_DESIGNED, AsDesigned, Units, with_units

Item = TypeVar("Item")
Result = TypeVar("Result")
FRESH = 10**6  # number of the first fresh trial, beyond all that tuning uses
VERIFYING = 10**8  # number of the first trial of a verification, beyond all others
FRESH_UNIT = 10**5  # number of the first fresh unit, beyond all that tuning uses
RECALLED = 64  # results that `recall` keeps; by hand: enough for the designs at the end of a study
VERIFYING_UNIT = 10**7  # number of the first unit of a verification, beyond all others


class TrialRunner:
    """Trials of any design with the same attitudes and random streams.

    A study is deterministic: restarted with the ledger of an interrupted run, it does only the
    missing trials and has the same result.

    seed    seed of all random numbers
    workers  number of workers
    ledger  ledger of the outcomes; None: a ledger in memory
    watch   called with each design of a search and its `Foresight`, as soon as it is known
    """

    def __init__(
        self,
        seed: int,
        executor: Executor | None = None,
        workers: int = 1,
        ledger: Ledger | None = None,
    ):
        self.seed, self.workers, self.ledger = seed, workers, ledger or Ledger()
        self._asked = dict[bytes, tuple[Fidelity, int]]()
        self._recalled = dict[Any, Any]()
        self._executor = executor or Serial()
        self.watch: Callable[[Case, Any], None] = lambda case, foresight: None

    @property
    def tried(self) -> dict[Fidelity, int]:
        """Number of different trials that were requested, per fidelity, those of the ledger too.

        Therefore it is the same for an interrupted study.
        """
        tried = dict[Fidelity, int]()
        for fidelity, trials in self._asked.values():
            tried[fidelity] = tried.get(fidelity, 0) + trials
        return tried

    def run(
        self,
        case: Case,
        trials: int,
        fidelity: Fidelity = Fidelity.FRAME,
        first: int = 0,
        progress: Advance | None = None,
        units: AsDesigned | Units = AS_DESIGNED,
    ) -> Rows:
        """The outcomes of trials first ... first + trials - 1 of a design.

        units     assignment of trials to units, which adds a column `unit`; or all trials are of
                  the unit as designed
        progress  called with the number of trials that were just done
        Raises    Refused if the design cannot be built or rendered, also on each later call;
                  any other exception is a fault and is not written to the ledger.
        """
        key = self._key(case, fidelity, first, units)

        def make(done: int, number: int) -> Rows:
            return run(
                case,
                number,
                self.seed,
                self._executor,
                first + done,
                self.workers,
                progress,
                fidelity,
                units,
            )

        outcomes = self.ledger.completed(key, trials, make)
        self._count(key, fidelity, trials)
        return with_units(outcomes, units.trials) if isinstance(units, Units) else outcomes

    def _count(self, key: bytes, fidelity: Fidelity, trials: int) -> None:
        self._asked[key] = fidelity, max(trials, self._asked.get(key, (fidelity, 0))[1])

    def map(
        self, call: Callable[[Item], Result], items: Iterable[Item], progress: Advance | None = None
    ) -> Iterator[Result]:
        """A pure function of each item, in the workers; this process does work of lost workers.

        progress  called with 1 for each result, after it was taken
        Raises    the exceptions of the calls.
        """
        every = list(items)
        if isinstance(self._executor, Serial):
            results: Iterable[Result] = map(call, every)
        else:
            futures = [self._executor.submit(call, item) for item in every]
            results = (self._result(*pair, call) for pair in zip(futures, every, strict=True))
        for result in results:
            yield result
            if progress:
                progress(1)

    @staticmethod
    def _result(future: Future[Result], item: Item, call: Callable[[Item], Result]) -> Result:
        try:
            return future.result()
        except BrokenExecutor:
            return call(item)

    def recall(self, call: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """As `map`, for hashable items; the last results are cached."""
        every, recalled = list(items), self._recalled
        new = [item for item in dict.fromkeys(every) if (call, item) not in recalled]
        recalled.update(zip([(call, item) for item in new], self.map(call, new), strict=True))
        results = [recalled[call, item] for item in every]
        for key in list(recalled)[:-RECALLED]:
            del recalled[key]
        return results

    def forecast_key(self, case: Case, campaign: Campaign, limits: tuple[float, ...]) -> bytes:
        """Key of a design's forecast, made from everything on which the forecast depends.

        limits  limits of the forecast values
        """
        judged = case, campaign.requirements, campaign.conditions, campaign.over_units(case)
        inputs = inputs_of(case), inputs_of(campaign.requirements)
        usual = Campaign()
        words = [
            value
            for name in ("objective", "conditions_mean", "minimise")
            if (value := getattr(campaign, name)) != getattr(usual, name) or name == "objective"
        ]
        text = f"{software()} {self.seed} forecast {' '.join(words)} {limits} "
        text += f"{described(judged)} {inputs}"
        return hashlib.blake2b(text.encode(), digest_size=16).digest()

    def _key(
        self, case: Case, fidelity: Fidelity, first: int, units: AsDesigned | Units = AS_DESIGNED
    ) -> bytes:
        written, inputs = described(case), inputs_of(case)
        text = f"{software()} {self.seed} {fidelity} {first} {written} {inputs} {units}"
        return hashlib.blake2b(text.encode(), digest_size=16).digest()
