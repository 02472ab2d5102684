import pytest

from startrack.core import Refused
from startrack.design.campaign import Campaign
from startrack.design.files import load_design
from startrack.design.parameter import replaced
from startrack.design.variables import Choice, Variable, branches
from startrack.detector import Age
from startrack.io import shipped

CASE = load_design(shipped("designs/noise_only.toml")).case


def test_every_combination_is_a_branch():
    window = Choice("tracker.detection.window", (3.0, 5.0))
    blur = Choice("instrument.optics.blur", ("2 um", "3 um", "4 um"))
    found = branches(CASE, (window, blur))
    assert len(found) == 6
    assert found[4].label == "window 5, blur 3 um"
    assert found[4].case.tracker.detection.window == 5
    assert found[4].case.instrument.optics.blur == pytest.approx(3e-6)


@pytest.mark.parametrize("other", ["choices", "variables"])
def test_a_parameter_that_something_else_changes_is_no_choice(other):
    focus = Choice("instrument.optics.f_number", (2.0, 2.8))
    parts = {"choices": (focus, focus), "variables": (Variable(focus.name, 1.4, 4.0),)}
    with pytest.raises(Refused, match=r"name a parameter once, .* got instrument.optics.f_number"):
        Campaign(**{"choices": (focus,), other: parts[other]})


def test_without_choices_there_is_the_case_itself():
    assert [branch.case for branch in branches(CASE, ())] == [CASE]


def test_a_detector_is_chosen_by_product():
    (one,) = branches(CASE, (Choice("instrument.detector", ("cmv4000",)),))
    detector = one.case.instrument.detector
    assert (detector.columns, detector.full_well) == (2048, 13500)
    assert detector.exposure == CASE.instrument.detector.exposure
    assert one.case.instrument.optics == CASE.instrument.optics


def test_a_chosen_product_is_operated_as_the_one_in_its_place():
    """A choice of the product leaves the exposure and read-out of the design."""
    operated = replaced(CASE, "instrument.detector.row_delay", 20e-6)
    operated = replaced(operated, "instrument.detector.frame_rate", 5.0)
    (one,) = branches(operated, (Choice("instrument.detector", ("cmv4000",)),))
    detector = one.case.instrument.detector
    assert (detector.row_delay, detector.frame_rate) == (20e-6, 5.0)
    assert detector.update_rate == 5
    (rate,) = branches(
        operated,
        (
            Choice("instrument.detector", ("cmv4000",)),
            Choice("instrument.detector.frame_rate", ("4 Hz",)),
        ),
    )
    assert rate.case.instrument.detector.frame_rate == 4


def test_a_chosen_product_is_as_old_as_the_one_in_its_place():
    """Each product ages in silicon of its own depth."""
    aged = replaced(CASE, "instrument.detector.age", Age(time=1e8, fluence=1e8, depleted=3e-6))
    one, other = branches(aged, (Choice("instrument.detector", ("cmv4000", "star1000")),))
    for case, depleted in ((one.case, 0.5e-6), (other.case, 2e-6)):
        age = case.instrument.detector.age
        assert (age.time, age.fluence) == (1e8, 1e8)
        assert age.depleted == pytest.approx(depleted)


def test_a_name_is_chosen():
    (_, other) = branches(CASE, (Choice("tracker.detection.centroid", ("gravity", "likelihood")),))
    assert other.case.tracker.detection.centroid == "likelihood"


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        (("tracker.detection.window", (4.0,)), "window must be odd"),
        (("tracker.detection.centroid", ("best",)), "centroid must be one of"),
        (("instrument.detector", ("perfect",)), "product must be one of"),
        (("instrument.optics.blur", (2.0,)), "must have a unit"),
        (("instrument.optics.bluer", (2.0,)), "bluer is none"),
        (("tracker.detection.threshold", tuple(4 + 0.01 * i for i in range(300))), "at most 256"),
    ],
)
def test_a_wrong_choice_is_refused(choice, words):
    with pytest.raises(ValueError, match=words):
        branches(CASE, (Choice(*choice),))
