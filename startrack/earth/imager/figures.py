"""Ground resolution, swath, MTF, SNR, dynamic range and data rate of a channel in flight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from startrack.core import deg
from startrack.detector import Detector
from startrack.earth.atmosphere import Reach, Sight, radiance, refine
from startrack.earth.imager.band import Band
from startrack.earth.imager.parameters import Channel, exposure_of, smear
from startrack.optics import blur_transfer, pixel_transfer, pupil_transfer

GREY, WARM, SUN = 0.2, 300.0, 50 * deg  # the scene of the reference radiance; chosen by hand


@dataclass(frozen=True)
class Figures:
    """Performance of one channel over flat ground below.

    gsd               metre, footprint: side of a pixel projected on the ground
    sampling_across, sampling_along  metre between columns and between lines: ground sample
                      distances
    swath, field      metre; radian
    rayleigh          metre, on the ground: 1.22 lambda H / D
    mtf_across, mtf_along  1, at half a cycle per pixel: lens, blur, pixel, smear. The Nyquist
                      frequency of staggered lines is twice that, where the MTF of a pixel is 0
    radiance          watt / m^2 / sr / m, of the SNR
    electrons, noise  electron, of this radiance
    snr               1
    noise_radiance    watt / m^2 / sr / m, of the noise of this radiance
    saturation        watt / m^2 / sr / m that reaches the full-well capacity
    dynamics          1, dynamic range: full-well capacity over the noise in the dark
    period, clock     second between lines; pixel / second
    data_rate         bit / second
    """

    gsd: float
    sampling_across: float
    sampling_along: float
    swath: float
    field: float
    rayleigh: float
    mtf_across: float
    mtf_along: float
    radiance: float
    electrons: float
    noise: float
    snr: float
    noise_radiance: float
    saturation: float
    dynamics: float
    period: float
    clock: float
    data_rate: float


def figures(
    channel: Channel, band: Band, height: float, rate: float, light: float | None = None
) -> Figures:
    """Figures of one channel.

        footprint = H p / f,  swath = 2 H tan(field / 2),  MTF = lens x blur x pixel x smear

    Source: Krutz et al. (2011), section 2.1, and eq. (4).

    height  metre above the ground
    rate    radian / second of the ground below
    light   watt / m^2 / sr / m; None for that of `reference`
    Accuracy  model: flat ground; a lens without aberrations beyond its blur, at the mean
              wavelength.
    """
    optics, detector = channel.optics, channel.detector
    focal, pitch = optics.image_distance, detector.pitch
    footprint = height * pitch / focal
    half = math.atan(detector.columns / 2 * pitch / focal)
    wavelength = float(band.weight @ band.wavelength)
    square = pitch / focal / rate / (2 if channel.kind == "staggered" else 1)
    period = (channel.period or square) if detector.scan else 1 / detector.update_rate
    columns = footprint * detector.columns / channel.columns
    lines = period * rate * height if detector.scan else footprint
    exposure = exposure_of(channel, period)
    drift = smear(channel, period if detector.scan else 0.0, rate) * pitch
    per_radiance = channel.etendue() * exposure * band.electrons
    light = reference(band) if light is None else light
    electrons = per_radiance * light
    dark = detector.dark_rate * exposure
    noise = _noise(detector, electrons, dark)
    return Figures(
        footprint, columns, lines, 2 * height * math.tan(half), 2 * half,
        1.22 * wavelength * height / optics.aperture,
        sharpness(channel, wavelength, 0.0),
        sharpness(channel, wavelength, drift),
        light, electrons, noise, electrons / noise, noise / per_radiance,
        detector.full_well / per_radiance, detector.full_well / _noise(detector, 0.0, dark),
        period, channel.columns / period * (1 if detector.scan else detector.rows),
        channel.columns * detector.bits / period * (1 if detector.scan else detector.rows),
    )  # fmt: skip


def sharpness(channel: Channel, wavelength: float, drift: float) -> float:
    """MTF along one axis at half a cycle per pixel.

    drift  metre on the detector, of the image in an exposure
    """
    nyquist = np.array([0.5 / channel.detector.pitch])
    optics, side = channel.optics, channel.detector.pitch * math.sqrt(channel.detector.fill_factor)
    lens = pupil_transfer(nyquist, wavelength, optics.working_f_number)
    blur = blur_transfer(nyquist, math.hypot(optics.total_blur, channel.detector.diffusion))
    return float(
        (lens * blur * np.abs(pixel_transfer(nyquist, side) * pixel_transfer(nyquist, drift)))[0]
    )


def reference(band: Band) -> float:
    """Mean spectral radiance of grey land below: reflectance 0.2, 300 K, Sun at 50 deg from zenith.

    Returns  watt / m^2 / sr / m
    """
    ones = np.ones(1)
    geometry = 0.0, 0.0, SUN, math.pi / 2
    fine = refine(band.table, Reach(*((one, one) for one in geometry)))
    sight = Sight(*(one * ones for one in (*geometry, math.cos(SUN), 1.0, 1.0)))
    grey = np.full(1, GREY)
    return float(radiance(fine, sight, grey, grey, band.heat, WARM * ones).total[0, 0])


def _noise(detector: Detector, electrons: float, dark: float) -> float:
    """Electron rms: shot noise, read noise, quantisation, PRNU."""
    step = detector.electrons_per_dn
    return math.sqrt(
        electrons + dark + detector.noise**2 + step**2 / 12 + (detector.prnu * electrons) ** 2
    )
