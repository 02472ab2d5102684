"""The shipped design of high accuracy comes with a question that has an answer."""

from startrack.catalog import shipped
from startrack.design import load_design
from startrack.study.box import Box
from startrack.study.choice import branches
from startrack.study.evaluate import missed
from startrack.study.reach import reach


def test_with_each_detector_some_design_meets_what_needs_no_trials():
    """The first guess does with one detector; the faster ones take more power than there is."""
    design = load_design(shipped("designs/high_accuracy.toml"))
    campaign = design.campaign
    begun = {}
    for branch in branches(design.case, campaign.choices):
        box = Box(branch.case, campaign.variables, campaign.links)
        begun[branch.label] = missed(campaign.requirements.margins(branch.case))
        found = box.design(reach(box, campaign.requirements).place)
        assert missed(campaign.requirements.margins(found)) == 0, branch.label
    assert begun["detector star1000"] == 0
    assert begun["detector cmv4000"] > 0 < begun["detector imx174"]
