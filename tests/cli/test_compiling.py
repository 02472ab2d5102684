"""One message where kernels are compiled for long; none otherwise."""

import sys

import pytest

from startrack import core
from startrack.cli import terminal


@pytest.fixture
def kernel():
    @core.kernel
    def inner(x):
        return x + 1

    return core.kernel(lambda x: 2 * inner(x))


def test_long_compiling_is_reported_once(monkeypatch, capsys, kernel):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(terminal, "LONG_COMPILING", 0.0)
    with terminal.report_compiling():
        assert kernel(1) == 4
        assert kernel(1.0) == 4.0
    assert capsys.readouterr().err.splitlines() == [terminal.COMPILING]


def test_compiled_kernels_are_not_reported(monkeypatch, capsys, kernel):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(terminal, "LONG_COMPILING", 0.0)
    kernel(1)
    with terminal.report_compiling():
        kernel(1)
    assert not capsys.readouterr().err


def test_short_compiling_is_not_reported(monkeypatch, capsys, kernel):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with terminal.report_compiling():
        kernel(1)
    assert not capsys.readouterr().err


def test_nothing_is_reported_in_a_log(monkeypatch, capsys, kernel):
    monkeypatch.setattr(terminal, "LONG_COMPILING", 0.0)
    with terminal.report_compiling():
        kernel(1)
    assert not capsys.readouterr().err
