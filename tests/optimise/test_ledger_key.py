"""Ledgers of earlier versions keep what they hold."""

from contextlib import closing
from sqlite3 import connect

import numpy as np
import pytest

import startrack
from startrack.design import Fidelity, load_design
from startrack.io import shipped
from startrack.optimise.ledger import Ledger
from startrack.optimise.runner import TrialRunner
from startrack.trial import OUTCOMES

CASE = load_design(shipped("designs/nanosatellite.toml")).case
KEY = "52e1599bf12b9cfb2fe17eeab5ca69be"  # as version 0.1.0 wrote it


def test_the_key_of_the_example_is_that_of_the_first_version(monkeypatch):
    """Names of classes and fields have changed since, the key has not."""
    monkeypatch.setattr(startrack, "__version__", "0.1.0")
    assert TrialRunner(7)._key(CASE, Fidelity.FRAME, 3).hex() == KEY
    assert TrialRunner(8)._key(CASE, Fidelity.FRAME, 3).hex() != KEY


def test_a_ledger_without_the_newer_tables_opens(tmp_path):
    path = tmp_path / "new" / "ledger.sqlite"
    held = np.zeros(3, OUTCOMES)
    with Ledger(path) as ledger:
        ledger.keep(bytes.fromhex(KEY), 0, held)
    with closing(connect(path)) as base, base:
        base.execute("DROP TABLE refused")
        assert base.execute("PRAGMA application_id").fetchone() == (0x53544C47,)
    with Ledger(path) as ledger:
        assert ledger.refusal(b"other") == ""
        ledger.keep_refusal(b"other", "too dark")
        assert ledger.refusal(b"other") == "too dark"
        assert ledger.held(bytes.fromhex(KEY)).tobytes() == held.tobytes()


def test_a_ledger_is_no_store(tmp_path):
    from startrack.montecarlo import Store

    Ledger(tmp_path / "ledger.sqlite").close()
    with pytest.raises(ValueError, match="must be a campaign store, but is another database"):
        Store(tmp_path / "ledger.sqlite", CASE, 3)
