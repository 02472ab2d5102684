"""Ledgers of earlier versions keep their content."""

from contextlib import closing
from dataclasses import replace
from sqlite3 import connect

import numpy as np
import pytest

from startrack.core import described
from startrack.design import Fidelity, load_design
from startrack.design.parameter import number, replaced
from startrack.io import shipped
from startrack.optimise.ledger import REFUSED, Ledger
from startrack.optimise.runner import TrialRunner
from startrack.trial import OUTCOMES

CASE = load_design(shipped("designs/noise_only.toml")).case
KEY = "52e1599bf12b9cfb2fe17eeab5ca69be"


def key(case):
    return TrialRunner(7)._key(case, Fidelity.FRAME, 3)


def test_a_field_that_is_as_by_default_is_not_in_the_key():
    optics = CASE.instrument.optics
    assert "psf_tolerance" not in described(optics)
    assert "f_number=2.4" in described(optics)
    changed = replace(optics, psf_tolerance=0.02)
    assert "psf_tolerance=0.02" in described(changed)


@pytest.mark.parametrize(
    "name",
    [
        "instrument.optics.blur",
        "instrument.detector.prnu",
        "instrument.motion.rate_z",
        "tracker.detection.threshold",
        "scene.background_g",
        "catalog.limit_g",
    ],
)
def test_each_parameter_changes_it(name):
    changed = replaced(CASE, name, 0.8 * number(CASE, name) or 0.01)
    assert key(changed) != key(CASE)
    assert TrialRunner(8)._key(CASE, Fidelity.FRAME, 3) != key(CASE)


def test_a_smear_that_the_tracker_is_told_changes_it():
    assert key(replaced(CASE, "tracker.detection.smear_x", 3.0)) != key(CASE)


def test_the_content_of_a_catalogue_file_is_in_it(tmp_path):
    path = tmp_path / "stars.fits"
    path.write_bytes(shipped("stars/bright.fits").read_bytes())
    one = replace(CASE, catalog=replace(CASE.catalog, source=str(path)))
    before = key(one)
    assert before == key(one)
    path.write_bytes(b"another")
    assert key(one) != before


def test_a_ledger_of_another_format_is_refused(tmp_path):
    path = tmp_path / "new" / "ledger.sqlite"
    Ledger(path).close()
    with closing(connect(path)) as base, base:
        assert base.execute("PRAGMA application_id").fetchone() == (0x53544C47,)
        base.execute("PRAGMA user_version = 0")
    with pytest.raises(ValueError, match="ledger of startrack of format 1, got format 0; begin"):
        Ledger(path)


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        ("UPDATE rows SET data = zeroblob(length(data)) WHERE number = 3", "row 3 of 52e1"),
        ("UPDATE rows SET number = number + 1 WHERE number = 3", "row 4 of 52e1"),
        ("UPDATE rows SET data = 'text'", "row 0 of 52e1"),
        ("DELETE FROM rows WHERE number = 0", "trial 0 of 52e1.* is missing"),
        ("UPDATE rows SET data = CAST('x' AS BLOB) WHERE length(key) > 16", "of 7265667573"),
    ],
)
def test_damage_of_a_ledger_is_no_other_result(tmp_path, damage, sentence):
    path, key = tmp_path / "ledger.sqlite", bytes.fromhex(KEY)
    with Ledger(path) as ledger:
        ledger.keep(key, 0, np.zeros(3, OUTCOMES))
        ledger.keep(key, 3, np.ones(2, OUTCOMES))
        ledger.keep_note(REFUSED, key, "too dark")
        assert ledger.note(REFUSED, key) == "too dark"
        assert len(ledger.held(key)) == 5
    with closing(connect(path)) as base, base:
        assert base.execute(damage).rowcount
    with Ledger(path) as ledger, pytest.raises(ValueError, match="damaged: .*" + sentence):
        ledger.held(key), ledger.note(REFUSED, key)


def test_a_ledger_is_no_store(tmp_path):
    from startrack.montecarlo import Store

    Ledger(tmp_path / "ledger.sqlite").close()
    with pytest.raises(ValueError, match="must be a campaign store, but is another database"):
        Store(tmp_path / "ledger.sqlite", CASE, 3)
