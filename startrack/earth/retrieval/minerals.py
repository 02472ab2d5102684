"""Minerals: thermal spectra -> temperature, emissivity, Christiansen feature and class.

A spectrometer is one channel of the camera, whose filter is moved through the spectrum: a row of
its detector is the spectrum of a pixel.
"""

import math
import tomllib
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from startrack.core import (
    ALL,
    Floats,
    Ints,
    Parameters,
    Range,
    Refused,
    Streams,
    Unit,
    parameter,
    printed,
    um,
)
from startrack.detector import Detector, read_out, response
from startrack.earth.atmosphere import planck
from startrack.earth.geometry import ground_rate
from startrack.earth.imager import Channel, Survey, exposure_of
from startrack.io import from_table, shipped

NODES = 5  # wavelengths in a channel
COLDEST, HOTTEST, STEPS = 80.0, 1200.0, 1200  # kelvin; table of brightness temperatures
SMOOTHED = 5  # channels; their mean brightness temperature is taken as the ground's
FITTED = 4  # channels on each side of the largest emissivity, for the fit of a parabola
FINE = 1e-9  # metre, resolution of the Christiansen feature of the library
PLACES = 6  # number of ground temperatures in a forecast
DRAWS = 32  # nodes over the noise of a spectrum in a forecast


class MineralBand(Parameters):
    """A reststrahlen band of a mineral."""

    at: float = parameter(unit=Unit("m", "um"))
    width: float = parameter("half width, where the band falls to 1 / e", unit=Unit("m", "um"))
    depth: float = parameter("1, of the emissivity", limit=Range(0, 1))


class Mineral(Parameters):
    """The emissivity of a mineral by an assumed law; see catalogs/spectra/minerals.toml."""

    name: str
    centre: float = parameter(
        "wavelength of the Christiansen feature without bands", unit=Unit("m", "um")
    )
    rise: float = parameter("1 / um^2, curvature of the emissivity at shorter wavelengths")
    tail: float = parameter(
        "1, decrease of the emissivity at longer wavelengths", limit=Range(0, 1)
    )
    bands: tuple[MineralBand, ...] = ()

    def emissivity(self, wavelength: Floats, peak: float, contrast: float) -> Floats:
        """Emissivity (f,), with the depth of the library's bands times `contrast`."""
        short = np.minimum((wavelength - self.centre) / um, 0.0)
        long = np.maximum((wavelength - self.centre) / um, 0.0)
        lost = self.rise * short**2 + self.tail * (1 - np.exp(-(long**2)))
        for band in self.bands:
            lost = lost + band.depth * np.exp(-(((wavelength - band.at) / band.width) ** 2))
        return np.asarray(peak - contrast * lost, np.float64)


class Minerals(Parameters):
    """Separation of temperature and emissivity, and classification among minerals."""

    channel: str = parameter(
        "channel that gives the spectrometer its lens, exposure and detector", default="8um"
    )
    first: float = parameter(
        "shortest wavelength", unit=Unit("m", "um"), limit=Range(5 * um, 20 * um), default=7 * um
    )
    last: float = parameter(
        "longest wavelength", unit=Unit("m", "um"), limit=Range(5 * um, 20 * um), default=14 * um
    )
    step: float = parameter(
        "width and spacing of the spectral channels",
        unit=Unit("m", "nm"),
        limit=Range(5e-9, 1e-6),
        default=90e-9,
    )
    coldest: float = parameter(
        "lowest temperature of the ground", unit=Unit("K"), limit=Range(150, 800), default=450.0
    )
    hottest: float = parameter(
        "likewise, at most", unit=Unit("K"), limit=Range(150, 800), default=700.0
    )
    peak: float = parameter(
        "1, true emissivity of the ground at the Christiansen feature",
        limit=Range(0.5, 1),
        default=0.985,
    )
    assumed: float = parameter(
        "1, emissivity at the Christiansen feature that the retrieval assumes",
        limit=Range(0.5, 1),
        default=0.98,
    )
    contrast: float = parameter(
        "1, depth of the bands over the depth in the library; fine and weathered ground has less",
        limit=Range(0.01, 1),
        default=0.3,
    )
    pixels: int = parameter(
        "pixels of a trial's image; each has a spectrum", limit=Range(8, 2**12), default=128
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.coldest < self.hottest:
            raise Refused(
                f"coldest must be below hottest, {self.hottest:g} K, got {self.coldest:g} K"
            )
        if self.last - self.first < 3 * SMOOTHED * self.step:
            raise Refused(
                f"last must be above first by {3 * SMOOTHED} steps or more, got "
                f"{(self.last - self.first) / self.step:.1f}"
            )

    @property
    def wavelengths(self) -> Floats:
        """Centres (c,) of the spectral channels, metre."""
        count = math.floor((self.last - self.first) / self.step + 1e-9)
        return np.asarray(self.first + (np.arange(count) + 0.5) * self.step, np.float64)


@lru_cache(maxsize=1)
def library() -> tuple[Mineral, ...]:
    """The minerals of the catalogue."""
    text = shipped("spectra/minerals.toml").read_text(encoding="utf-8")
    return tuple(from_table(Mineral, row) for row in tomllib.loads(text)["minerals"])


@printed
class MineralSpectrometer(NamedTuple):
    """Constant inputs of the spectra of a design.

    detector      with a pixel in each row and a spectral channel in each column
    exposure      second
    wavelength    (c,) metre
    electrons     (c,) electron from a mean radiance of 1 watt / m^2 / sr / m
    temperature   (t,) kelvin
    blackbody     (t, c) watt / m^2 / sr / m, mean in each channel
    emissivity    (k, c) 1, of each mineral
    """

    detector: Detector
    exposure: float
    wavelength: Floats
    electrons: Floats
    temperature: Floats
    blackbody: Floats
    emissivity: Floats

    def radiance(self, temperature: Floats) -> Floats:
        """Radiance (n, c) of a blackbody at (n,) kelvin."""
        at = np.log(temperature / COLDEST) * (STEPS - 1) / math.log(HOTTEST / COLDEST)
        low = np.clip(at.astype(int), 0, STEPS - 2)
        part = (at - low)[:, None]
        between = (1 - part) * np.log(self.blackbody[low]) + part * np.log(self.blackbody[low + 1])
        return np.asarray(np.exp(between), np.float64)

    def brightness(self, radiance: Floats) -> Floats:
        """Brightness temperature (n, c) of (n, c) radiance, kelvin."""
        light = np.maximum(radiance, self.blackbody[0])
        columns = [
            np.interp(np.log(light[:, n]), np.log(self.blackbody[:, n]), np.log(self.temperature))
            for n in range(light.shape[1])
        ]
        return np.asarray(np.exp(np.stack(columns, 1)), np.float64)

    def noise(self, radiance: Floats) -> Floats:
        """Rms of the radiance of each channel, (n, c)."""
        detector, light = self.detector, self.electrons * radiance
        step = detector.electrons_per_dn
        dark = detector.dark_rate * self.exposure
        variance = detector.excess_noise * (light + dark) + detector.noise**2 + step**2 / 12
        return np.sqrt(variance + (detector.prnu * light) ** 2) / self.electrons

    @property
    def full(self) -> Floats:
        """Radiance (c,) of the largest digital number."""
        detector = self.detector
        charge = (2**detector.bits - 1 - detector.offset) * detector.electrons_per_dn
        dark = detector.dark_rate * self.exposure
        return (min(charge, detector.full_well) - dark) / self.electrons


def spectrometer_of(survey: Survey, minerals: Minerals) -> MineralSpectrometer:
    """Constant inputs of the spectra of a design.

    Raises  ValueError if the camera has no such channel, or the scene has air.
    """
    names = {channel.name: channel for channel in survey.camera.channels}
    if minerals.channel not in names:
        raise Refused(
            f"retrieval.minerals.channel must be a channel of the camera, {', '.join(names)}, got "
            f"{minerals.channel!r}"
        )
    if survey.air is not None:
        raise Refused("air must be left out: minerals are classified without an atmosphere")
    channel = names[minerals.channel]
    period = channel.sensor(1, ground_rate(survey.carrier)).dating(survey.carrier).period
    return _spectrometer(channel, minerals, exposure_of(channel, period))


@lru_cache(maxsize=8)
def _spectrometer(channel: Channel, own: Minerals, exposure: float) -> MineralSpectrometer:
    open_channel = replace(channel, band=ALL, passband=None)
    wavelength = own.wavelengths
    node, part = np.polynomial.legendre.leggauss(NODES)
    place = wavelength[:, None] + own.step / 2 * node
    answer = open_channel.photoelectrons(place.ravel()).reshape(place.shape) * (own.step / 2 * part)
    total = answer.sum(1)
    share = answer / total[:, None]
    temperature = np.geomspace(COLDEST, HOTTEST, STEPS)
    light = planck(place, temperature[:, None, None])
    middle = share * planck(place, math.sqrt(own.coldest * own.hottest))
    middle /= middle.sum(1, keepdims=True)
    spectra = [
        (mineral.emissivity(place, own.peak, own.contrast) * middle).sum(1) for mineral in library()
    ]
    scan = replace(channel.detector, scan=None, rows=own.pixels, columns=len(wavelength))
    return MineralSpectrometer(
        detector=scan,
        exposure=exposure,
        wavelength=wavelength,
        electrons=channel.etendue() * exposure * total,
        temperature=temperature,
        blackbody=(light * share).sum(-1),
        emissivity=np.array(spectra),
    )


class Observed(NamedTuple):
    """Spectra and their truth.

    mineral       (n,) of the library
    temperature   (n,) kelvin
    emissivity    (n, c) 1
    christiansen  (n,) metre, where the emissivity is largest
    radiance      (n, c) watt / m^2 / sr / m, as measured
    """

    mineral: Ints
    temperature: Floats
    emissivity: Floats
    christiansen: Floats
    radiance: Floats


def observe_minerals(survey: Survey, own: Minerals, seed: int, number: int) -> Observed:
    """The spectra of an image: random minerals at random temperatures."""
    device, streams = spectrometer_of(survey, own), Streams(seed, number)
    ground = streams("ground")
    mineral = ground.integers(0, len(library()), own.pixels)
    temperature = ground.uniform(own.coldest, own.hottest, own.pixels)
    emissivity = device.emissivity[mineral]
    electrons = device.electrons * emissivity * device.radiance(temperature)
    gain = response(device.detector)
    if gain is not None:
        electrons = electrons * gain
    dark = device.detector.dark_rate * device.exposure
    numbers = read_out(electrons + dark, device.detector, streams)
    charge = (numbers - float(device.detector.offset)) * device.detector.electrons_per_dn - dark
    true = christiansen_of_library(own)[mineral]
    return Observed(mineral, temperature, emissivity, true, charge / device.electrons)


def christiansen_of_library(own: Minerals) -> Floats:
    """Wavelength (k,) of the largest emissivity of each mineral, metre."""
    fine = np.arange(own.first, own.last, FINE)
    return np.array([fine[np.argmax(mineral.emissivity(fine, 1.0, 1.0))] for mineral in library()])


class Identified(NamedTuple):
    """Minerals, temperatures and emissivities retrieved from n spectra.

    temperature   (n,) kelvin
    emissivity    (n, c) 1
    christiansen  (n,) metre, where the emissivity is largest
    mineral       (n,) of the library
    """

    temperature: Floats
    emissivity: Floats
    christiansen: Floats
    mineral: Ints


def identify_minerals(survey: Survey, own: Minerals, radiance: Floats) -> Identified:
    """Temperature, emissivity, Christiansen feature and class of n spectra.

        T = max over channels of the mean over 5 of T_b(L / e_max),   e = L / B(T)
        class: least sum of ((e - e_k) / sigma)^2, after the best change of temperature

    Source: the normalised emissivity method (NEM), Gillespie (1985); Gillespie et al. (1998), IEEE
    Trans. Geosci. Remote Sensing 36, 1113.

    radiance  (n, c) watt / m^2 / sr / m
    """
    device = spectrometer_of(survey, own)
    temperature, _ = _temperature(device, own, radiance)
    black = device.radiance(temperature)
    emissivity = radiance / black
    sigma = device.noise(np.maximum(radiance, 0)) / black
    warmer = _warmer(device, temperature) / sigma
    rest = (emissivity[:, None] - device.emissivity) / sigma[:, None]
    along = device.emissivity * warmer[:, None]
    distance = (rest**2).sum(2) - (rest * along).sum(2) ** 2 / (along**2).sum(2)
    mineral = distance.argmin(1)
    return Identified(temperature, emissivity, _largest(device, emissivity), mineral)


def _temperature(
    device: MineralSpectrometer, own: Minerals, radiance: Floats
) -> tuple[Floats, Ints]:
    """Temperature (n,) in kelvin, and the middle (n,) of the channels that gave it."""
    bright = device.brightness(radiance / own.assumed)
    sums = np.cumsum(np.pad(bright, ((0, 0), (1, 0))), axis=1)
    means = (sums[:, SMOOTHED:] - sums[:, :-SMOOTHED]) / SMOOTHED
    best = means.argmax(1)
    return means[np.arange(len(best)), best], best + SMOOTHED // 2


def _warmer(device: MineralSpectrometer, temperature: Floats) -> Floats:
    """Relative derivative (n, c) of a blackbody's radiance with temperature, 1 / kelvin."""
    steps = [device.radiance(temperature + step) for step in (-0.5, 0.5)]
    return np.asarray(np.log(steps[1] / steps[0]))


def _largest(device: MineralSpectrometer, emissivity: Floats) -> Floats:
    """Vertex (n,) of a parabola through the channels around the largest mean of 5, metre."""
    kernel = np.ones(SMOOTHED) / SMOOTHED
    smooth = np.stack([np.convolve(row, kernel, "valid") for row in emissivity])
    best = smooth.argmax(1) + SMOOTHED // 2
    best = np.clip(best, FITTED, emissivity.shape[1] - 1 - FITTED)
    step = np.arange(-FITTED, FITTED + 1)
    around = emissivity[np.arange(len(best))[:, None], best[:, None] + step]
    square, slope, _ = np.polyfit(step, around.T, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(square < 0, -slope / (2 * square), 0.0)
    spacing = device.wavelength[1] - device.wavelength[0]
    return device.wavelength[best] + np.clip(vertex, -FITTED, FITTED) * spacing


@printed
class MineralForecast(NamedTuple):
    """Errors of retrieved minerals that the formulas predict.

    emissivity_error  1, rms over channels, minerals and temperatures
    wrong             1, fraction of misclassified spectra
    snr               1, of the channel in the middle, at the mean temperature
    """

    emissivity_error: float
    wrong: float
    snr: float


def forecast_minerals(survey: Survey, own: Minerals) -> MineralForecast:
    """Errors of emissivity and of classes.

        e' - e = L (1 + n) / B(T') - e,   T' of L (1 + n)
        right = product over others of Phi(d / 2)

    The mean square is taken over nodes of the noise n; d is the distance of two minerals over the
    noise, after the best change of temperature.

    Raises    ValueError as `spectrometer_of`.
    Accuracy  model: normal noise, independent between channels; confusions with each other mineral
              are independent. tests/earth/retrieval compares with trials.
    """
    device = spectrometer_of(survey, own)
    node, part = np.polynomial.legendre.leggauss(PLACES)
    kelvin = own.coldest + (own.hottest - own.coldest) * (node + 1) / 2
    count = len(device.emissivity)
    temperature, weight = np.tile(kelvin, count), np.tile(part / 2 / count, count)
    true = np.repeat(device.emissivity, PLACES, 0)
    light = true * device.radiance(temperature)
    noise = device.noise(light)
    noisy = np.minimum(light + noise * _normals(true.shape[1])[:, None], device.full)
    flat = noisy.reshape(-1, true.shape[1])
    found, _ = _temperature(device, own, flat)
    errors = (flat / device.radiance(found)).reshape(noisy.shape) - true
    error = math.sqrt(float((errors**2).mean((0, 2)) @ weight))
    sigma = noise / device.radiance(temperature)
    along = true * _warmer(device, temperature) / sigma
    right = np.ones(len(true))
    for other in device.emissivity:
        apart = (true - other) / sigma
        square = (apart**2).sum(1) - (apart * along).sum(1) ** 2 / (along**2).sum(1)
        same = np.abs(true - other).max(1) < 1e-12
        right *= np.where(same, 1.0, special.ndtr(np.sqrt(np.maximum(square, 0)) / 2))
    bright = (light >= device.full).any(1)  # saturated: no information
    right = np.where(bright, 1 / count, right)
    centre, middle = true.shape[1] // 2, PLACES // 2
    snr = float(light[middle, centre] / noise[middle, centre])
    return MineralForecast(error, float(weight @ (1 - right)), snr)


def _normals(channels: int) -> Floats:
    """Nodes (d, c) of a normal distribution, in pairs of opposite sign."""
    half = Streams(1, 0)("nodes of spectra").standard_normal((DRAWS // 2, channels))
    half /= np.sqrt((half**2).mean(0))
    return np.concatenate([half, -half])
