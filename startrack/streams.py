"""One random stream per (seed, trial, cause): the same numbers for any number of workers."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from startrack.checks import whole


@dataclass(frozen=True)
class Streams:
    """The random streams of one trial.

    A stream depends on nothing but (seed, trial, cause). So results do not depend on the
    number of workers or their order, and taking one effect away changes no other draw.

    >>> first = Streams(1, 0)("read noise").random()
    >>> bool(first == Streams(1, 0)("read noise").random())
    True
    """

    seed: int
    trial: int

    def __post_init__(self) -> None:
        whole(0, 2**63 - 1, seed=self.seed, trial=self.trial)

    def __call__(self, cause: str) -> np.random.Generator:
        """The generator of one cause, from its start."""
        name = int.from_bytes(hashlib.blake2b(cause.encode(), digest_size=8).digest(), "little")
        sequence = np.random.SeedSequence((self.seed, self.trial, name))
        return np.random.Generator(np.random.SFC64(sequence))
