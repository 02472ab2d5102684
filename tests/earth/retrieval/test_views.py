"""The images of a trial show what the values of its row say."""

import re

import numpy as np
import pytest

from startrack.core import Refused
from startrack.earth.retrieval import EarthProblem, load_earth_design

SEED = 3


def trial(name, changes, number):
    """The images, by name, and the text of a trial in the file's own condition; and its row."""
    problem = EarthProblem(load_earth_design(name, changes))
    view = problem.view(SEED, number)
    row = problem.trials(SEED, range(number, number + 1))[0]
    images = {image.name: image for image in view.images}
    return (
        images,
        view.text,
        {key: row[f"nominal: {key}"] for key in problem.studies["nominal"].columns},
    )


@pytest.mark.slow
def test_missed_fires_are_smaller_than_the_smallest_that_is_found():
    problem = EarthProblem(load_earth_design("hsrs", ["retrieval.hot_spots.area=2.2 m2"]))
    marks = problem.view(SEED, 0).images[0].marks
    smallest = problem.trials(SEED, range(problem.per_image))["nominal: area 1000 K"]
    found, missed = len(marks["fire found"]), len(marks["fire missed"])
    assert found + missed == problem.per_image
    assert 0 < missed < found
    # The search for the smallest area ends within 1 %.
    assert (smallest < 2.2 / 1.01).sum() <= found <= (smallest < 2.2 * 1.01).sum()
    assert problem.view(SEED, 7).images[0].marks["fire of this trial"].shape == (1, 2)


def test_wrong_classes_and_errors_of_reflectance():
    images, text, row = trial("fields", ["retrieval.land_cover.size=48"], 2)
    assert images["class"].values.mean() == row["wrong"]
    differs = images["class, true"].values != images["class, retrieved"].values
    assert (differs == images["class"].values).all()
    errors = [images[f"{n}, measured"].values - images[f"{n}, true"].values for n in ("B2", "B8")]
    assert all(error.std() > 0 for error in errors)
    assert float(re.findall(r"reflectance ([0-9.e-]+) rms", text)[0]) == pytest.approx(
        row["square of reflectance"] ** 0.5, rel=1e-3
    )


def test_errors_of_heights():
    images, _, row = trial("heights", ["retrieval.stereo.size=64"], 1)
    error = images["height, retrieved"].values - images["height, true"].values
    assert np.nanmean(error**2) == pytest.approx(row["square of height"], rel=1e-12)
    assert np.isnan(error).any()  # at the border


def test_waves_and_spectra():
    _, text, row = trial("waves", ["retrieval.waves.size=64"], 1)
    true, found = map(float, re.findall(r"height ([0-9.]+) m, retrieved ([0-9.]+)", text)[0])
    assert abs(true - found) == pytest.approx(row["square of wave height"] ** 0.5, abs=2e-3)
    images, _, row = trial("mertis", [], 130)
    square = (images["emissivity, true"].values - images["emissivity, retrieved"].values) ** 2
    assert square[2].mean() == pytest.approx(row["square of emissivity"], rel=1e-12)


def test_another_condition_has_other_images_of_the_same_ground():
    problem = EarthProblem(load_earth_design("heights", ["retrieval.stereo.size=64"]))
    day, winter = (problem.view(SEED, 0, name).images for name in ("nominal", "winter"))
    assert (day[2].values == winter[2].values).all()
    assert (day[0].values > winter[0].values).mean() > 0.9
    with pytest.raises(Refused, match="conditions must be names of nominal, winter"):
        problem.view(SEED, 0, "autumn")
