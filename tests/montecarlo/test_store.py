import contextlib
import dataclasses
import json
import os
import resource
import shutil
import sqlite3
import subprocess
import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from astropy.io import fits

from startrack.design.case import Fidelity
from startrack.design.parameter import replaced
from startrack.design.structure import Structure
from startrack.io import shipped
from startrack.io.tables import to_table
from startrack.metrics import STATED_ALONE
from startrack.montecarlo.sampling import Sampling
from startrack.montecarlo.sketch import Sketch, about_of
from startrack.montecarlo.store import Store, export, fault
from startrack.optimise.runner import TrialRunner
from startrack.trial.chain import OUTCOMES


@pytest.fixture
def path(tmp_path):
    return tmp_path / "new" / "campaign.sqlite"


def test_what_is_kept_comes_back(path, case, outcomes):
    table = outcomes(100)
    with Store(path, case, 3) as store:
        store.keep(60, table[60:])  # out of order, as workers end
        store.keep(0, table[:60])
    with Store(path) as store:
        assert store.case == case
        assert store.seed == 3
        assert store.outcomes().tobytes() == table.tobytes()
        assert store.outcomes(70).tobytes() == table[:70].tobytes()
        assert store.done() == [range(60), range(60, 100)]
        ((_, origin),) = store.sessions()
        assert origin["numpy"] == np.__version__
    assert os.listdir(path.parent) == [path.name]  # the log is folded in


def test_a_damaged_session_is_said(path, case):
    Store(path, case, 3).close()
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute("UPDATE sessions SET origin = '{}'")
    with Store(path) as store, pytest.raises(ValueError, match="session 1 is not as it was"):
        store.sessions()
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute("DELETE FROM sessions")
    lost = pytest.raises(ValueError, match="session 1 is missing")
    with Store(path) as store, lost:
        store.sessions()
    with lost:  # before another session takes its place
        Store(path, case, 3)


def test_a_trial_is_kept_once(path, case, outcomes):
    with Store(path, case, 3) as store:
        store.keep(0, outcomes(10))
        with pytest.raises(OSError, match="UNIQUE"):
            store.keep(0, outcomes(10))
        store.keep(10, outcomes(10, first=10))
        assert len(store.outcomes()) == 20


def test_controls_are_kept_beside_outcomes(path, case, outcomes):
    """98 bytes a trial; a store from before controls were kept still opens."""
    sampling = Sampling(control=True)
    table = np.zeros(5, sampling.dtype)
    table[list(OUTCOMES.names)], table["surplus_about"] = outcomes(5), np.arange(5)
    with Store(path, case, 3, sampling) as store:
        store.keep(0, table)
    with Store(path) as store:
        assert store.sampling == sampling
        assert store.outcomes().tobytes() == table.tobytes()
    assert sampling.dtype.itemsize == 98
    old = path.with_name("old.sqlite")
    Store(old, case, 3).close()
    with contextlib.closing(sqlite3.connect(old)) as base, base:
        base.execute("DELETE FROM about WHERE name IN ('attitudes', 'control')")
        base.execute("DELETE FROM checksums")
    with Store(old, case, 3) as store:
        assert store.sampling == Sampling()


def test_a_failure_ends_when_its_block_is_done(path, case, outcomes):
    with Store(path, case, 3) as store:
        store.keep_failure(range(5), "Traceback: it failed")
        assert store.failures() == [(range(5), "Traceback: it failed")]
        store.keep(0, outcomes(5))
        assert store.failures() == []


def test_failures_do_not_outlive_their_trials_when_blocks_are_cut_anew(path, case, outcomes):
    """Two blocks fail; with other workers their trials are in blocks of another size."""
    with Store(path, case, 3) as store:
        store.keep_failure(range(25, 50), "one")
        store.keep_failure(range(50, 75), "two")
        store.keep_failure(range(25, 64), "again")
        assert store.failures() == [(range(25, 64), "again")]
        store.keep_failure(range(64, 75), "the rest")
        store.keep(25, outcomes(50, first=25))
        assert store.failures() == []


def test_another_case_seed_version_or_format_is_refused(path, case):
    Store(path, case, 3).close()
    slower = dataclasses.replace(
        case,
        instrument=dataclasses.replace(
            case.instrument, detector=dataclasses.replace(case.instrument.detector, exposure=0.123)
        ),
    )
    with pytest.raises(ValueError, match=r"another design: instrument\.detector\.exposure is '"):
        Store(path, slower, 3)
    with pytest.raises(ValueError, match="seed 3, not of seed 4"):
        Store(path, case, 4)
    with pytest.raises(ValueError, match="fidelity frame, not of fidelity window"):
        Store(path, case, 3, Sampling(Fidelity.WINDOW))
    with pytest.raises(ValueError, match="of fidelity frame, not of fidelity frame, Sobol att"):
        Store(path, case, 3, Sampling(attitudes="sobol"))
    for change, sentence in (
        ("UPDATE about SET value = '0.0.9' WHERE name = 'startrack'", r"startrack 0\.0\.9, which"),
        ("PRAGMA user_version = 99", "format 2, got format 99"),
        ("PRAGMA application_id = 7", "is another database"),
    ):
        with sqlite3.connect(path) as base:
            base.execute("DELETE FROM checksums")
            base.execute(change)
        base.close()
        with pytest.raises(ValueError, match=sentence):
            Store(path, case, 3)


def test_files_that_are_no_store_are_refused_and_left_alone(tmp_path, case):
    text = tmp_path / "text"
    text.write_text("many words, " * 1000)
    with pytest.raises(ValueError, match="must be a campaign store, but is not one"):
        Store(text, case, 3)
    assert text.read_text() == "many words, " * 1000
    with pytest.raises(ValueError, match="but there is none"):
        Store(tmp_path / "none")
    (tmp_path / "empty").touch()
    with pytest.raises(ValueError, match="but is empty"):
        Store(tmp_path / "empty")
    with pytest.raises(OSError, match="cannot be written: unable to open"):
        Store(tmp_path, case, 3)


def test_two_processes_on_one_store_are_refused(path, case):
    """While it is open; the same process opens it afterwards."""
    code = (
        "import pathlib\nfrom startrack.montecarlo.store import Store\n"
        f"path = pathlib.Path({str(path)!r})\n"
        "try:\n    Store(path)\n    print('opened', flush=True)\n"
        "except OSError as error:\n    print(error, flush=True)\n"
        "input()\nStore(path)\n"
    )
    before = datetime.now(UTC)
    with Store(path, case, 3):
        other = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        words = other.stdout.readline()
    held = path.with_name(f"{path.name}-process").exists()
    other.communicate("now\n")
    assert other.returncode == 0
    assert f"is in use by another process, {os.getpid()} on " in words
    since = datetime.fromisoformat(words.split(" since ")[1].strip())
    assert timedelta(0) <= since - before.replace(microsecond=0) < timedelta(hours=1)
    assert not held


def test_a_full_disk_ends_clearly_and_loses_nothing(path, case, outcomes):
    """A limit on the size of files replaces a full disk: the system refuses to write."""

    def fill(store):
        for first in range(0, 10_000, 100):
            store.keep(first, outcomes(100, first=first))

    with Store(path, case, 3) as store:
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limits[1]))
        try:
            with pytest.raises(OSError, match=r"cannot be written: .*; what it held is whole"):
                fill(store)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        kept = len(store.outcomes())
    assert kept > 500
    with Store(path) as store:
        np.testing.assert_array_equal(store.outcomes()["trial"], np.arange(kept))


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is read-only for root")
def test_a_read_only_folder_is_said(tmp_path, case):
    tmp_path.chmod(0o500)
    with pytest.raises(OSError, match="cannot be written"):
        Store(tmp_path / "campaign.sqlite", case, 3)


def test_at_most_100_bytes_a_trial(path, case, outcomes):
    with Store(path, case, 3) as store:
        for first in range(0, 64_000, 64):
            store.keep(first, outcomes(64, first=first))
    assert path.stat().st_size / 64_000 <= 100


def test_the_design_is_kept_as_a_person_would_write_it(path, case):
    Store(path, case, 3).close()
    base = sqlite3.connect(path)
    (text,) = base.execute("SELECT value FROM about WHERE name = 'case'").fetchone()
    base.close()
    assert json.loads(text) == json.loads(json.dumps(to_table(case)))


def test_export(tmp_path, outcomes):
    table = outcomes(20)
    export(tmp_path / "trials.csv", table)
    again = np.genfromtxt(tmp_path / "trials.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(again["error_x"], table["error_x"])
    with pytest.raises(ValueError, match=r"\.csv or \.parquet, got trials\.doc"):
        export(tmp_path / "trials.doc", table)


def test_export_to_parquet(tmp_path, outcomes):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    table = outcomes(20)
    export(tmp_path / "trials.parquet", table)
    again = parquet.read_table(tmp_path / "trials.parquet")
    assert again.column_names == list(table.dtype.names)
    np.testing.assert_array_equal(again["error_x"].to_numpy(), table["error_x"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            "DELETE FROM about WHERE name = 'seed'",
            "none of its trials can be used: it lacks 'seed'",
        ),
        ("DELETE FROM about WHERE name = 'case'", "it lacks 'case'"),
        ("DELETE FROM about WHERE name = 'fields'", "it lacks 'fields'"),
        ("DELETE FROM about WHERE name = 'fidelity'", "it lacks 'fidelity'"),
        ("DELETE FROM about WHERE name = 'startrack'", "it lacks 'startrack'"),
        ("UPDATE about SET value = 'x'", "is damaged"),
        ("UPDATE about SET value = '4' WHERE name = 'seed'", "says of its trials is not as it was"),
        ("UPDATE about SET value = replace(value, ' ms', ' us')", "not as it was written"),
        ("DELETE FROM about WHERE name = 'attitudes'", "not as it was written"),
        (
            "UPDATE about SET value = replace(hex(zeroblob(50000)), '0', '[') WHERE name = 'case'",
            "is damaged",
        ),
        ("UPDATE about SET value = '[[\"trial\", \"O\"]]' WHERE name = 'fields'", "lack fields"),
        ("DROP TABLE blocks", "is damaged: no such table: blocks"),
        ("UPDATE blocks SET outcomes = 'text' WHERE first = 4", "1 of its 2 blocks.*4 trials are"),
        ("UPDATE blocks SET outcomes = zeroblob(8)", "2 of its 2 blocks .* 0 trials are whole"),
        ("UPDATE blocks SET outcomes = substr(outcomes, 9) || zeroblob(8)", "not as they were wri"),
        ("UPDATE blocks SET trials = 9223372036854775807", "0 trials are whole"),
        ("UPDATE blocks SET first = 1 WHERE first = 4", "1 of its 2 blocks"),
    ],
)
def test_contents_that_were_changed_are_damage(path, case, outcomes, change, words):
    with Store(path, case, 3) as store:
        store.keep(0, outcomes(4))
        store.keep(4, outcomes(4, first=4))
    with sqlite3.connect(path) as base:
        base.execute(change)
    base.close()
    with pytest.raises(ValueError, match=words), Store(path) as store:
        store.outcomes()


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("error_x", np.nan, "error_x"),
        ("error_z", 7.0, "error_z"),
        ("sigma_y", -1.0, "sigma_y"),
        ("stars", -1, "negative"),
        ("trial", 9, "other numbers"),
    ],
)
def test_outcomes_without_a_checksum_must_be_possible(outcomes, field, value, words):
    """As in stores from before checksums were kept."""
    table = outcomes(4)
    assert fault(0, 4, table.tobytes(), None, table.dtype) == ""
    table[field][2] = value
    assert words in fault(0, 4, table.tobytes(), None, table.dtype)


def test_a_store_without_checksums_is_read_and_not_continued(path, case, outcomes):
    """Stores of earlier versions have none; a newer one that has lost its checksums is damaged."""
    with Store(path, case, 3) as store:
        store.keep(0, outcomes(4))
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute("DROP TABLE checksums")
    with Store(path) as store, pytest.raises(ValueError, match=r"1 of its 1 blocks .* at trial 0"):
        store.outcomes()
    with contextlib.closing(sqlite3.connect(path)) as base, base:
        base.execute("DELETE FROM about WHERE name = 'inputs'")
        base.execute("UPDATE about SET value = '0.1.0' WHERE name = 'startrack'")
    with Store(path) as store:
        assert len(store.outcomes()) == 4
    with pytest.raises(ValueError, match=r"trials of startrack 0\.1\.0, which this startrack 0\.1"):
        Store(path, case, 3)


FILES = {
    "catalog.source": "stars/bright.fits",
    "tracker.catalog.source": "stars/bright.fits",
    "instrument.optics.lens_file": "lenses/double_gauss.fits",
    "instrument.optics.psf_file": "psfs/chandra-aca.fits",
}
NODES = "part,load,x,y,z,dx,dy,dz\n" + "".join(
    f"{part},mean,{x},{y},{z},{x / 1e5},{y / 1e5},0\n"
    for z, part in enumerate(("feet", "detector", "lens"))
    for x, y in ((1, 0), (0, 1), (-1, -1))
)


@pytest.mark.parametrize("key", [*FILES, "instrument.structure.displacements"])
def test_trials_of_another_content_of_a_file_are_not_mixed(path, case, tmp_path, key):
    """The same name and the same design, but a different content of the file."""
    file = tmp_path / "input.fits"
    file.write_bytes(shipped(FILES[key]).read_bytes() if key in FILES else NODES.encode())
    optics = dataclasses.replace(case.instrument.optics, psf="auto", blur=0.0)
    instrument = dataclasses.replace(case.instrument, optics=optics, structure=Structure())
    tracker = dataclasses.replace(case.tracker, catalog=case.catalog)
    case = dataclasses.replace(case, instrument=instrument, tracker=tracker)
    case = replaced(case, key, str(file))
    sketch = about_of(case, 3, Sampling(), STATED_ALONE)
    runner = TrialRunner(3)
    ledger = runner._key(case, Fidelity.FRAME, 0)
    Store(path, case, 3).close()
    Store(path, case, 3).close()
    assert replaced(case, key, str(file)) == case
    if key in FILES:
        with fits.open(file, mode="update", checksum=True) as parts:
            parts[0].header["NOTE"] = "another"
    else:
        file.write_text(NODES.replace("mean", "flux_x"))
    with pytest.raises(ValueError, match=rf"another content of {key} \S+input.fits: digest"):
        Store(path, case, 3)
    other = about_of(case, 3, Sampling(), STATED_ALONE)
    with pytest.raises(ValueError, match=rf"another campaign: inputs\.{key} .*input.fits is"):
        Sketch(sketch).add(Sketch(other))
    assert runner._key(case, Fidelity.FRAME, 0) != ledger
    assert replaced(case, key, str(file)) != case, "what is kept of the old content is not of it"


def test_a_failure_that_nobody_kept_is_damage(path, case, outcomes):
    with Store(path, case, 3) as store:
        store.keep(0, outcomes(25))
        store.keep_failure(range(25, 50), "why")
    changes = ("INSERT INTO failures VALUES (99, 1, 1, '')", "UPDATE failures SET report = 'x'")
    for change in changes:
        other = path.with_name(f"other-{changes.index(change)}.sqlite")
        shutil.copy(path, other)
        with contextlib.closing(sqlite3.connect(other)) as base, base:
            base.execute(change)
        with Store(other) as store, pytest.raises(ValueError, match=r"is damaged.* at trial"):
            store.failures()
