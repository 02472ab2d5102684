"""A refusal says what, which rule and which value, wherever it goes; a fault is none."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from startrack import Refused
from startrack.core import require_memory, within
from startrack.core.checks import WrongType


def test_it_has_the_parameter_the_rule_and_the_value():
    with pytest.raises(Refused, match=r"gain must lie in \[0, 1\], got 1.5") as caught:
        within(0, 1, gain=1.5)
    error = caught.value
    assert (error.key, error.rule, error.value) == ("gain", "must lie in [0, 1]", 1.5)


def test_a_wrong_type_is_a_refusal_and_a_type_error():
    with pytest.raises(TypeError, match="gain must be a number, got 'high'") as caught:
        within(0, 1, gain="high")
    assert isinstance(caught.value, Refused)


def test_within_a_table_it_names_the_place():
    inner = Refused("gain must be 1", key="gain", rule="must be 1", value=2, lasting=False)
    outer = inner.within("detector")
    assert (str(outer), outer.key) == ("detector: gain must be 1", "detector.gain")
    assert (outer.rule, outer.value, outer.lasting) == ("must be 1", 2, False)


def test_worker_processes_hand_it_over_as_it_is():
    with ProcessPoolExecutor(1, get_context("spawn")) as executor:
        memory = executor.submit(require_memory, 1e18, "a map").exception()
        kind = executor.submit(within, 0, 1, gain="high").exception()
    assert type(memory) is Refused
    assert not memory.lasting
    assert type(kind) is WrongType
    assert (kind.key, kind.rule, kind.value) == ("gain", "must be a number", "high")
