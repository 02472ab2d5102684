"""Messages of a running campaign."""

import json
import os
import shutil
import subprocess
import traceback
from concurrent.futures import Future
from importlib import import_module

import numpy as np
import pytest

from startrack.core import Refused
from startrack.core.checks import whole
from startrack.core.units import arcsec
from startrack.montecarlo.resume import (
    FIRST_TEST,
    MOST_FAILURES,
    Precision,
    Watch,
    half_width,
    last_words,
    resume,
)
from startrack.montecarlo.store import Store
from startrack.montecarlo.workers import Serial


class Fake(Serial):
    """Answers blocks of trials with made outcomes: the campaign's own work without the chain."""

    def __init__(self, outcomes, fails=(), most=10**9):
        self.outcomes, self.fails, self.left, self.asked = outcomes, fails, most, []

    def submit(self, fn, /, *args, **kwargs):
        numbers = args[2]
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        self.asked.append(numbers)
        future = Future()
        if set(numbers) & set(self.fails):
            future.set_exception(ZeroDivisionError(f"in one of {numbers}"))
        else:
            future.set_result(self.outcomes[numbers.start : numbers.stop].copy())
        return future


@pytest.fixture
def store(case):
    with Store(None, case, 3) as one:
        yield one


def test_a_trial_is_done_once_whatever_is_asked(store, outcomes):
    table = outcomes(1000)
    executor = Fake(table)
    for trials, block in ((100, 64), (70, 64), (500, 64), (1000, 33)):
        got = resume(store, executor, 1, trials, block=block)
        assert got.tobytes() == table[:trials].tobytes()
    asked = np.concatenate([np.array(numbers) for numbers in executor.asked])
    np.testing.assert_array_equal(np.sort(asked), np.arange(1000))


def test_an_interrupt_keeps_what_is_done(store, outcomes):
    table = outcomes(640)
    with pytest.raises(KeyboardInterrupt):
        resume(store, Fake(table, most=4), 1, 640)
    assert len(store.outcomes()) == 4 * 64
    assert resume(store, Fake(table), 1, 640).tobytes() == table.tobytes()


def test_a_campaign_that_was_cut_short_stops_at_the_same_trial(case, store, outcomes):
    table = outcomes(20_000)
    precision = Precision(0.03)
    once = resume(store, Fake(table), 1, 20_000, precision)
    assert half_width(precision.interval(once)) <= 0.03
    assert FIRST_TEST < len(once) < 5000
    with Store(None, case, 3) as other:
        while True:
            try:
                again = resume(other, Fake(table, most=3), 1, 20_000, precision)
                break
            except KeyboardInterrupt:
                continue
        assert again.tobytes() == once.tobytes()
        assert other.done() == store.done()


def test_a_block_that_fails_always_is_recorded_and_the_rest_goes_on(store, outcomes):
    table = outcomes(640)
    executor = Fake(table, fails={130})
    got = resume(store, executor, 1, 640)
    assert executor.asked.count(range(128, 192)) == 3
    assert len(got) == 640 - 64
    ((numbers, report),) = store.failures()
    assert numbers == range(128, 192)
    assert "ZeroDivisionError: in one of range(128, 192)" in report
    assert len(resume(store, Fake(table), 1, 640)) == 640
    assert store.failures() == []


def test_too_many_failures_end_the_run(store, outcomes):
    table = outcomes(6400)
    with pytest.raises(ValueError, match=f"more than {MOST_FAILURES} blocks of trials failed"):
        resume(store, Fake(table, fails=range(0, 6400, 64)), 1, 6400)
    assert len(store.failures()) == MOST_FAILURES + 1


def test_a_campaign_of_nothing_but_failures_says_why(store, outcomes):
    with pytest.raises(ValueError, match=r"all trials failed: (.|\n)*ZeroDivisionError"):
        resume(store, Fake(outcomes(8), fails=range(8)), 1, 8)


def test_the_time_budget_ends_it(store, outcomes):
    assert len(resume(store, Fake(outcomes(64)), 1, 64, seconds=1e-9)) == 0


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes_and_survives_a_kill(store):
    """The executor of Dask with two processes, one of which is killed when it has begun."""
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    from startrack.montecarlo.run import run
    from startrack.montecarlo.workers import dask_pool

    alone = run(store.case, 128, 3, Serial())
    workers = distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with workers as cluster, dask_pool(cluster.scheduler_address) as executor:
        victim = executor.submit(os.getpid).result()
        done = []

        def kill(trials):
            if not done:
                os.kill(victim, 9)
            done.append(trials)

        got = resume(store, executor, 2, 128, block=8, progress=kill)
    assert got.tobytes() == alone.tobytes()
    assert sum(done) == 128


def test_workers_of_another_version_are_refused():
    from startrack.montecarlo.workers import require_same_versions, versions

    require_same_versions({"a": versions(), "b": versions()})
    other = versions() | {"numba": "0.1"}
    with pytest.raises(ValueError, match=r"worker b must have numba .*, as here, got 0\.1"):
        require_same_versions({"a": versions(), "b": other})
    with pytest.raises(ValueError, match=r"worker b must have startrack .*, got none"):
        require_same_versions({"b": {}})


def pem(folder, *arguments):
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed")
def test_a_dask_cluster_by_tls(tmp_path):
    """With a certificate of its authority; a client without one is refused."""
    distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")
    from startrack.montecarlo.workers import Certificates, dask_pool

    key = ("-newkey", "rsa:2048", "-nodes")
    pem(tmp_path, "req", "-x509", *key, "-subj", "/CN=a", "-keyout", "ca.key", "-out", "ca.pem")
    pem(tmp_path, "req", *key, "-subj", "/CN=b", "-keyout", "own.key", "-out", "own.csr")
    pem(
        tmp_path,
        "x509",
        "-req",
        "-in",
        "own.csr",
        "-CA",
        "ca.pem",
        "-CAkey",
        "ca.key",
        "-CAcreateserial",
        "-out",
        "own.pem",
    )
    files = Certificates(*(tmp_path / name for name in ("ca.pem", "own.pem", "own.key")))
    security = distributed.Security(
        tls_ca_file=str(files.authority),
        require_encryption=True,
        **{
            f"tls_{role}_{kind}": str(getattr(files, name))
            for role in ("client", "scheduler", "worker")
            for kind, name in (("cert", "certificate"), ("key", "key"))
        },
    )
    workers = distributed.LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        dashboard_address=":0",
        protocol="tls://",
        security=security,
    )
    with workers as cluster:
        assert cluster.scheduler_address.startswith("tls://")
        with dask_pool(cluster.scheduler_address, files) as executor:
            assert executor.submit(sum, (1, 2)).result() == 3
        with pytest.raises((TypeError, OSError, ValueError), match=r"(?i)tls|ssl|security"):
            dask_pool(cluster.scheduler_address).__enter__()


module = import_module("startrack.montecarlo.resume")  # which the function hides


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test moves."""

    class Clock:
        now = 100.0

    monkeypatch.setattr(module.time, "monotonic", lambda: Clock.now)
    return Clock


def test_it_tells_rate_statistic_and_remaining_time(case, outcomes, tmp_path, clock):
    table, shown, log = outcomes(1000, sigma=2 * arcsec), [], tmp_path / "new" / "log.jsonl"
    precision = Precision(0.02)
    with (
        Store(None, case, 3) as store,
        Watch(store, precision, 5000, lambda n, text: shown.append((n, text)), log) as watch,
    ):
        for first in (0, 500):
            store.keep(first, table[first : first + 500])
            clock.now += 10
            watch(500)
        clock.now += 0.1
        watch(0)  # too soon for another look
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["trials"] for line in lines] == [500, 1000, 1000]
    last = lines[1]
    assert last["trials_per_s"] == pytest.approx(50)
    interval = precision.interval(table)
    assert last["value"] == pytest.approx(interval.value / arcsec)
    assert last["low"] < 2 < last["high"]
    # 1.96 / (2 sqrt(n)) of an rms of two axes: 2 % takes 2401 trials, of which 1000 are done.
    assert last["remaining_s"] == pytest.approx(1400 / 50, rel=0.15)
    assert shown[1] == (
        500,
        f"50/s, across {last['value']:.3f} [{last['low']:.3f}, {last['high']:.3f}] arcsec",
    )
    assert shown[2] == (0, "")


def test_trials_that_failed_are_not_counted_as_done(case, outcomes, clock):
    with Store(None, case, 3) as store, Watch(store, Precision(0.1), 200, lambda *_: None) as watch:
        store.keep(0, outcomes(50))
        watch(50)
        store.keep_failure(range(50, 100), "why")
        watch(50)
        clock.now += 10
        values = watch.values()
    assert values["trials"] == 50
    assert values["trials_per_s"] == pytest.approx(5)


def test_what_is_not_known_yet_is_null(case, outcomes, clock):
    table = outcomes(3)
    table["solved"] = False
    table["error_x"] = np.nan
    with Store(None, case, 3) as store, Watch(store, Precision(0.1), 10, lambda *_: None) as watch:
        store.keep(0, table)
        values = watch.values()
    assert values["value"] is values["relative_half_width"] is None
    json.dumps(values, allow_nan=False)


def test_the_last_words_of_a_refusal_are_its_sentence():
    try:
        whole(1, 3, stars=5)
    except Refused:
        words = last_words(traceback.format_exc())
    assert words == "stars must be a whole number in [1, 3], got 5"
