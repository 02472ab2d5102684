"""Cached values are counted in bytes, and are dropped if a step needs the memory."""

import gc
from typing import NamedTuple

import numpy as np
import pytest

from startrack import Refused
from startrack.core import memory as module
from startrack.core import require_memory
from startrack.core.memory import Kept, bytes_of, kept, kept_bytes
from startrack.identification import PatternIndexes, cache

MIB = 2**20


@pytest.fixture
def limited(monkeypatch):
    """A process that may take 400 MiB, of which a quarter may be kept."""
    gc.collect()
    module.shrink_kept(0)
    monkeypatch.setenv("STARTRACK_MEMORY", str(400 * MIB))


def test_the_values_used_last_are_kept():
    made = []
    store = Kept[int](2)
    for key in (1, 2, 1, 3, 1, 2):
        store.get(key, lambda key=key: made.append(key) or key)
    assert made == [1, 2, 3, 2]


def test_all_that_is_kept_takes_a_quarter_of_the_limit(limited):
    made = []

    @kept(100)
    def table(number):
        made.append(number)
        return np.zeros(10 * MIB // 8), number

    others = Kept[np.ndarray](100)
    others.get("first", lambda: np.zeros(50 * MIB // 8))
    for number in range(20):
        table(number)
    assert kept_bytes() == 100 * MIB
    assert others.bytes == 0  # used longest ago, whoever keeps it
    table(19)
    assert made == list(range(20))
    table(0)
    assert made[-1] == 0


def test_it_gives_way_to_a_step(limited):
    store = Kept[np.ndarray](10)
    store.get(1, lambda: np.zeros(90 * MIB // 8))
    require_memory(300 * MIB, "a frame")
    assert kept_bytes() == 90 * MIB
    require_memory(350 * MIB, "a frame")
    assert kept_bytes() == 0
    with pytest.raises(Refused, match="limit"):
        require_memory(401 * MIB, "a frame")


def test_indexes_of_many_catalogues_stay_within_it(limited, monkeypatch, tmp_path):
    """16 catalogues with an index of 10 MB for each of 28 fields would take 4.5 GB without a
    limit."""
    monkeypatch.setattr(cache, "indexed_field", lambda field: field)
    monkeypatch.setattr(cache, "cached_index", lambda *_: np.zeros(10 * MIB // 8))
    catalogues = [PatternIndexes(None, tmp_path) for _ in range(16)]
    for indexes in catalogues:
        for field in range(28):
            indexes(field)
    assert kept_bytes() == 100 * MIB


def test_bytes_of_nested_values():
    class Pair(NamedTuple):
        first: np.ndarray
        rest: dict

    class Plan:
        def __init__(self):
            self.table = np.zeros(10)
            self.again = self.table[2:]

    assert bytes_of(Pair(np.zeros(5), {"more": [np.zeros(3, np.uint8)]})) == 43
    assert bytes_of(Plan()) == 80
    assert bytes_of((1, "text", None)) == 0
