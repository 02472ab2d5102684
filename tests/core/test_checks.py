import math

import pytest

from startrack.core import checks


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
