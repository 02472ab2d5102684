import dataclasses

import numpy as np
import pytest
from scipy import integrate, signal, stats

from startrack.core.streams import Streams
from startrack.motion import Broadband, Motion, Tone, blur, jitter_rms, realise_motion
from startrack.motion.realisation import bands

TABLE = Broadband("x", (2.0, 20.0, 100.0, 400.0), (1e-9, 1e-9, 2e-10, 1e-13))


def density(f, table=TABLE):
    return np.exp(np.interp(np.log(f), np.log(table.frequency), np.log(table.density)))


@pytest.mark.parametrize(
    "table",
    [
        TABLE,
        Broadband("x", (1e-4, 1.0, 1e4), (1.0, 1e-8, 1e-20)),
        Broadband("y", (1.0, 10.0), (1.0, 0.1)),  # 1 / f, where the power law's integral is a log
        Broadband("z", (1.0, 1.01), (1.0, 1e-3)),
    ],
)
def test_power_is_the_integral_of_the_density(table):
    power = sum(
        integrate.quad(lambda u: density(np.exp(u), table) * np.exp(u), *np.log(ends))[0]
        for ends in zip(table.frequency, table.frequency[1:], strict=False)
    )
    cut = bands(table)
    assert cut.power.sum() == pytest.approx(power, rel=1e-9)
    assert cut.width.sum() == pytest.approx(table.frequency[-1] - table.frequency[0], rel=1e-12)
    for fraction in (0.1, 0.5, 0.9):
        for k in (0, len(cut.low) // 2, len(cut.low) - 1):
            top = cut.frequency_at(np.full(len(cut.low), fraction))[k]
            below, _ = integrate.quad(
                lambda u: density(np.exp(u), table) * np.exp(u), np.log(cut.low[k]), np.log(top)
            )
            assert below == pytest.approx(fraction * cut.power[k], rel=1e-8)


def test_periodogram_gives_back_the_spectrum():
    """scipy's periodogram with a Hann window, in half octaves, over 250 trials of one second.

    A half octave has at least 8 lines in a trial, so that its standard error is at most 2.5 %.
    """
    rate = count = 1024  # samples a second: the spectrum ends at 400 Hz
    time = np.arange(count) / rate - 0.5
    power = 0.0
    for trial in range(250):
        x = realise_motion(Motion(broadband=(TABLE,)), 1.0, Streams(3, trial)).at(time)[:, 0]
        f, one = signal.periodogram(x, rate, "hann", detrend=False)
        power += one / 250
    for low in 20 * 2 ** np.arange(0, 4.0, 0.5):
        band = (f >= low) & (f < low * 2**0.5)
        expected = np.trapezoid(density(f[band]), f[band])
        assert np.trapezoid(power[band], f[band]) == pytest.approx(expected, rel=0.1), low


def test_variance_and_covariance_at_any_lag():
    """E[(x(t) - x(0))^2] = 2 Int S (1 - cos 2 pi f t) df, within four standard errors."""
    motion = Motion(broadband=(TABLE,))
    lags = np.array([0.0005, 0.004, 0.03, 0.2])
    x = np.array([realise_motion(motion, 0.1, Streams(5, n)).at(lags)[:, 0] for n in range(3000)])
    f = np.geomspace(2, 400, 400001)
    for k, lag in enumerate(lags):
        expected = np.trapezoid(2 * density(f) * (1 - np.cos(2 * np.pi * f * lag)), f)
        square = x[:, k] ** 2
        error = square.std() / np.sqrt(len(square))
        assert abs(square.mean() - expected) < 4 * error
        # Normal: Kolmogorov and Smirnov's test; it fails for a right code once in a thousand.
        assert stats.kstest(x[:, k] / np.sqrt(expected), "norm").pvalue > 1e-3


def test_a_tone_has_its_rms_frequency_and_leads():
    tone = Tone(12.5, rms_x=3e-5, rms_y=1e-5, rms_z=2e-5, phase=0.4, lead_y=-np.pi / 2, lead_z=1.0)
    motion = realise_motion(Motion(tones=(tone,)), 0.1)
    time = np.arange(10000) / 10000 * 8 / 12.5
    angle = -motion.at(time)
    assert angle.std(axis=0) == pytest.approx([3e-5, 1e-5, 2e-5], rel=1e-9)
    phases = np.angle(np.fft.rfft(angle, axis=0)[8])  # eight cycles
    assert phases == pytest.approx([0.4, 0.4 - np.pi / 2, 1.4], abs=1e-9)
    assert not motion.at(np.zeros(1)).any()


def test_speed_is_that_of_the_path():
    tone = Tone(30.0, rms_x=1e-5, rms_y=2e-5)
    motion = realise_motion(Motion(rate_y=2e-4, tones=(tone,)), 0.1, Streams(1, 2))
    time = np.arange(20000) / 20000 * 100 / 30
    measured = np.sqrt((np.diff(motion.at(time), axis=0) ** 2).mean(axis=0)) / (time[1] - time[0])
    np.testing.assert_allclose(motion.speed, measured, rtol=1e-4)


def test_panels_and_single_times_agree():
    motion = Motion(1e-3, -2e-3, 5e-3, (Tone(70.0, 1e-5, 0.0, 3e-5),), (TABLE,))
    one = realise_motion(motion, 0.3, Streams(2, 7))
    start, step = np.array([-0.15, 0.0, 0.1]), np.linspace(0, 0.05, 11)
    for a, row in zip(start, one.over(start, step), strict=True):
        np.testing.assert_allclose(row, one.at(a + step), atol=1e-17, rtol=1e-12)


def test_a_trial_repeats_and_no_cause_disturbs_another():
    time = np.linspace(-0.05, 0.05, 7)
    wheel, cooler = Tone(80.0, rms_x=1e-5), Tone(43.0, rms_y=2e-5)
    full = Motion(tones=(wheel, cooler), broadband=(TABLE,))

    def at(motion, trial=3):
        return realise_motion(motion, 0.1, Streams(8, trial)).at(time)

    np.testing.assert_array_equal(at(full), at(full))
    assert (at(full) != at(full, 4))[[0, -1], :2].all()
    silent = dataclasses.replace(wheel, rms_x=0.0)
    alone = at(Motion(tones=(silent, cooler)))
    np.testing.assert_allclose(at(full)[:, 1], alone[:, 1], rtol=1e-12)
    noise = at(Motion(broadband=(TABLE,)))[:, 0] + at(Motion(tones=(wheel,)))[:, 0]
    np.testing.assert_allclose(at(full)[:, 0], noise, rtol=1e-9)


def test_one_factor_scales_a_whole_spectrum():
    """The factor applies to angles, so that densities grow with its square.

    Without jitter, nothing is drawn.
    """
    time = np.linspace(-0.05, 0.05, 7)
    wheel, cooler = Tone(80.0, rms_x=1e-5), Tone(43.0, rms_y=2e-5, rms_z=3e-6, phase=0.3)
    motion = Motion(rate_z=0.01, tones=(wheel, cooler), broadband=(TABLE,))
    louder = Motion(
        rate_z=0.01,
        tones=(Tone(80.0, rms_x=3e-5), Tone(43.0, rms_y=6e-5, rms_z=9e-6, phase=0.3)),
        broadband=(Broadband("x", TABLE.frequency, tuple(9 * s for s in TABLE.density)),),
    )

    def at(motion, dither=()):
        return realise_motion(motion, 0.1, Streams(8, 3), dither).at(time)

    scaled = dataclasses.replace(motion, jitter_factor=3.0)
    np.testing.assert_allclose(at(scaled), at(louder), rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(blur(scaled, 0.1), blur(louder, 0.1), rtol=1e-12)
    np.testing.assert_allclose(jitter_rms(scaled, 0.1), jitter_rms(louder, 0.1), rtol=1e-12)
    dither = (Tone(0.25, rms_x=1e-3),)
    moved = at(Motion(), (Tone(1.0), Tone(1.0), *dither))  # the same stream of its phase
    np.testing.assert_allclose(at(scaled, dither), at(louder) + moved, rtol=1e-9, atol=1e-16)
    none = dataclasses.replace(motion, jitter_factor=0.0)
    assert not none.jitters
    assert not none.drawn
    np.testing.assert_array_equal(realise_motion(none, 0.1).at(time), time[:, None] * [0, 0, -0.01])


def test_trials_of_two_exposures_are_alike():
    """Common random numbers: a design with a longer exposure has nearly the same jitter."""
    time = np.linspace(-0.05, 0.05, 201)
    one, other = (
        realise_motion(Motion(broadband=(TABLE,)), exposure, Streams(8, 1)).at(time)[:, 0]
        for exposure in (0.1, 0.12)
    )
    assert np.corrcoef(one, other)[0, 1] > 0.99
