"""The shipped high-accuracy design has a feasible optimum."""

import pytest

from startrack.design.files import load_design
from startrack.design.variables import DesignSpace, branches
from startrack.io import shipped
from startrack.optimise.evaluate import missed
from startrack.optimise.steps import feasible_start
from startrack.verification.accuracy import margins


@pytest.mark.slow
def test_with_each_detector_some_design_meets_what_needs_no_trials():
    """The first guess is feasible with one detector; the faster ones exceed the power."""
    design = load_design(shipped("designs/high_accuracy.toml"))
    campaign = design.campaign
    begun = {}
    for branch in branches(design.case, campaign.choices):
        space = DesignSpace(branch.case, campaign.variables, campaign.links)
        begun[branch.label] = missed(margins(campaign.requirements, branch.case))
        found = space.design(feasible_start(space, campaign.requirements).coordinates)
        assert missed(margins(campaign.requirements, found)) == 0, branch.label
    assert begun["detector star1000"] == 0
    assert begun["detector cmv4000"] > 0 < begun["detector imx174"]
