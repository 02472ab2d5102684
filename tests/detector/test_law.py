"""The numbers of a frame against the law summed with scipy, and its tails."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import special, stats

from startrack.core.compiler import KernelDispatcher
from startrack.core.interpret import python_code
from startrack.core.streams import Streams
from startrack.core.variates import inverse_normal, poisson_quantile
from startrack.design import load_design
from startrack.detector import Detector
from startrack.detector.digitise import _digitise, digitise, draws_of, shot
from startrack.detector.law import (
    EMPTY,
    SignalLaw,
    blank,
    expected_signal,
    law_of,
    tables_for,
    unrounded_numbers,
)
from startrack.io import shipped
from startrack.response import noise_free_frame


def summed(mean: float, law: SignalLaw) -> np.ndarray:
    """Probability of each digital number, directly from the equation."""
    electrons = np.arange(0, math.ceil(mean + 12 * math.sqrt(mean) + 40))
    weight = stats.poisson.pmf(electrons, mean)
    held = np.minimum(electrons, law.full_well)
    level = held * (1 - law.nonlinearity * held / law.full_well)
    # Where a number gives way to the next, read backwards from a fine grid.
    number = np.arange(law.largest + 1)
    x = np.linspace(-law.largest, 2 * law.largest, 3_000_001)
    y = np.clip(x / law.largest, 0, 1)
    edge = np.interp(number + 0.5, x + 4 * law.adc_inl * y * (1 - y), x)
    edge = (edge - law.offset) / law.gain
    edge[-1] = np.inf
    if law.noise:
        z = (edge - level[:, None]) / law.noise
        lower, upper = weight @ special.ndtr(z), weight @ special.ndtr(-z)
    else:
        lower = weight @ (level[:, None] < edge)
        upper = 1 - lower
    return np.where(lower < 0.5, np.diff(lower, prepend=0), -np.diff(upper, prepend=1))


LAWS = {
    "sky": (20.0, SignalLaw(8.0, 2e4, 0.0, 0.2, 64.0, 0.0, 1023.0)),
    "quiet": (0.5, SignalLaw(2.0, 2e4, 0.0, 0.2047, 64.0, 0.0, 1023.0)),
    "nearly dark": (0.02, SignalLaw(0.35, 2e4, 0.0, 2.0, 20.0, 0.0, 1023.0)),
    "counting": (3.4, SignalLaw(0.0, 2e4, 0.0, 1.0, 0.0, 0.0, 1023.0)),
    "bright": (1500.0, SignalLaw(5.0, 2e4, 0.0, 0.2, 60.0, 0.0, 1023.0)),
    "full": (400.0, SignalLaw(6.0, 405.0, 0.0, 0.5, 20.0, 0.0, 1023.0)),
    "bent": (300.0, SignalLaw(4.0, 800.0, 0.2, 1.0, 20.0, 12.0, 1023.0)),
    "saturated": (300.0, SignalLaw(4.0, 800.0, 0.0, 1.0, 20.0, 0.0, 330.0)),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("tabled", [True, False])
def test_the_law_is_exact(name, tabled):
    """Chi-square of the histogram of 4 Mpx (0.5 Mpx pixel by pixel); false alarm 1e-4 each."""
    mean, law = LAWS[name]
    shape = (512, 512) if tabled else (60, 100)
    assert (tables_for(np.full(shape, mean), law) is not EMPTY) is tabled
    count = np.zeros(int(law.largest) + 1)
    for trial in range(16 if tabled else 80):
        image = digitise(np.full(shape, mean), law, Streams(11, trial))
        count += np.bincount(image.ravel(), minlength=len(count))
    fraction = summed(mean, law)
    many = fraction * count.sum() > 5
    observed = np.append(count[many], count[~many].sum())
    wanted = np.append(fraction[many], fraction[~many].sum()) * count.sum()
    keep = wanted > 1e-9
    assert observed[~keep].sum() == 0
    # Numbers too rare for the chi-square are pooled, and the pool may be rare itself.
    value = ((observed - wanted)[keep] ** 2 / np.maximum(wanted[keep], 1)).sum()
    assert stats.chi2.sf(value, keep.sum() - 1) > 1e-4


@pytest.mark.parametrize("mean", [0.3, 4.0, 77.7])
@pytest.mark.parametrize("noise", [0.0, 0.4, 3.0])
def test_between_levels_the_law_is_as_near_as_stated(mean, noise):
    """From the tables alone: total variation 2e-5, exact mean, tail within 2 %."""
    law = SignalLaw(noise, 2e4, 0.0, 1.0, 64.0, 0.0, 1023.0)
    tables = tables_for(np.full((256, 256), mean), law)
    level = math.floor(mean / tables.spacing)
    middle = (level + 0.5) * tables.spacing
    limit = tables.limit[level - tables.first : level - tables.first + 2] / 2.0**48
    mixed = np.diff(limit.mean(axis=0), prepend=0)
    exact = summed(middle, law)[tables.lowest :][: len(mixed)]
    assert np.abs(mixed - exact).sum() / 2 < 2e-5
    number = np.arange(len(mixed))
    assert mixed @ number == pytest.approx(exact @ number, abs=1e-9)
    deviation = math.sqrt(middle + noise**2 + 1 / 12)
    tail = number + tables.lowest - 64 > middle + 4.5 * deviation
    assert mixed[tail].sum() == pytest.approx(exact[tail].sum(), rel=0.02)


def test_the_tail_is_the_laws():
    """Some 90 of 32 Mpx lie beyond 4.5 sigma, within four of their standard errors."""
    mean, law = LAWS["sky"]
    fraction = summed(mean, law)
    number = np.arange(len(fraction))
    centre = fraction @ number
    threshold = centre + 4.5 * math.sqrt(fraction @ (number - centre) ** 2)
    pixels = sum(
        int((digitise(np.full((2048, 2048), mean), law, Streams(3, n)) > threshold).sum())
        for n in range(8)
    )
    wanted = fraction[number > threshold].sum() * 8 * 2**22
    assert wanted > 50
    assert abs(pixels - wanted) < 4 * math.sqrt(wanted)


def test_a_frame_follows_from_its_streams_alone():
    """Whatever was drawn before, and whichever rows are read."""
    law = LAWS["sky"][1]
    mean = np.random.default_rng(0).uniform(15, 25, (256, 256))
    mean[100:104, 50:54] = 3000.0
    first = digitise(mean, law, Streams(1, 2))
    digitise(10 * mean, law, Streams(1, 3))
    np.testing.assert_array_equal(first, digitise(mean, law, Streams(1, 2)))
    assert (first != digitise(mean, law, Streams(1, 3))).mean() > 0.5


def test_two_designs_share_their_noise():
    """5 % more light: the difference has a tenth of the variance of independent draws, or less."""
    law = law_of(Detector(256, 256, 1e-5, 1.0, full_well=65535.0, bits=16, read_noise=4.0))
    mean = np.full((256, 256), 200.0)
    one, two = (digitise(k * mean, law, Streams(5, 0)).astype(float) for k in (1.0, 1.05))
    other = digitise(mean, law, Streams(5, 1)).astype(float)
    assert (two >= one).all()
    assert (two - one).var() < 0.1 * (other - one).var()


def test_neighbours_and_trials_are_independent():
    """Correlations of 1 Mpx within four standard errors, along rows, columns and trials."""
    mean = np.full((1024, 1024), 40.0)
    a, b = (shot(mean, Streams(9, n)) - 40.0 for n in (0, 1))
    for one, other in ((a[:, 1:], a[:, :-1]), (a[1:], a[:-1]), (a, b), (a[:, 64:], a[:, :-64])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4 / 1024


def test_counted_electrons_are_the_poisson_quantile():
    """At a level of the tables, the electrons are the quantile of the same uniform number."""
    mean = np.full((256, 256), 5.5)
    wide = shot(mean, Streams(2, 0))
    narrow = shot(mean[:40], Streams(2, 0))  # too small for tables
    np.testing.assert_array_equal(wide[:40], narrow)
    assert wide.mean() == pytest.approx(mean[0, 0], abs=4 * math.sqrt(mean[0, 0]) / 256)


def test_normal_quantiles_are_scipys():
    rng = np.random.default_rng(1)
    fraction = np.concatenate([rng.random(100_000), 2.0 ** -rng.uniform(1, 54, 100_000), [0.5]])
    quantile = np.vectorize(inverse_normal)
    np.testing.assert_allclose(quantile(fraction), special.ndtri(fraction), atol=1e-10)
    np.testing.assert_allclose(quantile(1 - fraction[:1000]), -quantile(fraction[:1000]))


def test_poisson_from_a_share_is_scipys():
    from startrack.core.variates import poisson_of_uniform

    rng = np.random.default_rng(2)
    for mean in (1e-3, 0.4, 2.9, 3.1, 40.0):
        for fraction in (*rng.random(300), 1e-9, 1 - 1e-9, 1 - 1e-6):
            assert poisson_of_uniform(mean, fraction) == stats.poisson.ppf(fraction, mean)
    assert poisson_quantile(0.0, 1.0) == poisson_of_uniform(0.0, 0.9) == 0


def test_arrays_in_python_make_the_same_numbers():
    """For pixels with tables, dark pixels, and pixels in a star."""
    electrons = np.random.default_rng(4).uniform(15.0, 90.0, (400, 512))
    electrons[:, 20:40], electrons[10, 50:60] = 0.0, 1e4
    law = LAWS["sky"][1]
    tables, image = tables_for(electrons, law), blank(electrons.shape, law)
    assert tables.levels > 0
    python = python_code(_digitise.py_func, lambda value: isinstance(value, KernelDispatcher))
    with np.errstate(all="ignore"):
        python(image, electrons, draws_of(law, tables, Streams(3, 4)))
    np.testing.assert_array_equal(image, digitise(electrons, law, Streams(3, 4), tables))


def test_single_stars_and_frames_have_one_converter():
    """Below zero, above the largest number, and with an INL, the numbers equal `unrounded_numbers`.

    The closed form at half of the largest number is x + inl; beyond the range the ends are kept.
    """
    detector = replace(
        load_design(shipped("designs/noise_only.toml")).case.instrument.detector,
        offset=0,
        adc_inl=20.0,
        bits=12,
        full_well=20000.0,
    )
    per_dn, largest = detector.electrons_per_dn, 2**detector.bits - 1
    electrons = np.array([[-50.0, largest / 2 * per_dn, 1e6]])
    image = noise_free_frame(electrons, detector, 0.0, 0.0).image
    np.testing.assert_allclose(image, [[0.0, largest / 2 + 20.0, largest]], rtol=1e-6)
    law = law_of(detector)
    numbers = unrounded_numbers(expected_signal(electrons, law), law)
    np.testing.assert_allclose(image, numbers, rtol=1e-6)
