import dataclasses

import numpy as np
import pytest

from startrack.catalog import shipped
from startrack.chain import observe
from startrack.design import load_design
from startrack.streams import Streams
from startrack.study.requirements import Requirements, limiting_magnitude, needed_magnitude

CASE = load_design(shipped("designs/nanosatellite.toml")).case


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
    assert needs.margins(CASE)["update rate"] == pytest.approx(rate - 1)


def test_twice_the_photons_are_three_quarters_of_a_magnitude():
    """Against read noise alone; the sky is switched off."""
    quiet = dataclasses.replace(
        changed(detector={"dark_current": 0.0}, motion={"rate_x": 0.0, "rate_y": 0.0}),
        scene=dataclasses.replace(CASE.scene, background_g=None),
    )
    wide = changed(
        detector={"dark_current": 0.0}, motion={"rate_x": 0.0, "rate_y": 0.0},
        optics={"f_number": 2.4 / 2**0.5, "blur": 1e-5, "psf": "gaussian"},
    )  # fmt: skip
    narrow = dataclasses.replace(wide, instrument=dataclasses.replace(
        wide.instrument, optics=dataclasses.replace(wide.instrument.optics, f_number=2.4)))  # fmt: skip
    dark = [dataclasses.replace(one, scene=quiet.scene) for one in (wide, narrow)]
    gain = limiting_magnitude(dark[0]) - limiting_magnitude(dark[1])
    assert gain == pytest.approx(2.5 * np.log10(2), abs=0.01)


def test_slewing_costs_magnitudes():
    fast = changed(motion={"rate_x": 0.05, "rate_y": 0.05})
    assert limiting_magnitude(fast) < limiting_magnitude(CASE) - 0.3


def test_needed_magnitude_against_a_count():
    """The share of random fields that hold five stars to this magnitude is the one asked for."""
    from startrack.catalog import open_sky
    from startrack.chain import look, random_attitude

    needed = needed_magnitude(CASE, 5, 0.9)
    camera, hits = CASE.instrument.camera, 0
    for n in range(600):
        attitude = random_attitude(Streams(11, n))
        stars = look(open_sky(CASE.catalog), attitude, camera)
        inside = camera.holds(camera.project(attitude.apply(stars.direction)))
        hits += (stars.magnitude_g[inside] <= needed).sum() >= 5
    assert 0.9 - 0.05 < hits / 600 < 0.9 + 0.05  # four standard errors


def test_more_stars_need_fainter_ones():
    levels = [needed_magnitude(CASE, n, 0.95) for n in (1, 3, 6, 12)]
    assert levels == sorted(levels)
    assert needed_magnitude(CASE, 100, 0.99) == CASE.catalog.limit_g + 1


def test_stars_above_the_limit_are_found_and_those_below_are_not():
    """Half a magnitude on either side of the limit, on rendered frames."""
    limit = limiting_magnitude(CASE)
    deep = dataclasses.replace(CASE, catalog=dataclasses.replace(CASE.catalog, limit_g=8.0))
    if not 5 < limit < 7.5:
        faint = dataclasses.replace(
            CASE.instrument.optics, f_number=CASE.instrument.optics.f_number * 10 ** (0.2 * (limit - 6.5))
        )  # fmt: skip
        deep = dataclasses.replace(
            deep, instrument=dataclasses.replace(CASE.instrument, optics=faint)
        )
    limit = limiting_magnitude(deep)
    found = {True: [], False: []}
    from startrack.chain import random_attitude

    for n in range(60):
        streams = Streams(3, n)
        record = observe(deep, random_attitude(streams), streams)
        camera = deep.instrument.camera
        pixel = camera.project(record.icrs_to_camera.apply(record.stars.direction))
        inside = camera.holds(pixel, -8)
        spots = np.column_stack([record.spots.x, record.spots.y])
        for place, g in zip(pixel[inside], record.stars.magnitude_g[inside], strict=True):
            if 0.5 < abs(g - limit) < 1.0:
                near = len(spots) > 0 and np.hypot(*(spots - place).T).min() < 1.5
                found[g < limit].append(near)
    assert np.mean(found[True]) > 0.9
    assert np.mean(found[False]) < 0.35
