import errno
import multiprocessing
import os
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

import numpy as np
import pytest

from startrack.metrics import summarise
from startrack.montecarlo.run import blocks, run
from startrack.montecarlo.workers import Lasting, Recorded, Serial, pool
from startrack.trial.chain import OUTCOMES

SEED = 5


@pytest.fixture(scope="module")
def alone(small):
    with pool(1) as executor:
        return run(small.case, 30, SEED, executor)


@pytest.fixture(scope="module")
def of_two(small, blind):
    """A pool of two workers: the same trials, the workers' ids, and the error of a broken case."""
    with pool(2) as executor:
        outcomes = run(small.case, 30, SEED, executor, workers=2)
        workers = {executor.submit(os.getpid).result() for _ in range(8)}
        with pytest.raises(ValueError) as broken:
            run(blind, 2, SEED, executor)
    return outcomes, workers, broken.value


def test_one_and_two_workers_give_the_same_bytes(alone, of_two):
    assert of_two[0].tobytes() == alone.tobytes()


def test_order_and_blocks_do_not_matter(small, alone):
    with pool(1) as executor:
        late = run(small.case, 10, SEED, executor, first=20, workers=3)
    np.testing.assert_array_equal(late["trial"], np.arange(20, 30))
    assert late.tobytes() == alone[20:].tobytes()


def test_another_seed_gives_other_numbers(small, alone):
    with pool(1) as executor:
        other = run(small.case, 5, SEED + 1, executor)
    assert not np.isin(other["error_x"], alone["error_x"]).any()


def test_the_tracker_is_correct_and_states_its_error(alone):
    """All attitudes are found, with errors of some arcseconds, as large as stated."""
    summary = summarise(alone)
    assert summary.availability.value == 1
    assert summary.false.value == 0
    assert 0.1 < np.degrees(summary.across.value) * 3600 < 10
    assert summary.about.value > summary.across.value
    assert 0.7 < summary.nees < 12


def test_progress_counts_every_trial(small):
    counts: list[int] = []
    with pool(1) as executor:
        run(small.case, 7, SEED, executor, workers=2, progress=counts.append)
    assert sum(counts) == 7


def test_a_broken_case_says_so(blind, of_two):
    """The sentence of the error comes through, from this process and from others."""
    with pool(1) as executor, pytest.raises(ValueError, match="must overlap"):
        run(blind, 2, SEED, executor)
    assert "must overlap" in str(of_two[2])


def test_workers_end_with_the_pool(of_two):
    assert os.getpid() not in of_two[1]
    for pid in of_two[1]:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_no_trials_and_no_workers_are_refused(small):
    with pytest.raises(ValueError, match="trials must be a whole number"):
        run(small.case, 0, SEED, Serial())
    with pytest.raises(ValueError, match="workers must be a whole number"), pool(0):
        pass


def test_one_worker_does_what_is_asked_for_when_it_is_asked_for():
    """So that a progress bar moves: an executor of the standard library would do all trials
    first."""
    done = []
    results = Serial().map(done.append, range(3))
    assert done == []
    next(results)
    assert done == [0]


def test_outcomes_hold_every_field():
    assert OUTCOMES.names is not None
    assert {"trial", "error_x", "nees", "solved", "false"} <= set(OUTCOMES.names)


@pytest.mark.slow  # the block that kills its workers has them replaced, too
def test_a_worker_that_is_killed_is_replaced(small, alone):
    with pool(2) as executor:
        victims = [executor.submit(os.getpid).result()]

        def kill(_):
            if victims:
                os.kill(victims.pop(), 9)

        both = run(small.case, 30, SEED, executor, workers=2, progress=kill)
    assert not victims
    assert both.tobytes() == alone.tobytes()


def deadly(numbers):
    """In a worker: trial 35 kills it."""
    if 35 in numbers:
        os._exit(1)
    return np.zeros(len(numbers), OUTCOMES)


class Poisoned(Lasting):
    """A pool of real processes, one block of which is deadly.

    They are forks of one process that has imported what they need, so that new ones are quick.
    """

    def _fresh(self):
        multiprocessing.get_context("forkserver").set_forkserver_preload([__name__])
        self._context = Recorded("forkserver")
        return ProcessPoolExecutor(self._workers, mp_context=self._context)

    def submit(self, fn, /, *args, **kwargs):
        return super().submit(deadly, args[2])


@pytest.mark.skipif(sys.platform == "win32", reason="needs processes that fork")
def test_only_the_block_that_kills_its_workers_is_given_up(small):
    plan = [range(at, at + 10) for at in range(0, 100, 10)]
    with Poisoned(2) as executor:
        done = dict(blocks(small.case, SEED, plan, executor, workers=2))
    assert set(done) == set(plan)
    assert [one for one in plan if isinstance(done[one], Exception)] == [range(30, 40)]


@pytest.mark.parametrize("error", [OSError(errno.EBADF, os.strerror(errno.EBADF)), EOFError()])
def test_a_pool_that_breaks_while_it_starts_a_process_is_replaced(monkeypatch, error):
    """If its queues were closed between the death of a worker and the start of another."""

    def closed(self, *_, **__):
        monkeypatch.undo()
        raise error

    monkeypatch.setattr(ProcessPoolExecutor, "submit", closed)
    with pool(2) as executor:
        assert executor.submit(abs, -3).result() == 3


def test_a_pool_that_is_killed_with_cancelled_calls_ends_without_a_traceback(monkeypatch):
    raised = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    executor = Lasting(1)
    calls = [executor.submit(time.sleep, 60) for _ in range(6)]
    while not calls[0].running():
        time.sleep(0.01)
    assert calls[-1].cancel()
    executor.kill()
    executor.shutdown()
    assert raised == []
    assert isinstance(calls[0].exception(), BrokenExecutor)
