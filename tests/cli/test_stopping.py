"""Every exception of a command becomes one sentence and an exit status."""

import signal
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool

import pytest

from startrack.cli import stopping
from startrack.cli.main import main
from startrack.cli.options import WrongUse
from startrack.io import shipped
from startrack.montecarlo import Serial


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (WrongUse("a must be b,\ngot c"), 2, "a must be b, got c"),
        (ValueError("no\x00 \udcff"), 1, "no? ?"),
        (OSError(2, "No such file", "x\udcffy"), 1, "x"),
        (ImportError("needs astropy"), 1, "needs astropy"),
        (MemoryError("Unable to allocate 9 PiB"), 1, "more memory is needed than the limit of"),
        (BrokenProcessPool("died"), 1, "a worker process died"),
        (KeyboardInterrupt(), 130, "stopped; no file is left half-written"),
        (stopping.Stopped(signal.SIGTERM), 143, "stopped by SIGTERM; no file"),
        (ZeroDivisionError("division by zero"), 1, "unexpected ZeroDivisionError: division by z"),
        (KeyError("seed"), 1, "unexpected KeyError: no 'seed'"),
    ],
)
def test_what_is_raised_is_told(error, status, words):
    got, message = stopping.status_and_sentence(error)
    assert got == status
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "words",
    [
        ["optimize"],
        ["optimize", "--scheduler", "tcp://here:1"],
        ["verify"],
        ["verify", "--units", "4"],
        ["montecarlo"],
    ],
)
def test_a_design_without_its_extra_leaves_no_folder(words, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "radbelt", None)  # as where it is not installed
    monkeypatch.setattr("startrack.cli.campaign.cluster", lambda *_: Serial())
    age = ("altitude=613 km", "inclination=98 deg", "shielding=5 mm")
    changes = [part for key in age for part in ("--set", f"instrument.detector.age.{key}")]
    command = [*words, str(shipped("designs/nanosatellite.toml")), "--out", str(tmp_path / "out")]
    assert main([*command, "--workers", "1", *changes]) == 1
    assert "pip install 'startrack[radiation]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_error_that_a_signal_became_is_that_signal(capsys, monkeypatch):
    """Drawing code in C++ reports "Invalid bounding box" if a signal is raised while it reads an
    array."""
    import startrack.cli.requirements as command

    def interrupted():
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt:
            raise ValueError("Invalid bounding box") from None

    monkeypatch.setattr(command, "example", interrupted)
    assert main(["requirements"]) == 143
    assert "requirements: stopped by SIGTERM; no file is left" in capsys.readouterr().err


@pytest.mark.parametrize("debug", [False, True])
def test_a_traceback_is_printed_with_debug_only(capsys, monkeypatch, debug):
    import startrack.cli.requirements as command

    def broken():
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(command, "example", broken)
    assert main(["requirements", *["--debug"] * debug]) == 1
    err = capsys.readouterr().err
    assert ("Traceback" in err) == debug
    assert err.splitlines()[-1].startswith("startrack requirements: cli/requirements.py, line ")


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals between processes")
def test_a_signal_that_python_discards_is_raised_again_and_one_after_the_end_is_not_heard():
    code = """
import atexit, os, signal, sys, time
from startrack.cli import keys
from startrack.cli.main import main

class Gone:
    def __del__(self):  # what is raised here, Python discards
        os.kill(os.getpid(), kind)

def discarding(options):
    Gone()
    time.sleep(30)
    return 0

def heard():
    # They may be ignored in the background, and the end of a command ignores both.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)

kinds = signal.SIGINT, signal.SIGTERM
sys.argv = ["startrack", "keys", "scene.orbit", "--json"]
sys.modules["startrack.cli.main"].postpone = lambda: None  # a file that is run again loses this
command, keys.command = keys.command, discarding
for kind in kinds:
    heard()
    print(main())
for kind in kinds:
    atexit.register(os.kill, os.getpid(), kind)
keys.command = command
heard()
sys.exit(main())
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=70)
    lines = ended.stdout.splitlines()
    assert (ended.returncode, *lines[:2]) == (0, "130", "143")
    assert lines[2].startswith("{")
    lines = ended.stderr.splitlines()
    assert ["stopped" in line for line in lines] == [True, True]


def test_an_object_that_a_signal_left_half_deleted_says_nothing(capfd):
    class Half:
        def __del__(self):
            raise AttributeError("no _as_parameter_")

    def delete():
        Half()

    with stopping.stopped_by_signals():
        delete()
    assert "no _as_parameter_" in capfd.readouterr().err
    with stopping.stopped_by_signals() as signals:
        signals.append(signal.SIGTERM)
        delete()
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(sys.platform == "win32", reason="there are no alarms")
def test_an_alarm_is_the_callers():
    heard = []
    before = signal.signal(signal.SIGALRM, lambda *_: heard.append("alarm"))
    try:
        with stopping.stopped_by_signals():
            signal.raise_signal(signal.SIGALRM)
        signal.raise_signal(signal.SIGALRM)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert heard == ["alarm", "alarm"]


@pytest.mark.parametrize(
    ("words", "streams", "status", "sentence"),
    [
        ("--help", ">&-", 1, "standard output must be open"),
        ("--help", ">/dev/full", 1, "No space left on device"),
        ("keys --help", "2>&- >/dev/null", 0, ""),
        ("nonsense", "2>/dev/full", 2, ""),
        pytest.param("keys nonsense", "2>/dev/full", 2, "", marks=pytest.mark.slow),
        pytest.param("keys", ">/dev/full", 1, "No space left on device", marks=pytest.mark.slow),
        ("keys", ">&- 2>&-", 1, ""),
    ],
)
def test_closed_and_full_streams_have_a_status(words, streams, status, sentence):
    line = f"{sys.executable} -m startrack.cli {words} {streams}"
    ended = subprocess.run(["sh", "-c", line], capture_output=True, text=True)
    assert ended.returncode == status
    assert sentence in ended.stderr
    assert "Error" not in ended.stderr
    assert len(ended.stderr.splitlines()) == bool(sentence)
