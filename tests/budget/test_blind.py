"""Why a design sees too few stars: light, dark current, the sky, its catalogue or its tests."""

import dataclasses
import math
import re

import pytest

from startrack.budget import analytic, survey
from startrack.catalog import Selection, open_sky
from startrack.core import Refused
from startrack.design import load_design
from startrack.design.parameter import with_values
from startrack.io import shipped
from startrack.trial.chain import run_random_trial

CASE = load_design(shipped("designs/noise_only.toml")).case
DIM = {"instrument.optics.f_number": 20.0}  # stars to G = 3.5 or so pass the threshold


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"instrument.detector.exposure": "1 us"}, "they have too little light"),
        (
            DIM | {"instrument.detector.dark_current": "2e5 electron / s"},
            r"dark current hides them: it makes 1.6e\+04 electrons in a pixel",
        ),
        (
            DIM | {"scene.background_g": 10.5},
            "the light of the sky hides them: it makes .* electrons in a pixel",
        ),
        (
            {"instrument.detector.dark_current": "3e5 electron / s"},
            "dark current saturates the pixels, which hold 19687 electrons: dark current makes 240",
        ),
        ({"scene.background_g": 10.0}, "the light of the sky saturates the pixels"),
        ({"catalog.limit_g": 1.0}, "too few stars are in a field, at most [123] of the"),
        (
            {"tracker.detection.sharpest_sigma": 5.0},
            "the tracker rejects the stars that it sees as hot pixels: of at most",
        ),
    ],
    ids=["light", "dark", "sky", "full of dark", "full of sky", "catalogue", "hot pixels"],
)
def test_the_cause_is_said(changes, cause):
    """Frames of the same design have no attitude either."""
    case = with_values(CASE, changes)
    with pytest.raises(Refused, match=f"somewhere in the sky, it does not: {cause}"):
        analytic(case)
    assert not any(run_random_trial(case, 1, number).solved for number in range(2))


def test_a_catalogue_of_the_tracker_that_leaves_out_its_stars_is_said():
    catalog = Selection(limit_g=1.0)
    case = dataclasses.replace(CASE, tracker=dataclasses.replace(CASE.tracker, catalog=catalog))
    with pytest.raises(Refused, match="tracker's catalogue lacks stars that the camera sees"):
        survey(case)


def test_figures_of_too_little_light_are_those_of_the_sky():
    """An exposure shorter by a factor lowers the limit by its magnitudes; the stars of the best
    field are counted."""

    def limit(exposure):
        with pytest.raises(Refused) as refusal:
            analytic(with_values(CASE, {"instrument.detector.exposure": exposure}))
        return [float(g) for g in re.findall(r"G = (-?\d+\.\d)", str(refusal.value))]

    (faint, best), (fainter, _) = limit("10 us"), limit("1 us")
    assert faint - fainter == pytest.approx(2.5, abs=0.06)
    # A field of 9.2 deg has four stars to that magnitude in the densest place of the sky alone.
    stars = open_sky(CASE.catalog).stars
    bright = stars.direction[stars.magnitude_g < best + 0.5]
    apart = bright @ bright.T > math.cos(13 * math.pi / 180)
    assert apart.sum(axis=1).max() >= 4
    few = stars.direction[stars.magnitude_g < best - 0.5]
    assert (few @ few.T > math.cos(4.5 * math.pi / 180)).sum(axis=1).max() < 4
