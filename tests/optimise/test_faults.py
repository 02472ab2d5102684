"""A search treats a refusal as an infeasible design, and stops at a fault."""

import re

import numpy as np
import pytest

from startrack import Refused
from startrack.cli.stopping import status_and_sentence
from startrack.core import require_memory
from startrack.design import DesignSpace
from startrack.optimise import Ledger, TrialRunner, runner
from startrack.optimise.evaluate import evaluate, foresee_all
from startrack.trial import chain


def score(small, ledger):
    space = DesignSpace(small.case, small.campaign.variables)
    return evaluate(space, small.campaign, space.start, TrialRunner(7, ledger=ledger))


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        yield ledger


def reasons(ledger):
    rows = ledger._database.read("SELECT data FROM rows WHERE length(key) > 16")
    return [reason.decode() for (reason,) in rows]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (lambda: np.zeros(2) + np.zeros(3), "could not be broadcast"),
        (lambda: np.linalg.inv(np.zeros((2, 2))), "Singular matrix"),
        (lambda: b"\xff".decode(), "invalid start byte"),
    ],
)
def test_a_fault_of_a_trial_stops_it_and_is_not_kept(small, ledger, monkeypatch, fault, words):
    """ValueError, LinAlgError and UnicodeDecodeError, all three of them ValueErrors."""
    true = chain.run_trial

    def spoilt(case, attitude, streams, fidelity):
        return fault() if streams.trial == 5 else true(case, attitude, streams, fidelity)

    with monkeypatch.context() as broken:
        broken.setattr(chain, "run_trial", spoilt)
        with pytest.raises(ValueError, match=words) as raised:
            score(small, ledger)
    (name,) = (variable.name for variable in small.campaign.variables[:1])
    status, sentence = status_and_sentence(raised.value)
    assert status == 1
    assert re.search(rf"in trial 5 of seed 7, of the design with {name} = \d", sentence)
    assert ledger._database.read("SELECT * FROM rows") == []
    mended = score(small, ledger)
    assert mended.note == ""
    assert mended.trials == small.campaign.trials


def test_a_refusal_is_an_infeasible_design_and_is_kept(small, ledger, monkeypatch):
    def refuse(*_):
        raise Refused("lens must fit")

    with monkeypatch.context() as refused:
        refused.setattr(runner, "run", refuse)
        assert score(small, ledger).note == "lens must fit"
    assert reasons(ledger) == ["lens must fit"]
    assert score(small, ledger).note == "lens must fit"


def test_what_the_machine_refuses_is_not_kept(small, ledger, monkeypatch):
    """With more memory the same design may be rendered and forecast."""
    space = DesignSpace(small.case, small.campaign.variables)
    monkeypatch.setenv("STARTRACK_MEMORY", "1000")
    assert "--memory" in score(small, ledger).note
    with monkeypatch.context() as small_machine:
        small_machine.setitem(
            foresee_all.__globals__, "forecasts", lambda *_, **__: require_memory(2e3, "")
        )
        runner = TrialRunner(7, ledger=ledger)
        assert foresee_all(space, small.campaign, [space.start], runner)[0].margins == {}
    assert reasons(ledger) == []
