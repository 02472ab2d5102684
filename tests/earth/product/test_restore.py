"""Restored images: against a convolution by scipy, a transfer by hand, and the scene's truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from startrack import Refused
from startrack.core import Curve, Psf
from startrack.earth.imager import Cover, Land, Picture, prepare, render
from startrack.earth.product import ProductSettings, calibrate, make_product
from startrack.earth.product.restore import restored
from startrack.optics import restored_noise, restored_transfer

from .test_product import SCAN, flown


@pytest.fixture(scope="module")
def scene():
    survey = flown(land=Land((Cover(Curve((), (0.3,))),), texture=0.3, texture_cell=20.0))
    channel = survey.channels[0]
    return survey, channel, prepare(survey, channel, Path())


def _boxed(setting):
    """A pixel that sees a square of three pixels."""
    table = np.zeros((15, 15))
    table[3:12, 3:12] = 1 / 9
    return setting._replace(psf=Psf(table, 3, 1.0), smear=0.0)


def test_what_was_blurred_comes_back(scene):
    """Half of the light in the pixel itself, the rest in the eight around it."""
    _, channel, setting = scene
    table = np.zeros((15, 15))
    table[3:12, 3:12] = 1 / 16
    table[6:9, 6:9] = 1 / 2
    setting = setting._replace(psf=Psf(table, 3, 1.0), smear=0.0)
    kernel = np.full((3, 3), 1 / 16)
    kernel[1, 1] = 1 / 2
    truth = np.random.default_rng(1).normal(10.0, 1.0, (64, 64))
    blurred = signal.convolve2d(truth, kernel, "same", "symm")
    inside = np.s_[8:-8, 8:-8]
    before = (blurred - truth)[inside].std()
    after = (restored(blurred, channel, setting, 1e3) - truth)[inside].std()
    assert after < 0.01 * before


def test_a_wave_has_the_modulation_of_the_filter_and_noise_that_of_its_formula(scene):
    """By hand: a box of three pixels leaves (1 + 2 cos(2 pi f)) / 3 of a wave."""
    _, channel, setting = scene
    place, frequency, snr = np.arange(128), 1 / 8, 5.0
    left = (1 + 2 * np.cos(2 * np.pi * frequency)) / 3
    wave = 10 + left * np.cos(2 * np.pi * frequency * (place + 0.5)) * np.ones((128, 1))
    found = restored(wave, channel, _boxed(setting), snr)[32:96, 32:96]
    expected = restored_transfer(np.array(left), snr) * (1 + snr**-2)
    assert np.sqrt(2) * found.std() == pytest.approx(float(expected), rel=0.01)
    assert found.mean() == pytest.approx(10.0, rel=1e-6)
    noise = np.random.default_rng(2).normal(0.0, 1.0, (256, 256))
    down = np.fft.fftfreq(256)[:, None]
    both = [(1 + 2 * np.cos(2 * np.pi * part)) / 3 for part in (down, down.T)]
    gain = restored_noise(both[0] * both[1], snr) * (1 + snr**-2)
    assert restored(noise, channel, _boxed(setting), snr).std() == pytest.approx(gain, rel=0.03)


@pytest.mark.slow
def test_a_product_that_is_restored_is_nearer_to_its_scene(scene):
    survey, channel, setting = scene
    soft = replace(survey, camera=replace(survey.camera, channels=(_blurred(channel),)))
    channel = soft.channels[0]
    picture = Picture.blank(channel.detector.rows, channel.columns)
    setting = render(soft, channel, Path(), 1, picture)
    frames = calibrate(soft, channel, setting, 1)
    truth = picture.terms.total
    errors = []
    for restore in (None, 30.0):
        settings = ProductSettings(restore=restore)
        found = make_product(soft, channel, Path(), picture.numbers, frames, settings)
        errors.append((found.image["radiance"] - truth)[5:-5, 5:-5].std())
    assert errors[1] < 0.8 * errors[0]


def _blurred(channel):
    return replace(channel, optics=replace(channel.optics, blur=25e-6))


def test_what_cannot_be_restored_is_refused(scene):
    _, channel, setting = scene
    with pytest.raises(Refused, match="uncertainty"):
        ProductSettings(uncertainty=True, restore=10.0)
    with pytest.raises(ValueError, match="restore"):
        ProductSettings(restore=-1.0)
    with pytest.raises(Refused, match="lens_file"):
        restored(np.ones((8, 8)), channel, setting._replace(psf=None), 10.0)
    assert SCAN.columns == 40
