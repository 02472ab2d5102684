import dataclasses

import numpy as np
import pytest

from startrack.design import Requirements
from startrack.design.variables import DesignSpace, Variable
from startrack.optimise import steps
from startrack.optimise.evaluate import missed


def narrow(_requirements, case):
    """Requirements that are nearly met near the start alone; elsewhere the margins lead away
    from it."""
    off = abs(case.instrument.optics.blur - START)
    return {"blur": -0.01 if off < 1e-9 else -0.6 + 1e4 * off}


START = 4.321e-6


def test_what_comes_nearest_is_never_worse_than_the_start(small, monkeypatch):
    monkeypatch.setattr(steps, "margins_of", narrow)
    case = DesignSpace(small.case, (Variable("instrument.optics.blur", "1 um", "12 um"),))
    start = (START - 1e-6) / 11e-6
    space = DesignSpace(case.design(np.array([start])), case.variables)
    found = steps.feasible_start(space, Requirements())
    assert found.short == missed(found.margins) <= 0.01


def test_costs_that_no_design_meets_are_found_without_a_forecast(small, monkeypatch):
    """The mass exceeds its limit everywhere, even with the smallest lens; no image is made."""
    monkeypatch.setattr(steps, "margins_of", None)
    space = DesignSpace(small.case, (Variable("instrument.optics.f_number", 1.2, 4.0),))
    needs = Requirements()
    masses = [needs.mass(space.design(np.array([at]))) for at in np.linspace(0, 1, 101)]
    limit = 0.9 * min(masses)
    unmet = steps.unmet_costs([space], dataclasses.replace(needs, max_mass=limit))
    assert list(unmet) == ["mass"]
    assert limit * (1 - unmet["mass"]) == pytest.approx(min(masses), rel=1e-3)
    assert not steps.unmet_costs([space], dataclasses.replace(needs, max_mass=1.01 * min(masses)))
