"""Heights from two images along the track, by formula and by trials."""

import math
from dataclasses import replace

import numpy as np
import pytest

from startrack.core import Refused
from startrack.earth.retrieval import (
    EarthProblem,
    forecast_heights,
    load_earth_design,
    match_heights,
    observe_terrain,
)

PROBLEM = EarthProblem(load_earth_design("heights"))
DESIGN = PROBLEM.design
assert DESIGN.retrieval
assert DESIGN.retrieval.stereo
assert DESIGN.campaign
OWN = DESIGN.retrieval.stereo
ALONE = EarthProblem(replace(DESIGN, campaign=replace(DESIGN.campaign, conditions=())))
BOTH = "channels.*.detector."
STEREO = "retrieval.stereo."
QUIET = {BOTH + "prnu": 0.0, BOTH + "read_noise": 0.0}


def test_height_over_parallax_is_base_over_height():
    """ADS40: lines 14.2 degrees apart, B / H = tan 14.2; forward and backward tan 28.4 more."""
    assert forecast_heights(DESIGN, OWN).base == pytest.approx(math.tan(math.radians(14.2)))
    wide = replace(OWN, channels=("forward", "backward"), relief=5.0)
    base = math.tan(math.radians(28.4)) + math.tan(math.radians(14.2))
    assert forecast_heights(DESIGN, wide).base == pytest.approx(base)


def test_heights_follow_the_terrain():
    """The slope of measured over true heights is 1 minus the smoothing of windows; a wrong sign
    gives -1."""
    own = replace(OWN, relief=40.0)
    images = observe_terrain(DESIGN, own, 1, 0)
    found = match_heights(DESIGN, own, images)
    slope, _ = np.polyfit(images.height[found.matched], found.height[found.matched], 1)
    assert slope == pytest.approx(1.0, abs=0.1)
    assert found.matched.sum() > 0.9 * found.inside.sum()


def test_noise_falls_with_the_side_of_windows():
    """Over level ground the error falls with the N pixels of a window, roughly as 1 / side."""
    level = replace(OWN, relief=0.0)
    small, large = (forecast_heights(DESIGN, replace(level, window=side)) for side in (11, 31))
    assert 0.5 * 11 / 31 < large.height_error / small.height_error < 1.1 * 11 / 31


@pytest.mark.parametrize(
    "values",
    [
        {},
        *(
            pytest.param(values, marks=pytest.mark.slow)
            for values in (
                {BOTH + "read_noise": 300.0},
                {BOTH + "bits": 8, BOTH + "offset": 2},
                {STEREO + "window": 21},
                {STEREO + "relief": 0.0},
                {STEREO + "relief": 30.0},
                {"land.texture": 0.15},
            )
        ),
    ],
)
def test_formulas_beside_trials(values: dict[str, float]):
    """15 %, plus 1.5 half widths of 95 % for 12 images: exceeded in less than 1 % of seeds."""
    problem = ALONE.replaced(values)
    expected, judged = problem.expect(), problem.judge(problem.trials(1, range(12)))
    value, interval = expected.value, judged.value
    assert abs(interval.value - value) < 0.15 * value + 0.75 * (interval.high - interval.low)


def test_what_cannot_be_is_refused():
    with pytest.raises(Refused, match="the base of channels"):
        forecast_heights(DESIGN, replace(OWN, channels=("red", "green")))
    with pytest.raises(Refused, match="must be a channel of the camera"):
        observe_terrain(DESIGN, replace(OWN, channels=("nadir", "up")), 1, 0)
    with pytest.raises(Refused, match="window must be an odd number"):
        replace(OWN, window=8)
    with pytest.raises(Refused, match="must be correlated by"):
        forecast_heights(PROBLEM.replaced({"land.texture": 0.01}).design, OWN)
    with pytest.raises(Refused, match="reduce the relief"):
        forecast_heights(DESIGN, replace(OWN, relief=500.0))
    with pytest.raises(Refused, match="too few details"):
        forecast_heights(DESIGN, replace(OWN, window=3))


def test_wide_images_leave_windows_too_few_details():
    """For such images the formula would be 17 % smaller than trials of 16 images."""
    blurred = {"channels.*.optics.f_number": 8.0, "channels.*.optics.blur": 6e-6}
    with pytest.raises(Refused, match="too few details"):
        forecast_heights(PROBLEM.replaced(blurred).design, OWN)
