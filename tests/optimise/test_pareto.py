import dataclasses

import numpy as np
import pytest

from startrack.design.variables import DesignSpace
from startrack.optimise.pareto import FrontGoals, front, undominated
from startrack.optimise.runner import TrialRunner


def test_only_what_none_beats_is_kept():
    values = np.array([[1, 4], [2, 2], [3, 3], [4, 1], [2, 2], [5, 1]])
    assert undominated(values) == [0, 1, 3]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["epsilon", "weighted"])
def test_accuracy_is_paid_for_in_mass(small, method):
    campaign = dataclasses.replace(
        small.campaign, variables=small.campaign.variables[:2], analytic_evaluations=30
    )
    space = DesignSpace(small.case, campaign.variables)
    stages = []
    goals, runner = FrontGoals("across", "mass"), TrialRunner(1)
    points = front(space, campaign, goals, runner, 4, method, stages.append)
    assert len(points) >= 3
    parts = [stage.part for stage in stages]
    assert parts == sorted(parts)
    assert parts[-1] == 1
    across, mass = np.transpose([one.expected for one in points])
    assert (np.diff(across) > 0).all()
    assert (np.diff(mass) < 0).all()
    for one in points:
        assert one.measured[1] == one.expected[1]
        assert one.measured[0] == pytest.approx(one.expected[0], rel=0.5)


def test_a_goal_is_not_traded_for_itself():
    with pytest.raises(ValueError, match="must differ"):
        FrontGoals("mass", "mass")
    with pytest.raises(ValueError, match="objective must be"):
        FrontGoals("speed", "mass")


def test_a_box_that_meets_nothing_has_no_front(small, monkeypatch):
    """No lens of the design space is under 10 g."""
    monkeypatch.setattr("startrack.optimise.steps.START_EVALUATIONS", 2)
    tight = dataclasses.replace(small.campaign.requirements, max_mass=0.01)
    campaign = dataclasses.replace(
        small.campaign, requirements=tight, variables=small.campaign.variables[:2]
    )
    with pytest.raises(ValueError, match="no design in the design space meets the requirements"):
        front(
            DesignSpace(small.case, campaign.variables), campaign, FrontGoals(), TrialRunner(1), 3
        )
