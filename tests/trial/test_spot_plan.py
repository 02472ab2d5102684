"""What drawn trials refuse, and by which name."""

import dataclasses

import pytest

from startrack.design.case import Fidelity
from startrack.detector import Defects, Hits
from startrack.motion import Motion
from startrack.scene import Scene
from startrack.trial.chain import run_random_trial

from .designs import CASE, changed, with_detector


@pytest.mark.parametrize(
    ("case", "named"),
    [
        (with_detector(hits=Hits(1e4)), "hits"),
        (with_detector(defects=Defects(dead=1e-3)), "dead pixels"),
        (with_detector(row_delay=1e-5), "row_delay"),
        (with_detector(blooming=True), "blooming"),
        (changed(motion=Motion(rate_z=0.1)), "a rate_z that smears"),
        (dataclasses.replace(CASE, scene=Scene(lights=("starlight",))), "lights of the scene"),
    ],
)
@pytest.mark.parametrize("fidelity", [Fidelity.SPOTS, Fidelity.COVARIANCE])
def test_what_needs_an_image_is_refused_by_name(case, named, fidelity):
    with pytest.raises(ValueError, match=f"without {named}"):
        run_random_trial(case, 1, 0, fidelity)
