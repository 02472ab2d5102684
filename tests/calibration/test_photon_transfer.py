import dataclasses

import numpy as np
import pytest
from scipy import stats

from startrack.calibration.photon_transfer import NAMES, Level, sample_detector
from startrack.core.streams import Streams
from startrack.detector import Detector, frame_of
from startrack.detector.collect import background
from startrack.optimise.ensemble import Ensembles

SHORT = Ensembles(count=2, stretch=500, most_steps=500)
LONG = Ensembles(count=2, stretch=1000, most_steps=10_000)
DETECTOR = Detector(
    columns=160,
    rows=160,
    pixel_pitch=5e-6,
    exposure=0.1,
    dark_current=400.0,
    read_noise=9.0,
    prnu=0.012,
    full_well=30_000.0,
    bits=12,
    offset=120,
)


def level(detector, electrons, exposure, frames=4):
    """Frames that the detector room takes of even light."""
    detector = dataclasses.replace(detector, exposure=exposure)
    expected = background(detector, electrons)
    number = round(1e6 * exposure) + round(electrons)
    images = [frame_of(expected, detector, Streams(number, i)).image for i in range(frames)]
    return Level(np.array(images), exposure, electrons > 0)


def levels(detector):
    return [
        level(detector, 0.0, 0.001),
        level(detector, 0.0, 2.0),
        level(detector, 3000.0, 0.1),
        level(detector, 15_000.0, 0.1),
    ]


@pytest.fixture(scope="module")
def given():
    return levels(DETECTOR)


@pytest.fixture(scope="module")
def posterior(given):
    return sample_detector(given, 1, SHORT)


def test_the_constants_of_the_detector_are_found(posterior):
    """Each constant is within its 99.9 % interval; false alarm 5e-3.

    Too few samples for exact intervals.
    """
    truth = {
        "electrons_per_dn": DETECTOR.electrons_per_dn,
        "read_noise": DETECTOR.read_noise,
        "dark_current": DETECTOR.dark_current,
        "prnu": DETECTOR.prnu,
        "offset": DETECTOR.offset,
    }
    for name, value in truth.items():
        _, low, high = posterior.interval(name, 0.999)
        assert low < value < high, name
    # The error of a variance of 1e5 numbers is 0.5 %, of the lit level alone.
    _, low, high = posterior.interval("electrons_per_dn")
    assert (high - low) / DETECTOR.electrons_per_dn < 0.03


def test_the_gain_is_that_of_the_straight_line(given, posterior):
    """Classical photon transfer: the slope of the variance against the mean."""
    mean = [one.frames.mean() for one in given]
    variance = [one.frames.var(axis=0, ddof=1).mean() for one in given]
    slope = np.polyfit(mean, variance, 1)[0]
    middle, low, high = posterior.interval("electrons_per_dn")
    assert abs(1 / slope - middle) < high - low


@pytest.mark.slow
def test_the_chains_converge(given, posterior):
    """Longer chains have the intervals of the short ones, within a fifth of their width."""
    long = sample_detector(given, 1, LONG)
    assert long.chains.converged, long.chains.reason_unconverged
    for name in NAMES:
        ends, wanted = (np.array(one.interval(name)[1:]) for one in (posterior, long))
        assert ends == pytest.approx(wanted, abs=0.2 * np.ptp(wanted)), name


@pytest.mark.slow
def test_the_ranks_of_the_truth_are_uniform():
    """40 detectors with normal pixels: chi-square in 5 bins for five unknowns, false alarm 1e-3."""
    rng = np.random.default_rng(7)
    ranks = []
    for number in range(40):
        log = np.log([5.0, 8.0, 300.0, 0.01, 4.0]) + rng.uniform(-1, 1, 5)
        gain, read, dark, prnu, pattern = np.exp(log)
        fixed, response = pattern * rng.standard_normal(4000), rng.standard_normal(4000)
        given = []
        for light, exposure in ((0.0, 0.01), (0.0, 3.0), (2e3, 0.1), (2e4, 0.1)):
            mean = light * (1 + prnu * response) + dark * exposure + fixed
            spread = np.sqrt(read**2 + dark * exposure + light)
            electrons = mean + spread * rng.standard_normal((5, 1, 4000))
            given.append(Level(np.round(100 + electrons / gain), exposure, light > 0))
        samples = sample_detector(given, number, LONG).samples
        ranks.append((samples[:, :5] < [gain, read, dark, prnu, pattern]).mean(axis=0))
    counts = [np.histogram(column, 5, (0, 1))[0] for column in np.transpose(ranks)]
    assert (stats.chisquare(counts, axis=1).pvalue > 2e-4).all(), NAMES


def test_what_is_missing_is_said():
    dark = Level(np.zeros((2, 3, 3)), 1.0, False)
    with pytest.raises(ValueError, match="lit one and dark ones of two exposures"):
        sample_detector([dark, dark], 1)
    with pytest.raises(ValueError, match="m of 2 or more"):
        Level(np.zeros((1, 3, 3)), 1.0, False)
    with pytest.raises(ValueError, match="saturated"):
        Level(np.full((2, 3, 3), 4095.0), 1.0, True)


def test_light_that_is_none_is_told(given):
    """If a lit level is as dark as the dark one, there is no gain, and no division by zero."""
    dark = [one for one in given if not one.lit]
    with pytest.raises(ValueError, match="must be brighter than the dark ones, got means of"):
        sample_detector([*dark, dataclasses.replace(dark[0], lit=True)], 1)
