"""Case -> its margins to the requirements that need no trials."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np

from startrack.budget import attitudes
from startrack.catalog import FAINTEST_G, LIMITS, Selection, Sky, open_sky
from startrack.core import Camera, Stars
from startrack.design import Case, Requirements
from startrack.detection import threshold_of
from startrack.detector import electron_rate
from startrack.motion import blur
from startrack.scene import illuminate
from startrack.trial import detection_plan, psf_of, throughput

# Chosen by hand: finer ones cost a count of the stars in every field for each new focal length.
FIELDS = 1024  # attitudes at which stars are counted
FOCAL_STEP = 1.05  # ratio of the focal lengths at which they are counted
FIRST_STARS = 4  # times those that fields need on average, of which the brightest are counted first
MAGNITUDES = np.linspace(-2, 12, 57)  # between which the limit is interpolated


def margins(requirements: Requirements, case: Case) -> dict[str, float]:
    """Margin to each limit, as a fraction of the limit (stars: magnitude); negative, not met.

    Without accuracy and availability, which need trials.
    """
    stars = min(limiting_magnitude(case), case.believed_catalog.limit_g)
    stars -= needed_magnitude(case, requirements.min_stars, requirements.sky_fraction)
    found = cost_margins(requirements, case) | {"stars in the sky": stars}
    return found | requirements.own_margins(case)


def cost_margins(requirements: Requirements, case: Case) -> dict[str, float]:
    """The `margins` of what a design costs and how often it measures, in a millisecond."""
    rate = case.instrument.detector.update_rate
    limits = {
        "volume": (requirements.volume, requirements.max_volume),
        "data rate": (requirements.data_rate, requirements.max_data_rate),
        "cost": (requirements.cost, requirements.max_cost),
    }
    return {name: 1 - model(case) / limit for name, (model, limit) in limits.items() if limit} | {
        "mass": 1 - requirements.mass(case) / requirements.max_mass,
        "power": 1 - requirements.power(case) / requirements.max_power,
        "update rate": rate / requirements.min_update_rate - 1
        if requirements.min_update_rate
        else 1.0,
    }


def limiting_magnitude(case: Case) -> float:
    """The faintest G of a sunlike star that the matched filter detects at the threshold.

        signal / noise = N sqrt(sum p^2) / sqrt(sky + dark + read noise^2 + gain^2 / 12)
                       = threshold,   p the fractions of the smeared star's light in its pixels

    Accuracy  model: background-limited, which holds at the threshold; the pixel phase is averaged;
              the tests that reject hot pixels cost up to half a magnitude more.
    """
    detector = case.instrument.detector
    pixel = case.instrument.camera.focal_length_px**-2
    unknown = np.full(len(MAGNITUDES), np.nan)
    stars = Stars(
        np.zeros(len(MAGNITUDES), np.int64), np.zeros((len(MAGNITUDES), 3)), MAGNITUDES, unknown
    )
    light = illuminate(case.scene, stars)
    star, sky = electron_rate(light, detector, throughput(case.instrument))
    noise = (sky * pixel + detector.dark_rate) * detector.integration
    noise += detector.noise**2 + detector.electrons_per_dn**2 / 12
    # Sum of squares of the pixels' fractions, averaged over the smear.
    psf = psf_of(case.instrument)
    sharpness = float((psf.table**2).sum()) / psf.oversampling**2
    smear = blur(case.instrument.motion, detector.exposure)
    # A straight line of this length has the same blur.
    length = np.sqrt(12) * float(np.hypot(smear[0], smear[1])) / np.sqrt(pixel)
    sharpness /= np.sqrt(1 + length**2 * sharpness)
    signal = star * detector.integration * np.sqrt(sharpness)
    ratio = signal / np.sqrt(noise)
    threshold = threshold_of(detection_plan(case), detector.columns, detector.rows)
    return float(np.interp(-np.log(threshold), -np.log(ratio), MAGNITUDES))


def needed_magnitude(case: Case, stars: int, fraction: float) -> float:
    """The limiting G at which `fraction` of the attitudes have `stars` stars in the field.

    Stars of the source of the tracker's catalogue count, however deep it was cut.

    Accuracy  numerical: 0.02 mag between the focal lengths at which stars are counted.
    """
    camera, source = case.instrument.camera, case.believed_catalog
    every = replace(source, limit_g=LIMITS.get(source.source, FAINTEST_G))
    at, below = math.modf(math.log(camera.focal_length_px) / math.log(FOCAL_STEP))
    nearer, farther = (
        _needed(every, camera.columns, camera.rows, step, stars, fraction)
        for step in (int(below), int(below) + 1)
    )
    return nearer + at * (farther - nearer)


@lru_cache(maxsize=1024)
def _needed(
    catalog: Selection, columns: int, rows: int, step: int, stars: int, fraction: float
) -> float:
    """At a focal length of FOCAL_STEP**step pixels."""
    camera = Camera(columns, rows, FOCAL_STEP**step)
    sky, axes = open_sky(catalog), attitudes(FIELDS).as_matrix()
    # Too few stars in the whole source: a magnitude beyond its limit.
    faintest, left = np.full(FIELDS, catalog.limit_g + 1), np.arange(FIELDS)
    # The stars are in order of brightness: so many hold a few times the stars that a field needs.
    count = math.ceil(
        FIRST_STARS * stars * 4 * math.pi * camera.focal_length_px**2 / columns / rows
    )
    while True:
        bright = Sky(sky.stars[:count])
        near = bright.cones(axes[left, 2], camera.half_diagonal)
        star, field = np.concatenate(near), np.repeat(np.arange(len(left)), [*map(len, near)])
        seen = np.einsum("nij,nj->ni", axes[left[field]], bright.stars.direction[star])
        inside = camera.holds(camera.project(seen))
        star, held = star[inside], np.bincount(field[inside], minlength=len(left))
        last = (np.cumsum(held) - held + stars - 1)[held >= stars]
        faintest[left[held >= stars]] = bright.stars.magnitude_g[star[last]]
        left = left[held < stars]
        if count >= len(sky) or not len(left):
            return float(np.quantile(faintest, fraction))
        count *= 4
