"""What a campaign says of itself while it runs."""

import json

import numpy as np
import pytest

from startrack.core.units import arcsec
from startrack.montecarlo import watch as module
from startrack.montecarlo.precision import Precision
from startrack.montecarlo.store import Store
from startrack.montecarlo.watch import Watch


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
    assert shown[1] == (500, f"50/s, across {last['value']:.3f} "
                            f"[{last['low']:.3f}, {last['high']:.3f}] arcsec")  # fmt: skip
    assert shown[2] == (0, "")


def test_trials_that_failed_are_not_counted_as_done(case, outcomes, clock):
    with (
        Store(None, case, 3) as store,
        Watch(store, Precision(0.1), 200, lambda *_: None) as watch,
    ):
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
    with (
        Store(None, case, 3) as store,
        Watch(store, Precision(0.1), 10, lambda *_: None) as watch,
    ):
        store.keep(0, table)
        values = watch.values()
    assert values["value"] is values["relative_half_width"] is None
    json.dumps(values, allow_nan=False)
