import dataclasses
import math

import numpy as np
import pytest

from startrack.catalog import LIMITS, open_sky
from startrack.core.streams import Streams
from startrack.design.files import load_design
from startrack.design.requirements import Requirements
from startrack.io import shipped
from startrack.observation.pointing import random_attitude
from startrack.observation.stars import stars_in_field
from startrack.trial.chain import observe
from startrack.verification.accuracy import limiting_magnitude, needed_magnitude
from startrack.verification.accuracy import margins as margins_of

CASE = load_design(shipped("designs/noise_only.toml")).case


def changed(**parts):
    instrument = CASE.instrument
    for name, changes in parts.items():
        instrument = dataclasses.replace(
            instrument, **{name: dataclasses.replace(getattr(instrument, name), **changes)}
        )
    return dataclasses.replace(CASE, instrument=instrument)


def test_mass_and_power_follow_their_models():
    needs = Requirements(mass_fixed=0.1, mass_per_volume=1000.0, power_fixed=0.2)
    aperture = 0.035 / 2.4
    assert needs.mass(CASE) == pytest.approx(0.1 + 1000 * aperture**3)
    rate = 1 / (0.08 + 512 * 512 / 10e6)
    assert needs.power(CASE) == pytest.approx(0.2 + 20e-9 * 512 * 512 * 12 * rate)
    assert margins_of(needs, CASE)["update rate"] == pytest.approx(rate - 1)


def test_twice_the_photons_are_three_quarters_of_a_magnitude():
    """With read noise alone, and a blur so large that the f-number does not affect it."""
    limit = {}
    for f_number in (2.4, 2.4 / 2**0.5):
        case = changed(
            detector={"dark_current": 0.0},
            motion={"rate_x": 0.0, "rate_y": 0.0},
            optics={"f_number": f_number, "blur": 1e-5, "psf": "gaussian"},
        )
        black = dataclasses.replace(case, scene=dataclasses.replace(CASE.scene, background_g=None))
        limit[f_number] = limiting_magnitude(black)
    gain = limit[2.4 / 2**0.5] - limit[2.4]
    assert gain == pytest.approx(2.5 * np.log10(2), abs=0.01)


def test_slewing_costs_magnitudes():
    fast = changed(motion={"rate_x": 0.05, "rate_y": 0.05})
    assert limiting_magnitude(fast) < limiting_magnitude(CASE) - 0.3


def test_needed_magnitude_against_a_count():
    """The fraction of random fields with five stars to this magnitude is the required one."""
    needed = needed_magnitude(CASE, 5, 0.9)
    camera, hits = CASE.instrument.camera, 0
    for n in range(600):
        attitude = random_attitude(Streams(11, n))
        stars = stars_in_field(open_sky(CASE.catalog), attitude, camera)
        inside = camera.holds(camera.project(attitude.apply(stars.direction)))
        hits += (stars.magnitude_g[inside] <= needed).sum() >= 5
    assert 0.9 - 0.05 < hits / 600 < 0.9 + 0.05  # four standard errors


def test_more_stars_need_fainter_ones():
    levels = [needed_magnitude(CASE, n, 0.95) for n in (1, 3, 6, 12)]
    assert levels == sorted(levels)
    assert needed_magnitude(CASE, 100, 0.99) == LIMITS["bright"] + 1


@pytest.mark.parametrize("focal", [0.055, 0.075])
def test_stars_that_no_catalogue_of_the_tracker_has_do_not_count(focal):
    """The camera detects stars to G 8 and fainter; its tracker knows stars to G 7."""
    case = changed(optics={"focal_length": focal})
    assert limiting_magnitude(case) > 8
    sky, camera = open_sky(case.believed_catalog), case.instrument.camera
    count = []
    for number in range(300):
        attitude = random_attitude(Streams(4, number))
        seen = stars_in_field(sky, attitude, camera).direction
        count.append(camera.holds(camera.project(attitude.apply(seen))).sum())
    enough = float(np.mean(np.array(count) >= 5)) >= 0.98
    needs = Requirements(min_stars=5, sky_fraction=0.98)
    assert (margins_of(needs, case)["stars in the sky"] > 0) == enough == (focal < 0.06)


def test_stars_above_the_limit_are_found_and_those_below_are_not():
    """Half a magnitude on either side of the limit, on rendered frames of a slower lens."""
    deep = dataclasses.replace(
        changed(optics={"f_number": 5.5}), catalog=dataclasses.replace(CASE.catalog, limit_g=8.0)
    )
    limit, camera = limiting_magnitude(deep), deep.instrument.camera
    assert 5 < limit < 7
    found: dict[bool, list[bool]] = {True: [], False: []}
    for n in range(60):
        streams = Streams(3, n)
        record = observe(deep, random_attitude(streams), streams)
        pixel = camera.project(record.icrs_to_camera.apply(record.stars.direction))
        inside = camera.holds(pixel, -8)
        spots = np.column_stack([record.spots.x, record.spots.y])
        for place, g in zip(pixel[inside], record.stars.magnitude_g[inside], strict=True):
            if 0.5 < abs(g - limit) < 1.0:
                near = len(spots) > 0 and np.hypot(*(spots - place).T).min() < 1.5
                found[g < limit].append(near)
    assert len(found[True]) > 50
    assert np.mean(found[True]) > 0.8
    assert np.mean(found[False]) < 0.1


def test_limits_that_are_not_asked_for_are_not_there():
    assert not {"volume", "data rate", "cost"} & set(margins_of(Requirements(), CASE))


def test_volume_data_rate_and_cost():
    """A tube of 2 x 35 mm before a lens of 35 / 2.4 mm; 512 x 512 pixels of 12 bit; ten times the
    focal length costs 10^1.7 times as much."""
    needs = Requirements(max_volume=200e-6, max_data_rate=30e6, max_cost=20e3, volume_fixed=1e-4)
    margins = margins_of(needs, CASE)
    tube = math.pi / 4 * (0.035 / 2.4) ** 2 * 0.07
    assert margins["volume"] == pytest.approx(1 - (1e-4 + tube) / 200e-6)
    rate = 512 * 512 * 12 / (0.08 + 512 * 512 / 10e6)
    assert margins["data rate"] == pytest.approx(1 - rate / 30e6)
    wide = changed(optics={"focal_length": 0.35})
    assert needs.cost(wide) / needs.cost(CASE) == pytest.approx(10**1.7)
