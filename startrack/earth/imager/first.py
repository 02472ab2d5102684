"""First parameters of a camera from goals: focal length, aperture, pixel rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.optimize import brentq

from startrack.core import LIGHT_SPEED, PLANCK, Unit, non_negative, positive, whole, within
from startrack.optics import pixel_transfer, pupil_transfer

EARTH_GRAVITY = 3.986004418e14  # m^3 / s^2, IERS conventions 2010
EARTH_RADIUS = 6371e3  # metre, mean
SLOWEST, FASTEST = (
    200.0,
    0.5,
)  # range of f-numbers of the search; f/0.5 is the limit of a lens in air


@dataclass(frozen=True)
class Goals:
    """Requirements on a line camera, and its detector.

    gsd, swath     metre on the ground; gsd between pixels, along and across
    height         metre of the orbit
    wavelength, bandwidth  metre, of the band
    radiance, snr  watt / m^2 / sr / m, and its required signal-to-noise ratio
    mtf            1, at Nyquist along the track, pixel and smear included
    pixel_pitch, read_noise, bits, stages  of the detector
    efficiency     electron / photon, lens and filter included
    smear          pixel that the ground moves in an exposure, as a fraction of the line period
    ground_speed   metre / second; None for a circular orbit around the Earth
    """

    gsd: Annotated[float, Unit("m")]
    swath: Annotated[float, Unit("m", "km")]
    height: Annotated[float, Unit("m", "km")]
    wavelength: Annotated[float, Unit("m", "nm")]
    bandwidth: Annotated[float, Unit("m", "nm")]
    radiance: Annotated[float, Unit("W / (m2 sr m)", "W / (m2 sr um)")]
    snr: float
    mtf: float = 0.1
    pixel_pitch: Annotated[float, Unit("m", "um")] = 10e-6
    read_noise: Annotated[float, Unit("electron")] = 30.0
    bits: int = 12
    stages: int = 1
    efficiency: float = 0.4
    smear: float = 1.0
    ground_speed: Annotated[float | None, Unit("m / s")] = None

    def __post_init__(self) -> None:
        positive(
            gsd=self.gsd, swath=self.swath, height=self.height, wavelength=self.wavelength,
            bandwidth=self.bandwidth, radiance=self.radiance, snr=self.snr,
            pixel_pitch=self.pixel_pitch,
        )  # fmt: skip
        non_negative(read_noise=self.read_noise)
        within(0.001, 0.99, mtf=self.mtf)
        within(0.001, 1, efficiency=self.efficiency)
        within(0.001, 1, smear=self.smear)
        whole(1, 24, bits=self.bits)
        whole(1, 4096, stages=self.stages)
        if self.ground_speed is not None:
            positive(ground_speed=self.ground_speed)

    @property
    def speed(self) -> float:
        """Metre / second over ground."""
        if self.ground_speed is not None:
            return self.ground_speed
        axis = EARTH_RADIUS + self.height
        return math.sqrt(EARTH_GRAVITY / axis) * EARTH_RADIUS / axis


@dataclass(frozen=True)
class First:
    """First parameters of a camera.

    focal_length  metre
    aperture      metre, the largest of the three below
    for_rayleigh, for_mtf, for_snr  metre, aperture that each requires
    f_number      1
    columns       pixel of a line
    period        second between lines
    exposure      second of a line
    clock         pixel / second
    data_rate     bit / second
    electrons     electron of the radiance at this aperture
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

    Raises    ValueError where no lens meets the MTF, or the SNR needs one faster than f/0.5.
    Accuracy  model: one wavelength, a lens without aberrations, a fill factor of 1.
    """
    focal = goals.pixel_pitch * goals.height / goals.gsd
    period = goals.gsd / goals.speed
    exposure = goals.smear * period
    wanted = _electrons_for(goals)
    per_area = _electrons(goals, focal, 1.0, exposure)
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
        focal, aperture, *apertures, focal / aperture, columns, period, exposure, clock,
        clock * goals.bits, per_area * aperture**2,
    )  # fmt: skip


def _electrons(goals: Goals, focal: float, aperture: float, exposure: float) -> float:
    """Equation (4) at one wavelength, summed over all stages."""
    etendue = math.pi / 4 * (aperture / focal) ** 2 * goals.pixel_pitch**2
    photons = goals.radiance * goals.bandwidth * goals.wavelength / (PLANCK * LIGHT_SPEED)
    return etendue * photons * goals.efficiency * exposure * goals.stages


def _electrons_for(goals: Goals) -> float:
    """The root of N = SNR sqrt(N + stages read^2)."""
    square = goals.snr**2
    read = goals.stages * goals.read_noise**2
    return (square + math.sqrt(square**2 + 4 * square * read)) / 2


def _slowest_sharp(goals: Goals) -> float:
    """The largest f-number that meets the MTF."""
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
