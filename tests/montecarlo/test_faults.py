"""Campaigns as commands under faults of their surroundings."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from startrack.cli.main import main
from startrack.core import Refused
from startrack.design import Fidelity, Variation
from startrack.detector import Hits
from startrack.io import shipped
from startrack.montecarlo.resume import resume
from startrack.montecarlo.run import run, warm
from startrack.montecarlo.sampling import Sampling
from startrack.montecarlo.store import Store
from startrack.montecarlo.workers import Serial
from startrack.population import Units, yields

DESIGN = str(shipped("designs/noise_only.toml"))
COMMAND = (sys.executable, "-m", "startrack.cli", "montecarlo", DESIGN)


def test_the_log_and_the_summary_agree(tmp_path, capsys):
    log = tmp_path / "log.jsonl"
    arguments = ["--trials", "40", "--workers", "1", "--fidelity", "window", "--json"]
    assert main(["montecarlo", *arguments, "--log", str(log)]) == 0
    shown = json.loads(capsys.readouterr().out)
    last = json.loads(log.read_text().splitlines()[-1])
    assert last["trials"] == shown["trials"] == 40
    assert last["value"] == pytest.approx(shown["across_rms_arcsec"])
    assert [last["low"], last["high"]] == pytest.approx(shown["across_rms_arcsec_95"])


@pytest.mark.slow
def test_two_processes_on_one_store_are_shown_apart(tmp_path):
    """The second ends with one sentence while the first continues and keeps its trials."""
    store = tmp_path / "campaign.sqlite"
    command = [*COMMAND, "--store", str(store), "--trials", "1000000", "--workers", "1"]
    first = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, preexec_fn=as_at_a_terminal
    )
    try:
        while not store.exists() or not store.stat().st_size:
            time.sleep(0.02)
        second = subprocess.run(command, capture_output=True, text=True)
        assert second.returncode == 1
        assert f"is in use by another process, {first.pid} on " in second.stderr
        while not done(store):
            time.sleep(0.1)
        first.send_signal(signal.SIGINT)
        assert first.wait(60) == 130
    finally:
        first.kill()
        first.wait()
    with Store(store) as held:
        assert len(held.outcomes()) > 0


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_read_only_folder_ends_clearly(case):
    """As a user without write permission: one sentence, and no files."""
    # Not in pytest's own folder, which each pytest that starts closes to other users.
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        os.seteuid(65534)
        try:
            with pytest.raises(OSError, match="cannot be written: unable to open database file"):
                Store(folder / "campaign.sqlite", case, 1)
        finally:
            os.seteuid(0)
        assert list(folder.iterdir()) == []


@pytest.mark.skipif(os.geteuid() != 0 or sys.platform != "linux", reason="needs to mount")
def test_a_disk_that_fills_up_ends_clearly_and_loses_nothing(tmp_path, case, outcomes):
    """A real file system of 300 kB; after space is freed the campaign continues to the same
    bytes."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(disk)], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("this machine does not let a test mount a file system")
    table, path = outcomes(6400), disk / "campaign.sqlite"
    try:
        with Store(path, case, 3) as store, pytest.raises(OSError, match="what it held is whole"):
            fill(store, table)
        kept = shutil.copy(path, tmp_path / "copy.sqlite")
        for log in disk.glob("*-wal"):
            shutil.copy(log, tmp_path / f"copy.sqlite{log.name.removeprefix(path.name)}")
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)
    with Store(Path(kept), case, 3) as store:
        held = len(store.outcomes())
        assert held > 500
        assert store.outcomes().tobytes() == table[:held].tobytes()
        fill(store, table[held:])
        assert store.outcomes().tobytes() == table.tobytes()


def fill(store, table):
    for at in range(0, len(table), 64):
        store.keep(int(table["trial"][at]), table[at : at + 64])


def test_the_time_budget_does_not_follow_the_wall_clock(case, outcomes, monkeypatch):
    """A wall clock that jumps by years in both directions neither ends nor prolongs the
    campaign."""
    years = iter([1e9, -1e9] * 1000)
    monkeypatch.setattr(time, "time", lambda: next(years))
    now = iter(range(1000))
    clock = import_module("startrack.montecarlo.resume").time
    monkeypatch.setattr(clock, "monotonic", lambda: next(now))

    class Made(Serial):
        def submit(self, fn, /, *args, **kwargs):
            numbers = args[2]
            return super().submit(lambda: outcomes(len(numbers), first=numbers.start))

    with Store(None, case, 3) as store:
        got = resume(store, Made(), 1, 100_000, seconds=20, block=10)
    assert 10 * 10 <= len(got) <= 20 * 10


@pytest.mark.slow
def test_ctrl_c_ends_clearly_and_nothing_is_lost(tmp_path):
    store = tmp_path / "campaign.sqlite"
    command = [*COMMAND, "--store", str(store), "--trials", "1000000", "--workers", "2"]
    command += ["--fidelity", "covariance"]  # whose trials are the quickest
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        preexec_fn=as_at_a_terminal,
    )
    try:
        while not done(store):
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        _, shown = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert shown.strip().endswith("stopped; no file is left half-written")
    assert "Traceback" not in shown
    with Store(store) as held:
        outcomes = held.outcomes()
        again = run(held.case, 20, held.seed, Serial(), fidelity=held.sampling.fidelity)
    by_number = {int(row["trial"]): row.tobytes() for row in outcomes}
    assert len(by_number) == len(outcomes) > 0
    for row in again:
        assert by_number.get(int(row["trial"]), row.tobytes()) == row.tobytes()


def as_at_a_terminal():
    """Ctrl-C acts, also if the tests themselves run in the background of a shell."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def done(store):
    """Number of blocks that a running campaign has kept, read despite its writer's lock."""
    wal = store.with_name(store.name + "-wal")
    return wal.exists() and wal.stat().st_size > 60_000


@pytest.mark.slow
def test_mpi_gives_the_same_bytes(tmp_path):
    pytest.importorskip("mpi4py", reason="mpi4py is not installed")
    mpiexec = shutil.which("mpiexec")
    if not mpiexec:
        pytest.skip("there is no mpiexec")
    store = tmp_path / "campaign.sqlite"
    command = [
        mpiexec,
        "-n",
        "3",
        sys.executable,
        "-m",
        "mpi4py.futures",
        "-m",
        *COMMAND[2:],
        "--scheduler",
        "mpi",
        "--store",
        str(store),
        "--trials",
        "60",
    ]
    allowed = {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "PRTE_MCA_rmaps_default_mapping_policy": ":OVERSUBSCRIBE",
    }
    subprocess.run(command, check=True, env=os.environ | allowed, capture_output=True)
    with Store(store) as held:
        alone = run(held.case, 60, held.seed, Serial(), fidelity=held.sampling.fidelity)
        assert held.outcomes().tobytes() == alone.tobytes()


@pytest.mark.slow
def test_numba_compiles_once_before_the_workers_begin(tmp_path):
    """With an empty cache, two workers find all kernels of a trial there."""
    code = """
import sys
from numba.core.registry import CPUDispatcher
from startrack.io import shipped
from startrack.design import load_design
from startrack.montecarlo import pool, run, warm

def missed():
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("startrack"):
            for one in vars(module).values():
                if isinstance(one, CPUDispatcher):
                    found[id(one)] = sum(one.stats.cache_misses.values())
    return sum(found.values())

if __name__ == "__main__":
    case = load_design(shipped("designs/noise_only.toml")).case
    warm(case)
    with pool(2) as executor:
        run(case, 16, 1, executor, workers=2)
        print(missed(), max(executor.submit(missed).result() for _ in range(20)))
"""
    script = tmp_path / "cold.py"
    script.write_text(code)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=True
    )
    here, there = map(int, done.stdout.split())
    assert here > 20
    assert there == 0


def test_the_first_trial_of_a_unit_makes_no_plans_that_workers_make_again(case, monkeypatch):
    """The plans took 3 minutes of CPU for the shipped nanosatellite; those of a unit take 12 s."""
    made = list[float]()
    monkeypatch.setattr(yields, "unit_plans", lambda _, age: made.append(age))
    differing = replace(case, variation=(Variation("instrument.mounting.x", sigma="9 arcsec"),))
    warm(differing, Sampling(Fidelity.COVARIANCE, units=Units(2, 1)))
    assert not made
    crowded = Hits(1e8)
    detector = replace(case.instrument.detector, hits=crowded)
    hit = replace(differing, instrument=replace(case.instrument, detector=detector))
    with pytest.raises(Refused, match="hits"):
        warm(hit, Sampling(Fidelity.COVARIANCE, units=Units(2, 1)))


def test_a_store_that_is_damaged_says_so(tmp_path, case, outcomes):
    path = tmp_path / "campaign.sqlite"
    with Store(path, case, 3) as store:
        for first in range(0, 6400, 64):
            store.keep(first, outcomes(64, first=first))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="is damaged: database disk image is malformed"):
        Store(path).outcomes()
