"""Seed, trial, cause -> random generator, the same for any number of workers."""

import hashlib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.random.bit_generator import ISpawnableSeedSequence
from numpy.typing import NDArray

from startrack.core.checks import Refused, whole
from startrack.core.kernel import kernel

POOL = 4  # words of 32 bits
STATE = 3  # numbers of 64 bits, that SFC64 asks for
FIRST_A, FACTOR_A = np.uint32(0x43B0D7E5), np.uint32(0x931E8875)
FIRST_B, FACTOR_B = np.uint32(0x8B51F9DD), np.uint32(0x58F38DED)
LEFT, RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
HALF = np.uint32(16)
WORD = np.uint64(32)


class Seeds(ISpawnableSeedSequence):
    """`numpy.random.SeedSequence` of whole numbers below 2^64, for an SFC64 alone."""

    def __init__(self, *entropy: int) -> None:
        self.entropy = np.array(entropy, np.uint64)

    @cached_property
    def _numpys(self) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.entropy.tolist())

    def spawn(self, n_children: int) -> list[Any]:
        """Children by numpy's own method; scipy's low-discrepancy sequences need them."""
        return self._numpys.spawn(n_children)

    def generate_state(self, n_words: int, dtype: Any = np.uint64) -> NDArray[np.uint64]:
        """The numbers (3,) that SFC64 asks for."""
        if n_words != STATE or dtype != np.uint64:
            raise Refused(f"n_words must be {STATE} of uint64, got {n_words} of {dtype}")
        return np.asarray(_state(self.entropy))


@kernel
def _state(entropy: NDArray[np.uint64]) -> NDArray[np.uint64]:
    pool, factor = _pool(_words(entropy)), FIRST_B
    state = np.empty(STATE, np.uint64)
    for k in range(STATE):
        low, factor = _hashed(pool[2 * k % POOL], factor, FACTOR_B)
        high, factor = _hashed(pool[(2 * k + 1) % POOL], factor, FACTOR_B)
        state[k] = np.uint64(low) | (np.uint64(high) << WORD)
    return state


@kernel
def _words(entropy: NDArray[np.uint64]) -> NDArray[np.uint32]:
    """The numbers in words, the low one first, and no high one where that is zero."""
    words = np.zeros(2 * len(entropy), np.uint32)
    count = 0
    for number in entropy:
        words[count] = np.uint32(number)
        count += 1
        if number >> WORD:
            words[count] = np.uint32(number >> WORD)
            count += 1
    return words[: max(count, POOL)]


@kernel
def _pool(words: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The four words that `numpy.random.SeedSequence` mixes all words of the entropy into."""
    pool = np.empty(POOL, np.uint32)
    factor = FIRST_A
    for k in range(POOL):
        pool[k], factor = _hashed(words[k], factor, FACTOR_A)
    for source in range(POOL):
        for k in range(POOL):
            if k != source:
                word, factor = _hashed(pool[source], factor, FACTOR_A)
                pool[k] = _mixed(pool[k], word)
    for source in range(POOL, len(words)):
        for k in range(POOL):
            word, factor = _hashed(words[source], factor, FACTOR_A)
            pool[k] = _mixed(pool[k], word)
    return pool


@kernel
def _hashed(word, factor, growth):  # type: ignore[no-untyped-def]
    """A word, and the factor for the next one."""
    after = np.uint32(factor * growth)
    word = np.uint32(np.uint32(word ^ factor) * after)
    return np.uint32(word ^ (word >> HALF)), after


@kernel
def _mixed(first, other):  # type: ignore[no-untyped-def]
    mixed = np.uint32(np.uint32(LEFT * first) - np.uint32(RIGHT * other))
    return np.uint32(mixed ^ (mixed >> HALF))


@dataclass(frozen=True)
class Streams:
    """The random streams of one trial.

    A stream depends only on (seed, trial, cause). So results do not depend on the number or order
    of workers, and removing one effect changes no other draw.

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
        return np.random.Generator(self._bits(cause))

    def key(self, cause: str) -> np.uint64:
        """The first 64 bits of one cause, for counters of compiled code."""
        return np.uint64(self._bits(cause).random_raw())

    def _bits(self, cause: str) -> np.random.SFC64:
        seeds = Seeds(self.seed, self.trial, _number_of(cause))
        # numpy takes any ISeedSequence, which its stubs do not know.
        return np.random.SFC64(seeds)  # type: ignore[arg-type]


@lru_cache(maxsize=256)
def _number_of(cause: str) -> int:
    return int.from_bytes(hashlib.blake2b(cause.encode(), digest_size=8).digest(), "little")
