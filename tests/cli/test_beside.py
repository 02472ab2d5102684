"""Kernels that another process compiles while a command runs."""

import subprocess

import pytest

from startrack.cli import beside
from startrack.core import interpret


class Process:
    """A process that compiles until it is terminated."""

    started: list["Process"]

    def __init__(self, command, pass_fds=(), **options):
        assert options["stdin"] == subprocess.DEVNULL
        self.parts = command[command.index("warm") + 1 :][1::2]
        self.ended = None
        Process.started.append(self)

    def poll(self):
        return self.ended

    def terminate(self):
        self.ended = -15

    def wait(self):
        return self.ended


@pytest.fixture(autouse=True)
def nothing_is_compiled(monkeypatch, tmp_path):
    monkeypatch.setattr(Process, "started", [], raising=False)
    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setattr(beside, "is_ready", lambda: False)
    monkeypatch.setattr(beside, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 2)


def test_a_command_of_one_trial_goes_on_and_leaves_the_compiling_to_end():
    with beside.compiled_beside("solve"):
        [process] = Process.started
        assert interpret._COMPILING is not None
    assert interpret._COMPILING is None
    assert process.parts == ["identification", "fidelity frame"]
    assert process.ended is None
    assert process is beside.CONTINUING.pop()


def test_for_other_commands_another_process_compiles_the_identification_and_is_ended():
    with beside.compiled_beside("optimize"):
        [process] = Process.started
        assert interpret._COMPILING is None
    assert process.parts == ["identification"]
    assert process.ended == -15


def test_one_process_compiles_for_all_commands(tmp_path):
    if beside.fcntl is None:
        pytest.skip("without locks each command starts one")
    held = beside._held(
        tmp_path / beside.LOCK, close=False
    )  # as the process that another command has started
    with beside.compiled_beside("simulate"):
        assert interpret._COMPILING()
        beside.os.close(*held)
        assert not interpret._COMPILING()
    held = beside._held(tmp_path / beside.LOCK, close=False)
    with beside.compiled_beside("optimize"):
        pass
    beside.os.close(*held)
    assert not Process.started


def test_nothing_is_started_where_all_is_compiled(monkeypatch):
    monkeypatch.setattr(beside, "is_ready", lambda: True)
    for command in ("simulate", "optimize"):
        with beside.compiled_beside(command):
            assert interpret._COMPILING is None
    assert not Process.started


def test_where_nothing_can_be_kept_python_saves_each_run_the_compiling(monkeypatch):
    monkeypatch.setattr(beside, "kernel_folder", lambda: None)
    with beside.compiled_beside("simulate"):
        assert interpret._COMPILING() is False
    assert not Process.started
