"""Uncertainty of each pixel of a product by contributors, from the uncertainties of inputs."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats
from startrack.earth.imager import HAZIEST, Channel, Knowledge, Setting, Survey, band_of
from startrack.earth.product import retrieval
from startrack.earth.terrain import Ground

# The contributors of S2-RUT, and contributors of the surface.
CAUSES = (
    "noise",
    "calibration",
    "straylight",
    "spectral response",
    "atmosphere",
    "terrain",
    "registration",
    "surroundings",
)
WARM = np.array([290.0])  # kelvin, ground for the change of heat with wavelength
CLEAREST = 100e3  # metre, largest visibility of the tables


def contributors(
    layers: dict[str, Floats],
    numbers: NDArray[np.integer],
    ground: Ground,
    calibration: retrieval.RadiometricCalibration,
    setting: Setting,
    survey: Survey,
    channel: Channel,
    amplified: float = 1.0,
) -> dict[str, dict[str, Floats]]:
    """Standard uncertainty of each layer by contributors, in the layer's unit; and of the place.

        u(y)^2 = sum over causes of (dy / dx)^2 u(x)^2,   with finite differences

    Source: Gorrono et al. (2017), Remote Sensing 9, 178 (S2-RUT), for the list of contributors;
    JCGM 100 (2008), eq. (10).

    layers   layers of the image, (lines, columns) each, radiance first
    ground   ground at the centres of all pixels
    setting  setting with the surroundings of each pixel
    amplified  1, noise after the filter of a restored image over noise before the filter
    Returns  for each layer "total" and the CAUSES that apply, (lines, columns) each; and `place`,
             metre along each axis on the ground
    Accuracy model: contributors are independent, and to first order; all except noise are common to
             many pixels. Gases and aerosol type of the air, directional reflectance, and edges that
             the lens blurs are left out.
    """
    knowledge, radiance = survey.knowledge, layers["radiance"]
    pixel = ground.distance * channel.detector.pitch / channel.optics.image_distance
    of_radiance = _of_radiance(radiance, numbers, calibration, knowledge, channel, amplified)
    shifted = band_of(
        channel.shifted(knowledge.wavelength), survey.air, _above(ground), survey.distance_to_sun
    )
    moved = setting._replace(band=shifted)
    ratio = shifted.irradiance / setting.band.irradiance
    if retrieval.is_thermal(setting.band) and shifted.heat and setting.band.heat:
        ratio = float(shifted.heat(WARM)[0, 0] / setting.band.heat(WARM)[0, 0])
    out = {"radiance": of_radiance | {"spectral response": abs(ratio - 1) * radiance}}
    flat = radiance.ravel()

    def through(convert: Callable[[Floats], Floats], other: Callable[[], Floats]) -> dict[str, Any]:
        base = convert(flat)
        causes = {
            cause: abs(convert(flat + u.ravel()) - base) for cause, u in of_radiance.items()
        } | {"spectral response": abs(other() - base)}
        return {cause: values.reshape(radiance.shape) for cause, values in causes.items()}

    if "reflectance" in layers:
        zenith = ground.sun_zenith
        out["reflectance"] = through(
            lambda light: retrieval.apparent_reflectance(light, zenith, setting.band),
            lambda: retrieval.apparent_reflectance(flat, zenith, shifted),
        )
        hazier = _with_lower_visibility(survey, channel, ground, setting)
        out["surface reflectance"] = _of_surface(
            flat, ground, pixel, of_radiance, setting, moved, hazier, knowledge
        )
    if "brightness temperature" in layers:
        out["brightness temperature"] = through(
            lambda light: retrieval.brightness_temperature(light, setting.band),
            lambda: retrieval.brightness_temperature(flat, shifted),
        )
    for name, causes in out.items():
        slopes = np.gradient(layers[name])
        causes["registration"] = knowledge.registration * np.hypot(*slopes)
        causes["total"] = np.sqrt(np.sum([values**2 for values in causes.values()], 0))
    aside = knowledge.height * np.tan(ground.view_zenith)
    place = np.hypot(knowledge.registration * pixel, aside).reshape(radiance.shape)
    return out | {"place": {"total": place}}


def _of_surface(
    flat: Floats,
    ground: Ground,
    pixel: Floats,
    of_radiance: dict[str, Floats],
    setting: Setting,
    moved: Setting,
    hazier: Setting,
    knowledge: Knowledge,
) -> dict[str, Floats]:
    """Uncertainty of the surface's reflectance.

    A change of all pixels also changes their surroundings, which reduces the effect.

    moved, hazier  setting with a shifted response; setting with another visibility
    """
    size, lines = float(np.median(pixel[ground.hit])), of_radiance["noise"].shape
    base = retrieval.surface_reflectance(flat, ground, setting)
    noisy = flat + of_radiance["noise"].ravel()
    tilt = np.minimum(ground.sun_incidence + knowledge.slope, math.pi / 2)
    tilted = replace(ground, sun_incidence=tilt)
    brighter = retrieval.settled(flat, ground, size, setting, knowledge.beyond)
    other = {
        "noise": retrieval.surface_reflectance(noisy, ground, setting),
        "terrain": retrieval.surface_reflectance(flat, tilted, setting),
        "surroundings": retrieval.surface_reflectance(flat, ground, brighter),
    }
    common = {
        cause: (flat + of_radiance[cause].ravel(), setting)
        for cause in ("calibration", "straylight")
    } | {"spectral response": (flat, moved), "atmosphere": (flat, hazier)}
    for cause, (light, here) in common.items():
        here = retrieval.settled(light, ground, size, here)
        other[cause] = retrieval.surface_reflectance(light, ground, here)
    return {cause: abs(values - base).reshape(lines) for cause, values in other.items()}


def _of_radiance(
    radiance: Floats,
    numbers: NDArray[np.integer],
    calibration: retrieval.RadiometricCalibration,
    knowledge: Knowledge,
    channel: Channel,
    amplified: float = 1.0,
) -> dict[str, Floats]:
    """Uncertainty of the radiance. Photon noise follows from the measured electrons per digital
    number, and is zero where read noise exceeds it; read noise is the design's.
    """
    detector, measured = channel.detector, calibration.electrons
    signal = np.maximum(numbers - detector.offset, 0)
    shot = signal / measured if measured > 0 else np.zeros(numbers.shape)
    designed = detector.full_well / (2**detector.bits - 1) / detector.gain
    variance = shot + (detector.read_noise / designed) ** 2 + 1 / 12
    noise = amplified * np.sqrt(variance) / calibration.gain
    return {
        "noise": noise,
        "calibration": np.hypot(knowledge.lamp * radiance, noise / calibration.exposures**0.5),
        "straylight": np.full(radiance.shape, knowledge.straylight * float(np.nanmean(radiance))),
    }


def _above(ground: Ground) -> float:
    """Distance from ground to camera in the middle of an image, metre."""
    cosine = np.cos(ground.view_zenith[ground.hit])
    return max(float(np.median(ground.distance[ground.hit] * cosine)), 1.0)


def _with_lower_visibility(
    survey: Survey, channel: Channel, ground: Ground, setting: Setting
) -> Setting:
    """The setting with the visibility changed by one standard deviation."""
    air = survey.air
    if air is None or air.table or air.aerosol == "none":
        return setting
    other = air.visibility / (1 + survey.knowledge.visibility)
    if other < HAZIEST[air.aerosol]:
        other = min(air.visibility * (1 + survey.knowledge.visibility), CLEAREST)
    air = replace(air, visibility=other)
    return setting._replace(band=band_of(channel, air, _above(ground), survey.distance_to_sun))
