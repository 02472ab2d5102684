"""A refusal names the thing, the rule and the value in every process; a fault is not a refusal."""

import math
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from startrack import Refused
from startrack.core import checks, require_memory, within
from startrack.core.checks import WrongType


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: checks.finite(gain=math.nan), ["gain", "finite", "nan"]),
        (lambda: checks.positive(gain=0.0), ["gain", "positive", "0.0"]),
        (lambda: checks.non_negative(gain=-1e-300), ["gain", "negative", "-1e-300"]),
        (lambda: checks.within(0, 1, gain=1.2), ["gain", "[0, 1]", "1.2"]),
        (lambda: checks.whole(1, 16, bits=17), ["bits", "[1, 16]", "17"]),
        (lambda: checks.one_of(("a", "b"), kind="c"), ["kind", "a, b", "'c'"]),
    ],
)
def test_a_refusal_names_the_parameter_the_rule_and_the_value(call, words):
    with pytest.raises(ValueError) as error:
        call()
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("value", [True, "1", None, 1j])
def test_what_is_no_number_is_a_type_error(value):
    with pytest.raises(TypeError, match="gain"):
        checks.positive(gain=value)


@pytest.mark.parametrize("value", [True, 1.0, "1"])
def test_what_is_no_whole_number_is_a_type_error(value):
    with pytest.raises(TypeError, match="bits"):
        checks.whole(0, 2, bits=value)


def test_bounds_belong_to_the_range():
    checks.within(0, 1, low=0, high=1)
    checks.whole(0, 1, low=0, high=1)


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
