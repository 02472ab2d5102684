"""Who waits for kernels to be compiled is told so once; who does not is told nothing."""

import sys

import pytest
from numba import njit

from startrack.cli import compiling


@pytest.fixture
def kernel():
    @njit
    def inner(x):
        return x + 1

    return njit(lambda x: 2 * inner(x))


def test_a_person_is_told_once(monkeypatch, capsys, kernel):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(compiling, "PATIENCE", 0.0)
    with compiling.told_of_compiling():
        assert kernel(1) == 4
        assert kernel(1.0) == 4.0
    assert capsys.readouterr().err.splitlines() == [compiling.WORD]


def test_nothing_is_said_of_what_is_compiled_already(monkeypatch, capsys, kernel):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(compiling, "PATIENCE", 0.0)
    kernel(1)
    with compiling.told_of_compiling():
        kernel(1)
    assert not capsys.readouterr().err


def test_nothing_is_said_of_what_is_quick(monkeypatch, capsys, kernel):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with compiling.told_of_compiling():
        kernel(1)
    assert not capsys.readouterr().err


def test_a_log_is_not_spoken_to(monkeypatch, capsys, kernel):
    monkeypatch.setattr(compiling, "PATIENCE", 0.0)
    with compiling.told_of_compiling():
        kernel(1)
    assert not capsys.readouterr().err
