import dataclasses

import numpy as np
import pytest

from startrack.core.streams import Streams
from startrack.design.files import load_design
from startrack.io import shipped
from startrack.motion import Broadband, Motion, Tone, blur, sample_jitter, slew, stability
from startrack.observation.pointing import random_attitude
from startrack.trial.chain import observe

PIXEL = 1e-4
TABLE = Broadband("y", (0.05, 3.0, 300.0), (1e-8, 1e-8, 1e-12))
EXPOSURE = 0.1


def test_a_slew():
    path = slew(Motion(rate_x=0.02), EXPOSURE, PIXEL)
    found = stability(path)
    assert found.start == pytest.approx([0.001, 0, 0])
    assert found.end == pytest.approx([-0.001, 0, 0])
    assert found.mean == pytest.approx([0, 0, 0], abs=1e-17)
    assert found.rms == pytest.approx([0.002 / 12**0.5, 0, 0])
    np.testing.assert_allclose(blur(Motion(rate_x=0.02), EXPOSURE), found.rms, rtol=1e-12)


def test_drift_and_blur_of_a_spectrum_are_its_weighted_integrals():
    """Lucke, Sirlin and San Martin's weights, by the trapezoidal rule, over 60 trials.

    All within four standard errors, which are some 18 %.
    """
    motion = Motion(broadband=(TABLE,))
    trials = [
        stability(sample_jitter(motion, EXPOSURE, PIXEL, Streams(6, n), 0.1)) for n in range(60)
    ]
    f = np.geomspace(0.05, 300, 400001)
    s = np.exp(np.interp(np.log(f), np.log(TABLE.frequency), np.log(TABLE.density)))
    sinc, half = np.sinc(f * EXPOSURE), np.pi * f * EXPOSURE
    weights = {
        "mean": ((sinc - 1) ** 2, lambda t: t.mean),
        "rms": (1 - sinc**2, lambda t: t.rms),
        "drift": (4 * np.sin(half) ** 2, lambda t: t.end - t.start),
        "start": (4 * np.sin(half / 2) ** 2, lambda t: t.start),
    }
    for name, (weight, pick) in weights.items():
        square = np.array([pick(one)[1] for one in trials]) ** 2
        error = square.std() / np.sqrt(len(square))
        assert abs(square.mean() - np.trapezoid(s * weight, f)) < 4 * error, name
    expected = np.sqrt(np.trapezoid(s * (1 - sinc**2), f))
    np.testing.assert_allclose(blur(motion, EXPOSURE), [0, expected, 0], rtol=1e-6)


def test_slow_components_drift_and_fast_ones_blur():
    slow = Broadband("x", (1e-4, 1e-3), (1.0, 1.0))
    fast = Broadband("x", (1e4, 1e5), (1e-12, 1e-12))
    power = 9e-4
    # 1 - sinc^2 -> (pi f T)^2 / 3, whose mean over the band is 3.7e-7 (pi T)^2 / 3
    assert blur(Motion(broadband=(slow,)), EXPOSURE)[0] == pytest.approx(
        np.sqrt(power * 3.7e-7 * (np.pi * EXPOSURE) ** 2 / 3), rel=1e-6
    )
    assert blur(Motion(broadband=(fast,)), EXPOSURE)[0] == pytest.approx(3e-4, rel=1e-4)


@pytest.mark.parametrize("rms", [1e-4, 1e-7, 1e-12, 1e-16])
@pytest.mark.parametrize("frequency", [0.5, 7.0, 73.0, 730.0])
def test_a_known_tone_blurs_by_its_deviation_however_small(frequency, rms):
    """Against 200,000 equal steps in time, from a pixel down to amplitudes that no pixel
    resolves."""
    tone = Tone(frequency, rms_x=rms, phase=0.4)
    time = (np.arange(200_000) + 0.5) / 200_000 * EXPOSURE - EXPOSURE / 2
    wave = np.sqrt(2) * rms * np.cos(2 * np.pi * frequency * time + 0.4)
    found = blur(Motion(tones=(tone,)), EXPOSURE)
    assert found[0] == pytest.approx(wave.std(), rel=2e-6)
    assert found[1] == found[2] == 0


def test_tones_blur_as_their_trials_do():
    """With a drawn phase, the blur is the mean over evenly spaced phases."""
    tone = Tone(7.0, rms_x=1e-4, rms_z=5e-5)
    given = [
        blur(Motion(tones=(dataclasses.replace(tone, phase=p),)), EXPOSURE) ** 2
        for p in np.arange(16) / 16 * 2 * np.pi
    ]
    np.testing.assert_allclose(
        blur(Motion(tones=(tone,)), EXPOSURE) ** 2, np.mean(given, axis=0), rtol=1e-6
    )


def test_the_truth_is_the_middle_of_the_exposure():
    """A camera at the turning point of a slow swing: stars are seen at its mean place."""
    case = load_design(shipped("designs/noise_only.toml")).case
    swing = Motion(tones=(Tone(5.0, rms_y=4e-4, phase=0.0),))
    case = dataclasses.replace(case, instrument=dataclasses.replace(case.instrument, motion=swing))
    errors, means = [], []
    for n in range(12):
        streams = Streams(21, n)
        record = observe(case, random_attitude(streams), streams)
        found = stability(record.path)
        assert found.start == pytest.approx(found.end)
        assert found.start[1] == pytest.approx(4e-4 * 2**0.5 * (1 - np.cos(2 * np.pi * 0.2)))
        if record.outcome.solved and not record.outcome.false:
            errors.append(record.outcome.error_y)
            means.append(found.mean[1])
    spread = np.std(errors) / np.sqrt(len(errors))
    assert len(errors) > 8
    assert np.mean(means) > 50 * spread / 4  # so that the next line means something
    assert abs(np.mean(errors) - np.mean(means)) < 5 * spread


def test_what_moves_not_costs_no_draw_in_the_chain():
    """Jitter of zero amplitude, or too small for any pixel: the same frame."""
    case = load_design(shipped("designs/noise_only.toml")).case
    frames = []
    for size in (0.0, 1e-15):
        motion = Motion(tones=(Tone(30.0, rms_x=size),))
        one = dataclasses.replace(
            case, instrument=dataclasses.replace(case.instrument, motion=motion)
        )
        streams = Streams(4, 2)
        frames.append(observe(one, random_attitude(streams), streams).frame.image)
    np.testing.assert_array_equal(*frames)
