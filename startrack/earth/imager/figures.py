"""Resolution, swath, MTF, SNR and data rate of a channel in flight; first parameters from goals."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from startrack import core
from startrack.core import NON_NEGATIVE, POSITIVE, Parameters, Range, Unit, deg, parameter, um
from startrack.detector import Detector, read_out_transfer
from startrack.earth.atmosphere import Reach, SlantPath, radiance, refine
from startrack.earth.geometry import fly, ground_rate
from startrack.earth.imager.band import INFRARED, Band, band_of
from startrack.earth.imager.lens import field_lens, image_pixels
from startrack.earth.imager.parameters import (
    Channel,
    Performance,
    Survey,
    exposure_of,
    smear,
    stage_drift,
)
from startrack.earth.imager.restore import Restoration, restoration_of
from startrack.earth.terrain import geodetic
from startrack.optics import (
    aperture_transfer,
    blur_transfer,
    modulation,
    pixel_transfer,
    pupil_transfer,
)
from startrack.space import GM

PLACES = 17  # places along a line; the lowest MTF counts
GREY, WARM, SUN = 0.2, 300.0, 50 * deg  # the scene of the reference radiance; chosen by hand
MEAN_RADIUS = 6371e3  # metre, mean
SLOWEST, FASTEST = 200.0, 0.5  # f-numbers of the search; f/0.5 is the limit of a lens in air


@dataclass(frozen=True)
class Figures:
    """Performance of one channel over flat ground below.

    gsd               metre, footprint: side of a pixel projected on the ground
    sampling_across, sampling_along  metre between columns and between lines: ground sample
                      distances
    swath, field      metre; radian
    rayleigh          metre, on the ground: 1.22 lambda H / D
    mtf_across, mtf_along  1, at half a cycle per pixel, or per `average` pixels: lens, blur, pixel,
                      smear; across also the read-out channel; along also a mismatch between the
                      line rate of a TDI detector and the ground. The Nyquist frequency of staggered
                      lines is twice that frequency; a pixel's MTF is 0 there. A lens table gives
                      the lowest MTF over the field. With `restore` the MTF is after the filter; it
                      may exceed 1 because of aliasing
    illumination      1, illumination of the darkest pixel over illumination of the middle; None
                      without a lens table. SNR and saturation are for the middle
    radiance          watt / m^2 / sr / m, radiance for the SNR
    electrons, noise  electron, signal and noise at this radiance
    amplified         1, noise after the filter of `restore` over noise before; 1 without a filter
    snr               1, for the mean of `average` columns and after the filter, as are all figures
                      below
    noise_radiance    watt / m^2 / sr / m, noise-equivalent radiance
    nedt              kelvin, noise-equivalent temperature difference of a blackbody at the
                      reference temperature (300 K if not given); None below 3 micrometre
    saturation        watt / m^2 / sr / m, radiance at full-well capacity or at the largest number
    dynamics          1, dynamic range: full-well capacity over the noise in the dark
    period, clock     second between lines; pixel / second
    data_rate         bit / second
    ahead             pixel, lead of the ground over the charge after all stages of a TDI detector;
                      it blurs along the track; 0 for other detectors
    """

    gsd: float
    sampling_across: float
    sampling_along: float
    swath: float
    field: float
    rayleigh: float
    mtf_across: float
    mtf_along: float
    illumination: float | None
    radiance: float
    electrons: float
    noise: float
    amplified: float
    snr: float
    noise_radiance: float
    nedt: float | None
    saturation: float
    dynamics: float
    period: float
    clock: float
    data_rate: float
    ahead: float


def figures(
    channel: Channel, band: Band, height: float, rate: float, light: float | None = None
) -> Figures:
    """Figures of one channel.

        footprint = H p / f,  swath = 2 H tan(field / 2),  MTF = lens x blur x pixel x smear

    Source: Krutz et al. (2011), section 2.1, and eq. (4).

    height  metre above the ground
    rate    radian / second, angular rate of the ground below
    light   watt / m^2 / sr / m; None: the channel's reference light, else the radiance of
            `reference`
    Raises    ValueError as `field_lens`, where a lens table does not contain the field or the band.
    Accuracy  model: flat ground. Without a lens table: the lens at the mean wavelength on the axis,
              with its pupil, its segments and aberrations that are constant over the field.
    """
    optics, detector = channel.optics, channel.detector
    focal, pitch = optics.image_distance, detector.pitch
    footprint = height * pitch / focal
    half = math.atan(detector.columns / 2 * pitch / focal)
    wavelength = float(band.weight @ band.wavelength)
    square = pitch / focal / rate / (2 if channel.kind == "staggered" else 1)
    period = (channel.period or square) if detector.scan else 1 / detector.update_rate
    columns = footprint * channel.average * detector.columns / channel.columns
    lines = period * rate * height if detector.scan else footprint
    exposure = exposure_of(channel, period)
    drift = smear(channel, period if detector.scan else 0.0, rate) * pitch
    per_radiance = channel.etendue() * exposure * band.electrons
    light = _light(channel, band) if light is None else light
    electrons = per_radiance * light
    dark = detector.dark_rate * exposure
    noise = _noise(detector, electrons, dark)
    mean_noise = noise / math.sqrt(channel.average)
    ahead = stage_drift(channel, period, rate)
    mtf = _lowest_modulation(channel, band, rate, drift, ahead)
    if channel.restore is not None:
        lens = field_lens(channel, channel.sensor(1, rate), optics, band.wavelength, band.weight)
        restoration = restoration_of(
            channel, lens.images, drift / detector.pitch, lines / footprint, channel.restore
        )
        mtf = mtf.restored(restoration)
    mean_noise *= mtf.amplified
    rows = 1 if detector.scan else detector.rows  # that are read in a period
    numbers = 2**detector.bits - 1
    full = detector.full_well * min(1.0, (1 - detector.offset / numbers) / detector.gain)
    return Figures(
        gsd=footprint,
        sampling_across=columns,
        sampling_along=lines,
        swath=2 * height * math.tan(half),
        field=2 * half,
        rayleigh=1.22 * wavelength * height / optics.aperture,
        mtf_across=mtf.across,
        mtf_along=mtf.along,
        illumination=mtf.illumination,
        radiance=light,
        electrons=electrons,
        noise=noise,
        amplified=mtf.amplified,
        snr=electrons / mean_noise,
        noise_radiance=mean_noise / per_radiance,
        nedt=_temperature_step(channel, band, mean_noise / per_radiance),
        saturation=full / per_radiance,
        dynamics=detector.full_well / _noise(detector, 0.0, dark),
        period=period,
        clock=channel.columns / period * rows,
        data_rate=channel.columns * detector.bits / period * rows,
        ahead=ahead * (channel.stages - 1),
    )


class _Modulation(NamedTuple):
    """Lowest MTF across and along at half a cycle per pixel, and what the lens does over the field.

    illumination  lowest over that in the middle; None without a lens table
    amplified     factor on the noise by the filter of `restore`
    """

    across: float
    along: float
    illumination: float | None
    amplified: float = 1.0

    def restored(self, restoration: Restoration) -> _Modulation:
        """The same after a restoring filter."""
        return self._replace(
            across=self.across * restoration.gain(0.5, 0.0),
            along=self.along * restoration.gain(0.0, 0.5),
            amplified=restoration.noise,
        )


def _lowest_modulation(
    channel: Channel, band: Band, rate: float, drift: float, ahead: float
) -> _Modulation:
    """MTF of lens, pixel, motion and read-out, before a restoring filter.

    drift  metre on the detector, motion of the image in an exposure
    ahead  pixel, lead of the ground over the charge after one stage of a TDI detector
    """
    if channel.optics.tabulated:
        across, along, illumination = _lens_over_field(channel, band, rate, drift)
    else:
        wavelength = float(band.weight @ band.wavelength)
        across = sharpness(channel, wavelength, "x", merged=channel.average)
        along, illumination = sharpness(channel, wavelength, "y", drift), None
    across *= _read_out(channel)
    along *= _mean_of_phases(math.pi / channel.average * ahead, channel.stages)
    return _Modulation(across, along, illumination)


def figures_of(survey: Survey) -> Iterator[tuple[Channel, float, Figures]]:
    """Each channel of a survey's camera, its height in metre at the epoch, and its figures.

    The reference light of a channel is the light at the lens.
    """
    carrier = survey.carrier
    height = float(geodetic(fly(carrier, np.zeros(1)).position)[2][0])
    rate = ground_rate(carrier)
    for channel in survey.camera.channels:
        air = None if channel.reference else survey.air
        band = band_of(channel, air, height, survey.distance_to_sun)
        yield channel, height, figures(channel, band, height, rate)


def margins_of(channel: Channel, predicted_figures: Figures) -> dict[str, float]:
    """Relative margin of each requirement of a channel; a requirement is met where its margin is 0
    or more.

    GSD and NEdT have upper limits. A light that saturates has no SNR.
    """
    full = predicted_figures.radiance > predicted_figures.saturation
    predicted = {
        "snr": 0.0 if full else predicted_figures.snr,
        "nedt": predicted_figures.nedt,
        "mtf": min(predicted_figures.mtf_across, predicted_figures.mtf_along),
        "saturation": predicted_figures.saturation,
        "gsd": predicted_figures.sampling_across,
    }
    margins = {}
    for name, limit in known(channel.required).items():
        value = predicted[name]
        if value is None:
            raise ValueError(f"channel {channel.name}: required.{name} must be left out below 3 um")
        margins[name] = (value / limit - 1) * (-1 if name in ("nedt", "gsd") else 1)
    return margins


def known(performance: Performance) -> dict[str, float]:
    """The given values by name."""
    return {name: value for name, value in vars(performance).items() if value is not None}


def sharpness(
    channel: Channel, wavelength: float, along: str, drift: float = 0.0, merged: int = 1
) -> float:
    """MTF along one axis at half a cycle per pixel, or per `average` pixels.

    along   "x" or "y", along columns or rows
    drift   metre on the detector, motion of the image in an exposure
    merged  number of averaged pixels along this axis
    """
    nyquist = np.array([0.5 / channel.detector.pitch / channel.average])
    optics, side = channel.optics, channel.detector.pitch * math.sqrt(channel.detector.fill_factor)
    if optics.plain:
        lens = pupil_transfer(nyquist, wavelength, optics.working_f_number)
    else:
        lens = aperture_transfer(optics, wavelength, nyquist, along)
    blur = blur_transfer(nyquist, math.hypot(optics.total_blur, channel.detector.diffusion))
    mean = _merged(channel) if merged > 1 else 1.0
    both = pixel_transfer(nyquist, side) * pixel_transfer(nyquist, drift)
    return float((lens * blur * np.abs(both))[0] * mean)


def _read_out(channel: Channel) -> float:
    """MTF of the read-out channel across, at the same frequency."""
    nyquist = 0.5 / channel.average * channel.detector.columns / channel.columns
    return float(read_out_transfer(channel.detector, np.array([nyquist]))[0])


def _lens_over_field(
    channel: Channel, band: Band, rate: float, drift: float
) -> tuple[float, float, float]:
    """Lowest MTF across and along, and lowest illumination, over the field of a lens table."""
    sensor = channel.sensor(1, rate)
    lens = field_lens(channel, sensor, channel.optics, band.wavelength, band.weight)
    assert isinstance(lens.images, core.FieldPsf)
    assert lens.light is not None
    columns, rows = image_pixels(channel, sensor)
    nyquist = np.array([0.5 / channel.average])
    colour, modulations = float(lens.images.colour[0]), []
    for y in np.unique(rows[[0, len(rows) // 2, -1]]).tolist():
        for x in np.linspace(columns[0], columns[-1], PLACES).tolist():
            image = lens.images.image(x, y, colour)[0]
            values = [modulation(image, nyquist, turn)[0] for turn in (0.0, math.pi / 2)]
            modulations.append(np.array(values) / image.energy)
    across, along = np.min(modulations, axis=0)
    along *= abs(pixel_transfer(nyquist / channel.detector.pitch, drift)[0])
    middle = lens.light[len(rows) // 2, channel.columns // 2]
    return float(across * _merged(channel)), float(along), float(lens.light.min() / middle)


def _merged(channel: Channel) -> float:
    """MTF of the mean of `average` columns at their Nyquist frequency."""
    return _mean_of_phases(math.pi / channel.average, channel.average)


def _mean_of_phases(step: float, count: int) -> float:
    """Modulus of the mean of waves whose phases differ by a step in radian."""
    return float(abs(np.mean(np.exp(1j * step * np.arange(count)))))


def reference(band: Band) -> float:
    """Mean spectral radiance of grey land below: reflectance 0.2, 300 K, Sun at 50 deg from zenith.

    Returns  watt / m^2 / sr / m
    """
    ones = np.ones(1)
    geometry = 0.0, 0.0, SUN, math.pi / 2
    fine = refine(band.table, Reach(*((angle, angle) for angle in geometry)))
    sight = SlantPath(*(value * ones for value in (*geometry, math.cos(SUN), 1.0, 1.0)))
    grey = np.full(1, GREY)
    return float(radiance(fine, sight, grey, grey, band.heat, WARM * ones).total[0, 0])


def _light(channel: Channel, band: Band) -> float:
    """Radiance (watt / m^2 / sr / m) of a channel's required SNR, else the radiance of grey
    land."""
    wanted = channel.reference
    if wanted is None:
        return reference(band)
    if wanted.radiance is not None:
        return wanted.radiance
    if band.heat is None:
        raise ValueError(
            f"channel {channel.name}: reference.temperature must be left out below "
            f"{INFRARED / 2 / um:.1f} um, got {wanted.temperature:g} K"
        )
    return float(band.heat(np.array([wanted.temperature]))[0, 0])


def _temperature_step(channel: Channel, band: Band, step: float) -> float | None:
    """Change of temperature (kelvin) that changes a blackbody's radiance in front of the lens by
    `step`."""
    if band.heat is None or float(band.weight @ band.wavelength) < INFRARED:
        return None
    wanted = channel.reference.temperature if channel.reference else None
    near = (WARM if wanted is None else wanted) + np.array([-0.5, 0.5])
    return float(step / np.diff(band.heat(near)[:, 0])[0])


def _noise(detector: Detector, electrons: float, dark: float) -> float:
    """Electron rms: shot noise, read noise, quantisation, PRNU."""
    step = detector.electrons_per_dn
    return math.sqrt(
        detector.excess_noise * (electrons + dark)
        + detector.noise**2
        + step**2 / 12
        + (detector.prnu * electrons) ** 2
    )


class Goals(Parameters):
    """Requirements on a line camera, and its detector."""

    gsd: float = parameter(
        "ground sample distance, along and across", unit=Unit("m"), limit=POSITIVE
    )
    swath: float = parameter(unit=Unit("m", "km"), limit=POSITIVE)
    height: float = parameter("of the orbit", unit=Unit("m", "km"), limit=POSITIVE)
    wavelength: float = parameter("of the band", unit=Unit("m", "nm"), limit=POSITIVE)
    bandwidth: float = parameter("of the band", unit=Unit("m", "nm"), limit=POSITIVE)
    radiance: float = parameter(unit=Unit("W / (m2 sr m)", "W / (m2 sr um)"), limit=POSITIVE)
    snr: float = parameter("required signal-to-noise ratio at this radiance", limit=POSITIVE)
    mtf: float = parameter(
        "MTF at Nyquist along the track, pixel and smear included",
        limit=Range(0.001, 0.99),
        default=0.1,
    )
    pixel_pitch: float = parameter(
        "of the detector", unit=Unit("m", "um"), limit=POSITIVE, default=10e-6
    )
    read_noise: float = parameter(
        "of the detector", unit=Unit("electron"), limit=NON_NEGATIVE, default=30.0
    )
    bits: int = parameter("of the detector", limit=Range(1, 24), default=12)
    stages: int = parameter("of the detector", limit=Range(1, 4096), default=1)
    efficiency: float = parameter(
        "electron / photon, quantum efficiency, with lens and filter",
        limit=Range(0.001, 1),
        default=0.4,
    )
    smear: float = parameter(
        "pixel, motion of the ground in an exposure: exposure as a fraction of the line period",
        limit=Range(0.001, 1),
        default=1.0,
    )
    ground_speed: float | None = parameter(
        "speed over ground; None: a circular orbit around the Earth",
        unit=Unit("m / s"),
        limit=POSITIVE,
        default=None,
    )

    @property
    def speed(self) -> float:
        """Speed over ground, metre / second."""
        if self.ground_speed is not None:
            return self.ground_speed
        axis = MEAN_RADIUS + self.height
        return math.sqrt(GM / axis) * MEAN_RADIUS / axis


@dataclass(frozen=True)
class First:
    """First parameters of a camera.

    focal_length  metre
    aperture      metre, largest of the three below
    for_rayleigh, for_mtf, for_snr  metre, aperture that each requires
    f_number      1
    columns       pixel in a line
    period        second between lines
    exposure      second of a line
    clock         pixel / second
    data_rate     bit / second
    electrons     electron from the radiance at this aperture
    """

    focal_length: float
    aperture: float
    for_rayleigh: float
    for_mtf: float
    for_snr: float
    f_number: float
    columns: int
    period: float
    exposure: float
    clock: float
    data_rate: float
    electrons: float


def first_parameters(goals: Goals) -> First:
    """The smallest camera that meets its goals.

        f = p H / GSD,   D >= 1.22 lambda H / GSD  (Rayleigh)
        MTF(lens) 2 / pi sinc(smear / 2) >= goal
        N / sqrt(N + stages read^2) >= SNR,  N by eq. (4)

    Source: Krutz et al. (2011), section 2.1, and eq. (4).

    Raises    ValueError if no lens meets the MTF, or the SNR needs a lens faster than f/0.5.
    Accuracy  model: one wavelength, a lens without aberrations, a fill factor of 1.
    """
    focal = goals.pixel_pitch * goals.height / goals.gsd
    period = goals.gsd / goals.speed
    exposure = goals.smear * period
    wanted = _electrons_for(goals)
    # Equation (4) at one wavelength, for all stages, over the square of the aperture.
    etendue = math.pi / 4 * (1.0 / focal) ** 2 * goals.pixel_pitch**2
    photons = goals.radiance * goals.bandwidth * goals.wavelength / (core.PLANCK * core.LIGHT_SPEED)
    per_area = etendue * photons * goals.efficiency * exposure * goals.stages
    apertures = (
        1.22 * goals.wavelength * goals.height / goals.gsd,
        focal / _slowest_sharp(goals),
        math.sqrt(wanted / per_area),
    )
    aperture = max(apertures)
    if focal / aperture < FASTEST:
        raise ValueError(
            f"the goals must leave a lens of f/{FASTEST:g} or slower, got f/{focal / aperture:.2f} "
            f"for a focal length of {focal:.4g} m"
        )
    columns = math.ceil(goals.swath / goals.gsd)
    clock = columns / period
    return First(
        focal,
        aperture,
        *apertures,
        focal / aperture,
        columns,
        period,
        exposure,
        clock,
        clock * goals.bits,
        per_area * aperture**2,
    )


def _electrons_for(goals: Goals) -> float:
    """The root of N = SNR sqrt(N + stages read^2)."""
    square = goals.snr**2
    read = goals.stages * goals.read_noise**2
    return (square + math.sqrt(square**2 + 4 * square * read)) / 2


def _slowest_sharp(goals: Goals) -> float:
    """The largest f-number that meets the MTF requirement."""
    nyquist = np.array([0.5 / goals.pixel_pitch])
    fixed = pixel_transfer(nyquist, goals.pixel_pitch)
    fixed = fixed * pixel_transfer(nyquist, goals.smear * goals.pixel_pitch)

    def surplus(f_number: float) -> float:
        lens = pupil_transfer(nyquist, goals.wavelength, f_number)
        return float((lens * fixed)[0]) - goals.mtf

    if surplus(FASTEST) < 0:
        raise ValueError(
            f"mtf must be at most {float(fixed[0]):.3f}, which pixel and smear leave, "
            f"got {goals.mtf:g}"
        )
    if surplus(SLOWEST) > 0:
        return SLOWEST
    return float(brentq(surplus, FASTEST, SLOWEST, xtol=1e-9))
