"""TrialRunner: trials of any design; it keeps each outcome, so that no trial is repeated."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

import startrack
from startrack.design import Case, Fidelity
from startrack.detection import STREAK
from startrack.montecarlo import Serial, run
from startrack.optimise.ledger import Ledger
from startrack.trial import OUTCOMES, known_smear

FRESH = 10**6  # number of the first fresh trial, beyond all that tuning uses
VERIFYING = 10**8  # number of the first trial of a verification, beyond all others

# Earlier names that the keys of ledgers hold: old ledgers stay valid.
FIRST_NAMES = {
    "SolverSettings": "Attitude",
    "RegionOfInterest": "Region",
    "nonlinearity": "bend",
    "adc_inl": "bow",
    "em_gain": "multiplication",
}
NEW_NAMES = re.compile(rf"\b({'|'.join(FIRST_NAMES)})\b(?=[(=])")


class TrialRunner:
    """Trials of any design with the same attitudes and random streams.

    A study is deterministic: restarted with the ledger of an interrupted run, it does the missing
    trials only and has the same result.

    seed    of all random numbers
    ledger  keeps the outcomes; None for one in memory
    tried   number of trials done by this runner, per fidelity
    """

    def __init__(
        self,
        seed: int,
        executor: Executor | None = None,
        workers: int = 1,
        ledger: Ledger | None = None,
    ):
        self.seed = seed
        self.tried = dict[Fidelity, int]()
        self._executor = executor or Serial()
        self._workers = workers
        self.ledger = ledger or Ledger()

    def run(
        self,
        case: Case,
        trials: int,
        fidelity: Fidelity = Fidelity.FRAME,
        first: int = 0,
        progress: Callable[[int], None] | None = None,
    ) -> NDArray[np.void]:
        """The outcomes of trials first ... first + trials - 1 of a design.

        progress  called with the number of trials that were just done
        Raises    ValueError where the design cannot be built or rendered, also on each later call.
        """
        key = self._key(case, fidelity, first)
        if reason := self.ledger.refusal(key):
            raise ValueError(reason)
        held = self.ledger.held(key)
        lacking = trials - len(held)
        if lacking <= 0:
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
            )
        except ValueError as error:
            self.ledger.keep_refusal(key, str(error))
            raise
        self.tried[fidelity] = self.tried.get(fidelity, 0) + lacking
        self.ledger.keep(key, len(held), new)
        return np.concatenate([held, new]).astype(OUTCOMES)

    def _key(self, case: Case, fidelity: Fidelity, first: int) -> bytes:
        # The repr of a frozen case has all its numbers with all their digits.
        written = NEW_NAMES.sub(lambda found: FIRST_NAMES[found[0]], repr(case))
        if not math.hypot(*known_smear(case)) > STREAK:  # trials are as without a known smear
            written = written.replace("smear_x=None, smear_y=None", "smear_x=0.0, smear_y=0.0")
        for newer in (
            ", dark_map=None",
            ", lens_file=''",
            ", lens_family=''",
            ", family_field=None",
            ", psf_file=''",
            ", as_built=0.0",
            ", ghosts=None",
            ", lens_field=True, lens_colour=True",
            ", calibrated_at=None",
            ", focal_length_by_colour=False",
        ):
            written = written.replace(newer, "")
        written = written.replace(
            ", thermal=None)", ")"
        )  # of the instrument; the detector's has more
        text = f"{startrack.__version__} {self.seed} {fidelity} {first} {written}"
        return hashlib.blake2b(text.encode(), digest_size=16).digest()
