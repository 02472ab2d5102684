"""Dark current of pixels, colours of stars, and stars too close together to be separated."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from startrack.catalog import Selection, Sky, open_sky
from startrack.core import Camera, Floats, Ints, Stars
from startrack.design import Case
from startrack.detection import DarkMap
from startrack.detector import Defects, Detector, electron_rate, mean_wavelength
from startrack.identification import POINTS, indexed_field, merged
from startrack.scene import illuminate
from startrack.trial.view import throughput


def dark_currents(detector: Detector) -> tuple[float, float]:
    """Mean and rms about it over single pixels, electron / second at the reference temperature.

        d = max(N(m, s), 0) + hot,   mean d = m Phi(m/s) + s phi(m/s) + p h
        var d = (m^2 + s^2) Phi + m s phi - (m Phi + s phi)^2 + (2 p - p^2) h^2

    of normal currents, clipped at zero, and hot pixels with the probability p and an exponential
    distribution of mean h.
    """
    m, defects = detector.typical_current, detector.defects
    if not defects:
        return m, 0.0
    mean, square, s = m, m * m, defects.dsnu
    if s:
        fraction, density = (
            float(ndtr(m / s)),
            math.exp(-((m / s) ** 2) / 2) / math.sqrt(2 * math.pi),
        )
        mean, square = m * fraction + s * density, (m * m + s * s) * fraction + m * s * density
    p, h = defects.hot, defects.hot_current
    return mean + p * h, math.sqrt(max(square - mean**2, 0.0) + (2 * p - p * p) * h * h)


def dark_electrons(detector: Detector) -> tuple[float, float]:
    """`dark_currents` in an exposure, electron in a pixel of the image."""
    growth = detector.thermal.growth if detector.thermal else 1.0
    mean, spread = (growth * detector.exposure * one for one in dark_currents(detector))
    return mean * detector.binning**2, spread * detector.binning


def dark_residual(detector: Detector, dark_map: DarkMap | None) -> float:
    """Rms over the pixels of the dark signal that a tracker does not know of, electron.

        with a map        sqrt(noise^2 / frames + step^2 / 12)
        list of hot ones  sqrt(s^2 + v (1 - (a^2 / 2 + a + 1) exp(-a))),   a = hot noise / h

    with the variances s^2 of the usual pixels and v of the hot ones, and their mean signal h.

    Accuracy  model: stars beside a hot pixel, of which some are lost, are left out.
    """
    _, spread = dark_electrons(detector)
    if dark_map is None:
        return spread
    defects, step = detector.defects or Defects(), detector.electrons_per_dn
    usual = replace(detector, defects=replace(defects, hot=0.0))
    mean, unmapped = dark_electrons(usual)
    noise = math.hypot(math.sqrt(mean), detector.noise, step / math.sqrt(12))
    if dark_map.subtracted:
        error = noise / math.sqrt(dark_map.frames)
        rounding = dark_map.step * step / math.sqrt(12)  # of a map that spans several steps
        return math.hypot(error, min(rounding, math.hypot(error, unmapped)))
    growth = detector.thermal.growth if detector.thermal else 1.0
    h = growth * detector.exposure * defects.hot_current
    if not defects.hot * h:
        return unmapped
    a = dark_map.hot * noise / h
    kept = 1 - (a * a + 2 * a + 2) * math.exp(-a) / 2
    return math.sqrt(unmapped**2 + (spread**2 - unmapped**2) * kept)


COLOURS = np.linspace(-0.6, 4.0, 24)  # BP - RP, from the hottest stars to the reddest


def colour_correction(case: Case, known: Floats) -> Floats:
    """Magnitude (n,) by which stars are fainter for this camera than sunlike stars of the same G.

    known  BP - RP, NaN where it is not known
    """
    count = len(COLOURS) + 1
    colour = np.append(COLOURS, np.nan)
    stars = Stars(np.zeros(count, np.int64), np.zeros((count, 3)), np.zeros(count), colour)
    light = illuminate(case.scene, stars)
    rate, _ = electron_rate(light, case.instrument.detector, throughput(case.instrument))
    fainter = -2.5 * np.log10(rate[:-1] / rate[-1])
    return np.where(np.isnan(known), 0.0, np.interp(known, COLOURS, fainter))


def mean_colour(case: Case, known: Floats) -> Floats:
    """Mean detected wavelength (n,) of stars, metre.

    known  BP - RP; where it is not known (NaN), that of a sunlike star
    """
    count = len(COLOURS) + 1
    colour = np.append(COLOURS, np.nan)
    stars = Stars(np.zeros(count, np.int64), np.zeros((count, 3)), np.zeros(count), colour)
    light, instrument = illuminate(case.scene, stars), case.instrument
    mean = mean_wavelength(light, instrument.detector, throughput(instrument))
    return np.where(np.isnan(known), mean[-1], np.interp(known, COLOURS, mean[:-1]))


@dataclass(frozen=True, eq=False)
class SeparableStars:
    """Stars of a catalogue; those too close for the tracker's index count as one.

    sky   brightest first
    name  (n,) index of each in the catalogue; of several, that of the brightest
    """

    sky: Sky
    name: Ints


def separable_stars(selection: Selection, camera: Camera) -> SeparableStars:
    """The stars of a catalogue as the tracker's index merges them."""
    return separated(selection, index_resolution(camera))


def index_resolution(camera: Camera) -> float:
    """Radian, within which the index merges stars; the same for cameras of similar field."""
    return indexed_field(camera) / POINTS


@lru_cache(maxsize=8)
def separated(selection: Selection, resolution: float) -> SeparableStars:
    """`separable_stars` by resolution; kept for the 8 last pairs."""
    stars, name = merged(open_sky(selection).stars, resolution)
    order = np.argsort(stars.magnitude_g, kind="stable")
    return SeparableStars(Sky(stars[order]), name[order])
