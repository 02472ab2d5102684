"""The quick search finds the stars of the filter's search, except those that it documents."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from startrack.benchmark.detection import SIDE, expose, field, flux_of, paint
from startrack.budget import analytic
from startrack.core import Frame, Streams
from startrack.design import Fidelity, replaced_all
from startrack.detection import Detection, detect, gaussian_psf
from startrack.montecarlo.run import run
from startrack.montecarlo.workers import Serial

BOTH = ("filter", "quick")
KEY = "tracker.detection.search"


def found_by(search, frame, sigma=1.0, **settings):
    settings = Detection(kernel_sigma=sigma, search=search, max_spots=1000, **settings)
    return detect(frame, settings, gaussian_psf(sigma))


def frame_of(snr, seed, sigma=1.0, background=50.0):
    """A frame with stars on a grid of 57 pixels, and their x and y."""
    streams = Streams(seed, 0)
    x, y = field(streams, 57)
    light = np.full((SIDE, SIDE), background)
    paint(light, x, y, flux_of(snr, sigma), sigma)
    return expose(light, streams), np.column_stack([x, y])


def places(spots):
    return np.column_stack([spots.x, spots.y])


@pytest.mark.parametrize("sigma", [0.5, 1.0, 2.0])
def test_stars_that_are_not_faint_are_those_of_the_filter(sigma):
    frame, stars = frame_of(15, 1, sigma)
    spots = found_by("quick", frame, sigma)
    distance, _ = cKDTree(places(spots)).query(stars)
    assert (distance < 1).mean() > 0.997
    assert len(spots) <= len(stars) + 1, "one false spot by chance"
    filtered = found_by("filter", frame, sigma)
    distance, other = cKDTree(places(spots)).query(places(filtered))
    assert (distance < 1e-6).mean() > 0.99
    np.testing.assert_allclose(spots.flux[other], filtered.flux, rtol=1e-5)
    np.testing.assert_allclose(spots.covariance[other], filtered.covariance, rtol=1e-5)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_gradients_columns_and_large_sources_make_no_spots(kind):
    streams = Streams(2, 0)
    y, x = np.mgrid[:512, :512]
    image = 60 + 0.1 * x + 0.05 * y + 4 * streams("noise").standard_normal(x.shape)
    image[(x - 300) ** 2 + (y - 200) ** 2 < 40**2] += 60  # a Moon
    image[:, 100] += 60  # a hot column
    image[400, 50] += 80  # a hot pixel
    image += 70 * np.exp(-((x - 150.3) ** 2 + (y - 350.6) ** 2) / 2)
    frame = Frame(np.clip(np.round(image), 0, 255).astype(kind), np.nan)
    spots = found_by("quick", frame)
    assert len(spots) == 1
    assert abs(places(spots) - [150.3, 350.6]).max() < 0.25


def test_images_of_real_numbers_are_searched_by_the_filter():
    frame, _ = frame_of(8, 3)
    image = frame.image.astype(float)
    image[100:110, 200:300] = np.nan
    real = replace(frame, image=image)
    spots = [found_by(search, real) for search in BOTH]
    np.testing.assert_array_equal(places(spots[0]), places(spots[1]))


def test_noise_alone_makes_no_more_false_spots():
    """5 are expected in 10 frames, with a sigma of 2.2; the narrow filter must find them, too."""
    light = np.full((SIDE, SIDE), 50.0)
    frames = [expose(light, Streams(seed, 0)) for seed in range(10)]
    counts = [len(found_by("quick", frame, false_per_frame=0.5)) for frame in frames]
    assert sum(counts) < 5 + 3 * 2.2


@pytest.fixture
def quick(small):
    """A small camera that measures all stars it finds."""
    return replaced_all(small.case, {"tracker.detection.max_spots": 1000, KEY: "quick"})


def test_the_budget_counts_the_stars_that_trials_find(quick):
    """The number of stars is that of 60 frames, to 3 %."""
    outcomes = run(quick, 60, 1, Serial())
    assert analytic(quick).stars == pytest.approx(outcomes["stars"].mean(), rel=0.03)


@pytest.mark.parametrize("fidelity", [Fidelity.WINDOW, Fidelity.SPOTS])
def test_other_trials_refuse_it(quick, fidelity):
    with pytest.raises(ValueError, match=r"search|quick"):
        run(quick, 1, 1, Serial(), fidelity=fidelity)
