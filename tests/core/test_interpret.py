"""A kernel gives the same result as Python code and compiled."""

import math
import signal
from typing import NamedTuple

import numpy as np

from startrack.core import field_psf, interpret, interpreted, kernel
from startrack.core.compiler import KernelDispatcher


class Pair(NamedTuple):
    values: np.ndarray
    factor: float


def in_both_ways(found, *arguments):
    """The result as Python code, which compiles nothing, then the result of the compiled kernel."""
    with interpreted(lambda: True):
        first = found(*arguments)
    assert not found.overloads
    return first, found(*arguments)


def test_single_precision_is_summed_in_double():
    """NumPy would sum in single precision, while numba takes the literal as double precision."""

    @kernel
    def mean(pair):
        total = 0.0
        for value in pair.values:
            total += 0.1 * value
        return pair.factor * total / len(pair.values), len(pair.values), total > 1.0

    values = np.random.default_rng(1).random(1000).astype(np.float32)
    first, second = in_both_ways(mean, Pair(values, 3.0))
    assert first == second
    assert [type(one) for one in first] == [type(one) for one in second]


def test_integers_wrap():
    @kernel
    def mixed(seed, n):
        word = seed
        for _ in range(n):
            word = (word ^ (word >> np.uint64(29))) * np.uint64(0xBF58476D1CE4E5B9)
        return word

    first, second = in_both_ways(mixed, np.uint64(12345), 7)
    assert first == second


def test_a_kernel_that_others_include_is_run_by_python_too():
    @kernel
    def half(value):
        return 0.5 * value

    @kernel
    def quarter(value):
        return half(half(value))

    assert quarter(2.0) == 0.5
    (before,) = half.overloads.values()
    with interpreted(lambda: True):
        assert half(3.0) == 1.5
    assert next(iter(half.overloads.values())) is before
    assert half(3.0) == 1.5
    assert next(iter(half.overloads.values())) is not before


def test_what_python_cannot_do_is_compiled():
    """Python raises an error for the root of -1; arrays that it had changed are restored."""

    @kernel
    def root(values, out):
        for i in range(len(values)):
            out[i] += 1
            values[i] = math.sqrt(values[i])

    values, out = np.array([4.0, -1.0]), np.zeros(2)
    with interpreted(lambda: True):
        root(values, out)
    assert root in interpret._ABANDONED
    np.testing.assert_array_equal(values, [2.0, np.nan])
    np.testing.assert_array_equal(out, [1.0, 1.0])


def counter():
    """A kernel that takes Python seconds and reports each step."""

    @kernel
    def add(out, n):
        out[0] += n

    @kernel
    def count(times, out):
        for _ in range(times):
            add(out, 1)

    return count


def test_what_takes_python_long_is_compiled(monkeypatch):
    """It is compiled at once if no other process does it; arrays that were written to are
    restored."""
    monkeypatch.setattr(interpret, "PATIENCE", 0.01)
    monkeypatch.setattr(interpret, "LOOK", 0.01)
    count, out = counter(), np.zeros(1, np.int64)
    with interpreted(lambda: False):
        count(10**8, out)
    assert (out[0], len(count.overloads)) == (10**8, 1)


def test_compiled_code_is_taken_as_soon_as_it_is_there(monkeypatch):
    monkeypatch.setattr(interpret, "LOOK", 0.01)
    count, out = counter(), np.zeros(1, np.int64)
    looks = iter([False, False])
    monkeypatch.setattr(KernelDispatcher, "holds", lambda *_: next(looks, True))
    with interpreted(lambda: True):
        count(10**8, out)
    assert out[0] == 10**8


def test_an_alarm_of_the_caller_stays():
    """The caller's alarm also stays while Python runs a kernel."""
    handler = signal.getsignal(signal.SIGALRM)

    @kernel
    def twice(x):
        return 2 * x

    with interpreted(lambda: True):
        signal.setitimer(signal.ITIMER_REAL, 1000.0)
        assert twice(2.0) == 4.0
        assert signal.setitimer(signal.ITIMER_REAL, 0.0)[0] > 900
    assert signal.getsignal(signal.SIGALRM) is handler


def test_elsewhere_kernels_are_compiled():
    @kernel
    def twice(x):
        return 2 * x

    assert twice(2.0) == 4.0
    assert isinstance(twice, KernelDispatcher)
    assert len(twice.overloads) == 1


def test_the_images_of_a_field_are_summed_in_the_same_order():
    """Equal to the bit, also beyond the nodes."""
    rng = np.random.default_rng(1)
    nodes = np.linspace(0, 511, 6), np.linspace(0, 511, 5), np.array([4e-7, 5e-7, 7e-7])
    places = *rng.uniform(-20, 540, (2, 50)), rng.uniform(3e-7, 9e-7, 50)
    value = rng.standard_normal((3, 5, 6, 8))
    found = np.zeros((2, 50, 8))
    field_psf._add_near(value, *nodes, *places, found[0])
    field_psf._add_near_of_arrays(value, *nodes, *places, found[1])
    np.testing.assert_array_equal(*found)
