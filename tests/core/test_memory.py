"""Memory is estimated, refused with the figure and the limit, and limited by the system."""

import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from startrack.cli.options import WrongUse, memory_of, memory_size
from startrack.core.memory import GIB, limited_memory, memory_limit, require_memory


def test_a_step_that_needs_too_much_is_refused_with_figure_and_limit(monkeypatch):
    monkeypatch.setenv("STARTRACK_MEMORY", str(2 * GIB))
    require_memory(2 * GIB, "a small thing")
    words = r"^a frame would need 3\.5 GiB of memory, more than the limit of 2 GiB \(option --mem"
    with pytest.raises(ValueError, match=words):
        require_memory(3.5 * GIB, "a frame")
    with pytest.raises(ValueError, match="a PSF would need"):
        require_memory(float("nan"), "a PSF")


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux's limit of data")
def test_what_has_no_estimate_ends_in_memory_error_and_the_limit_ends_with_it():
    before = os.environ.get("STARTRACK_MEMORY")
    with limited_memory(GIB):
        assert memory_limit() == GIB
        with pytest.raises(MemoryError):
            np.ones(GIB // 4)
    assert os.environ.get("STARTRACK_MEMORY") == before
    assert len(np.empty(GIB // 4)) == GIB // 4


@pytest.mark.parametrize(
    ("given", "workers", "expected"),
    [("8G", 1, 8 * GIB), ("8G", 4, 2 * GIB), ("8G", 64, GIB), ("800M", 2, 800 * 2**20)],
)
def test_processes_share_the_limit_down_to_what_each_needs(given, workers, expected):
    options = SimpleNamespace(memory=memory_size(given), workers=workers)
    assert memory_of(options, 99 * GIB) == expected


def test_a_frame_too_large_for_the_memory_is_refused_before_it_is_made(monkeypatch, small):
    import dataclasses

    from startrack.trial import run_random_trial

    monkeypatch.setenv("STARTRACK_MEMORY", str(GIB))
    detector = dataclasses.replace(small.case.instrument.detector, columns=2**15, rows=2**15)
    instrument = dataclasses.replace(small.case.instrument, detector=detector)
    case = dataclasses.replace(small.case, instrument=instrument)
    with pytest.raises(ValueError, match=r"would need .* GiB of memory, more than the limit of 1"):
        run_random_trial(case, 1, 0)


def test_a_limit_that_is_no_number_is_refused(monkeypatch):
    for value in ("4G", "-1", "1e9", "1" * 40):
        monkeypatch.setenv("STARTRACK_MEMORY", value)
        with pytest.raises(ValueError, match=r"STARTRACK_MEMORY must be a whole number of bytes"):
            memory_limit()


def test_a_limit_that_no_process_can_do_with_is_refused():
    with pytest.raises(WrongUse, match=r"STARTRACK_MEMORY must be at least 536870912 .*, got 1"):
        memory_of(SimpleNamespace(memory=0), 1)
    assert memory_of(SimpleNamespace(memory=0), 8 * GIB) == 8 * GIB
