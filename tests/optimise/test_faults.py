"""A search takes a refusal for an infeasible design, and stops at a fault."""

import numpy as np
import pytest

from startrack import Refused
from startrack.design import DesignSpace
from startrack.optimise import Ledger, TrialRunner, runner
from startrack.optimise.evaluate import evaluate


def score(small, ledger):
    space = DesignSpace(small.case, small.campaign.variables)
    return evaluate(space, small.campaign, space.start, TrialRunner(7, ledger=ledger))


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        yield ledger


def reasons(ledger):
    return ledger._database.read("SELECT reason FROM refused")


def test_a_fault_of_a_stage_stops_it_and_is_not_kept(small, ledger, monkeypatch):
    """The shapes of two arrays do not match, which is a ValueError of numpy."""
    with monkeypatch.context() as broken:
        broken.setattr(runner, "run", lambda *_: np.zeros(2) + np.zeros(3))
        with pytest.raises(ValueError, match="could not be broadcast"):
            score(small, ledger)
    assert reasons(ledger) == []
    mended = score(small, ledger)
    assert mended.note == ""
    assert mended.trials == small.campaign.trials


def test_a_refusal_is_an_infeasible_design_and_is_kept(small, ledger, monkeypatch):
    def refuse(*_):
        raise Refused("lens must fit")

    with monkeypatch.context() as refused:
        refused.setattr(runner, "run", refuse)
        assert score(small, ledger).note == "lens must fit"
    assert reasons(ledger) == [("lens must fit",)]
    assert score(small, ledger).note == "lens must fit"


def test_what_the_machine_refuses_is_not_kept(small, ledger, monkeypatch):
    """With more memory the same design may be rendered."""
    monkeypatch.setenv("STARTRACK_MEMORY", "1000")
    assert "--memory" in score(small, ledger).note
    assert reasons(ledger) == []
