"""The read-out channel by an impulse response given as numbers, in signal and MTF."""

import numpy as np
import pytest

from startrack.core import Refused, Streams
from startrack.detector import Detector, read_channel, read_out, read_out_transfer
from startrack.detector.effects import impulse_weights, settle

PIXEL = {"columns": 40, "rows": 3, "pixel_pitch": 1e-5, "exposure": 0.1, "pixel_rate": 1e6}
LEVEL = np.random.default_rng(2).uniform(0, 1000, (3, 40))
RINGING = (0.2, 1.0, 0.4, -0.15, 0.05)


def test_it_is_numpys_convolution():
    """Beyond the beginning of a row, before which the channel has its first pixel's value."""
    detector = Detector(**PIXEL, impulse_response=RINGING)
    weights = np.array(RINGING) / sum(RINGING)
    found = read_channel(LEVEL, detector)
    for row, after in zip(LEVEL, found, strict=True):
        led = np.concatenate([np.full(4, row[0]), row])
        np.testing.assert_allclose(after, np.convolve(led, weights, "valid"), rtol=1e-12)
    np.testing.assert_allclose(read_channel(np.full((2, 9), 5.0), detector), 5.0)
    np.testing.assert_array_equal(read_channel(LEVEL, Detector(**PIXEL)), LEVEL)


def test_an_exponential_at_fine_steps_is_the_settling_channel():
    """Time constant 0.6 pixel, in steps of 0.05 pixel: exp(-1 / 0.6) remains in the next pixel."""
    time = np.arange(0, 12, 0.05)
    detector = Detector(**PIXEL, impulse_response=tuple(np.exp(-time / 0.6)), impulse_step=0.05e-6)
    rest = np.exp(-1 / 0.6)
    np.testing.assert_allclose(
        impulse_weights(detector)[:4], (1 - rest) * rest ** np.arange(4), rtol=1e-3
    )
    np.testing.assert_allclose(read_channel(LEVEL, detector), settle(LEVEL, rest), rtol=1e-3)
    slow = Detector(**PIXEL, settling=rest)
    frequency = np.linspace(0, 0.5, 6)
    np.testing.assert_allclose(
        read_out_transfer(detector, frequency), read_out_transfer(slow, frequency), rtol=1e-3
    )


@pytest.mark.parametrize("cycles", [0, 3, 10, 20])
def test_the_mtf_is_the_contrast_of_a_wave(cycles):
    detector = Detector(**PIXEL, impulse_response=RINGING)
    frequency = cycles / 40
    wave = np.cos(2 * np.pi * frequency * np.arange(400))
    after = read_channel(wave[None], detector)[0, 100:140]
    contrast = abs(np.fft.fft(after)[cycles]) / abs(np.fft.fft(wave[100:140])[cycles])
    assert read_out_transfer(detector, np.array([frequency]))[0] == pytest.approx(contrast)


def test_a_frame_is_read_through_it():
    electrons = np.full((3, 40), 100.0)
    electrons[:, 20] = 10100.0
    plain, smeared = (
        read_out(electrons, Detector(**PIXEL, impulse_response=given), Streams(1, 1)).astype(float)
        for given in ((), (0.0, 0.75, 0.25))
    )
    scale = (plain[:, 20] - plain[:, 0]).mean()
    tail = (smeared - plain[:, :1]).mean(0) / scale
    np.testing.assert_allclose(tail[19:24], [0, 0, 0.75, 0.25, 0], atol=0.02)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"impulse_response": (1.0, -1.0)}, "impulse_response must have a sum above 0"),
        ({"impulse_response": (1.0,), "settling": 0.1}, "settling must be left out if"),
        ({"impulse_step": 1e-9}, "impulse_step must be left out without impulse_response"),
        ({"impulse_response": (1.0,), "impulse_step": 1e-9}, "must have two values or more"),
        ({"impulse_response": (1.0, 0.5), "impulse_step": 1.0}, "over 1024 pixels or fewer"),
        ({"impulse_response": (1.0,) * 1025}, "must have 1024 values or fewer, got 1025"),
        ({"impulse_response": (float("nan"),)}, "impulse_response must be finite"),
    ],
)
def test_what_is_no_response_is_refused(values, message):
    with pytest.raises(Refused, match=message):
        Detector(**PIXEL, **values)
