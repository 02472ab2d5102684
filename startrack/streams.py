"""One random stream per (seed, trial, cause): the same numbers for any number of workers."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from startrack.checks import whole
from startrack.seeds import Seeds


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
        name = hashlib.blake2b(cause.encode(), digest_size=8).digest()
        seeds = Seeds(self.seed, self.trial, int.from_bytes(name, "little"))
        # numpy takes any ISeedSequence, which its stubs do not know.
        return np.random.Generator(np.random.SFC64(seeds))  # type: ignore[arg-type]
