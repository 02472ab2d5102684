"""Restored images against closed forms, the scene's truth, and the forecast of MTF and SNR."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from startrack import Refused
from startrack.core import Curve, Psf, nm
from startrack.earth.geometry import flight_height, ground_rate
from startrack.earth.imager import (
    Cover,
    Land,
    Picture,
    Restoration,
    band_of,
    figures,
    prepare,
    render,
)
from startrack.earth.product import ProductSettings, calibrate, make_product
from startrack.optics import Pupil, Segment, aperture_transfer, pixel_psf

from .test_product import flown

SNR = 5.0
GOLAY = Pupil(
    segments=tuple(
        Segment(0.62 * np.cos(turn), 0.62 * np.sin(turn), 0.38, "circle")
        for turn in np.radians([90.0, 210.0, 330.0]).tolist()
    )
)


@pytest.fixture(scope="module")
def scene():
    survey = flown(land=Land((Cover(Curve((), (0.3,))),), texture=0.3, texture_cell=20.0))
    channel = survey.channels[0]
    return survey, channel, prepare(survey, channel, Path())


def _boxed():
    """An image whose pixels are means over three by three pixels."""
    table = np.zeros((63, 63))
    table[18:45, 18:45] = 1 / 9
    return Restoration(Psf(table, 9, 1.0), 1.0, 1.0, SNR)


def test_a_wave_has_the_modulation_of_the_filter_and_noise_that_of_its_formula():
    """By hand: a box of three pixels multiplies a wave by sin(3 pi f) / (3 pi f)."""
    restoration, place, frequency = _boxed(), np.arange(128), 1 / 8
    left = np.sinc(3 * frequency)
    wave = 10 + left * np.cos(2 * np.pi * frequency * (place + 0.5)) * np.ones((128, 1))
    found = restoration.applied(wave)[32:96, 32:96]
    expected = left**2 * (1 + SNR**-2) / (left**2 + SNR**-2)
    assert np.sqrt(2) * found.std() == pytest.approx(expected, rel=0.01)
    assert found.mean() == pytest.approx(10.0, rel=1e-6)
    noise = np.random.default_rng(2).normal(0.0, 1.0, (256, 256))
    assert restoration.applied(noise).std() == pytest.approx(restoration.noise, rel=0.02)
    assert restoration.gain(1.125, 0.0) == pytest.approx(restoration.gain(0.125, 0.0))


def test_waves_of_a_sparse_aperture_come_back():
    """The blur is the overlap of the circles; the filter knows only the image of a point."""
    pitch, wave_at = 8e-6, np.array([600 * nm])
    optics = flown().channels[0].optics
    optics = replace(optics, f_number=16.0, pupil=GOLAY, psf="fraunhofer", blur=0.0)
    restoration = Restoration(pixel_psf(optics, pitch, wave_at, np.ones(1)), 1.0, 1.0, 100.0)
    place = np.arange(96)
    for frequency in (0.1, 0.25, 0.4):
        lens = aperture_transfer(optics, 600 * nm, np.array([frequency / pitch]), "x")[0]
        left = lens * np.sinc(frequency)
        image = 10 + left * np.cos(2 * np.pi * frequency * place) * np.ones((96, 1))
        found = restoration.applied(image)[24:72]
        back = 2 * ((found - 10) * np.cos(2 * np.pi * frequency * place))[:, 16:-16].mean()
        assert left < 0.6
        assert back == pytest.approx(1.0, abs=0.1)
        assert back == pytest.approx(left * restoration.gain(frequency, 0.0), abs=0.02)


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


def test_noise_of_a_restored_product_is_that_of_the_figures(scene):
    """From the difference of two images of one scene, restored as the channel states."""
    survey, _, _ = scene
    own = _blurred(survey.camera.channels[0])
    soft = replace(survey, camera=replace(survey.camera, channels=(own,)))
    pictures = [Picture.blank(own.detector.rows, own.columns) for _ in range(2)]
    for seed, picture in enumerate(pictures):
        setting = render(soft, own, Path(), seed, picture)
    frames, height = calibrate(soft, own, setting, 1), flight_height(soft.carrier)
    band, settings = band_of(own, soft.air, height, 1.0), ProductSettings(uncertainty=True)
    noises, told, said = [], [], []
    for restore in (None, 20.0):
        channel = replace(own, restore=restore)
        products = [
            make_product(soft, channel, Path(), picture.numbers, frames, settings)
            for picture in pictures
        ]
        radiance = [product.image["radiance"][4:-4, 4:-4] for product in products]
        noises.append((radiance[1] - radiance[0]).std())
        told.append(np.median(products[0].uncertainty["radiance"]["noise"]))
        said.append(figures(channel, band, height, ground_rate(soft.carrier)))
    assert said[1].amplified > 2
    assert said[1].noise == said[0].noise
    assert said[1].snr == pytest.approx(said[0].snr / said[1].amplified)
    assert said[1].mtf_across > 2 * said[0].mtf_across
    assert noises[1] / noises[0] == pytest.approx(said[1].amplified, rel=0.1)
    assert told[1] / told[0] == pytest.approx(said[1].amplified, rel=0.1)


def test_what_cannot_be_restored_is_refused(scene):
    _, channel, _ = scene
    with pytest.raises(ValueError, match="restore"):
        ProductSettings(restore=-1.0)
    with pytest.raises(ValueError, match="restore"):
        replace(channel, restore=0.0)
    with pytest.raises(Refused, match=r"average must be 1 where an image is restored, got 2"):
        replace(channel, restore=10.0, average=2)
