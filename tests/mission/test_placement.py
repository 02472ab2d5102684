"""Mountings that a search finds, against a case whose best is known."""

import dataclasses

import numpy as np
import pytest

from startrack import shipped
from startrack.core import deg
from startrack.design import KeepOut
from startrack.mission import load_mission, placement, plan_of, surrogate
from startrack.mission.engine import fly
from startrack.mission.parameters import KeepClear, Needs, Orbit
from startrack.mission.placement import angles_of, map_of, moved_plan, place, sphere
from startrack.mission.summary import availability_of

EXAMPLE = shipped("missions/sun-synchronous.toml")


@pytest.fixture
def loaded(monkeypatch):
    monkeypatch.setattr(surrogate, "PLACES", 768)
    monkeypatch.setattr(placement, "WINDOWS", 24)
    return load_mission(EXAMPLE, ["time.duration=30 d", 'attitude.yaw="velocity"'])


def test_three_heads_above_the_earth(loaded):
    """Only the Earth's limb blinds, at 75 degrees: the heads lie in a cone about the zenith.

    The variance about the zenith is that across a boresight over the sum of the squared sines of
    the zenith angles, and is the largest while 3 sin^2 < 2. So the best lies on the cone, and at
    120 degrees from each other, where the zenith axis is uncorrelated with the others.
    """
    earth = KeepOut(sun=0.0, moon=0.0, earth=75 * deg)
    heads = [dataclasses.replace(one, exclusion=earth) for one in loaded.mission.heads]
    for head, (azimuth, elevation) in zip(
        range(3), ((-80, -70), (60, -75), (170, -80)), strict=True
    ):
        heads[head] = dataclasses.replace(
            heads[head], azimuth=azimuth * deg, elevation=elevation * deg
        )
    mission = dataclasses.replace(
        loaded.mission,
        heads=tuple(heads),
        orbit=Orbit(altitude=600e3, inclination=0.0),
        requirements=Needs(availability_two=0.999),
    )
    found = place(plan_of(dataclasses.replace(loaded, mission=mission)))
    lines = np.array([head.mounting.as_matrix()[:, 2] for head in found.mission.heads])
    zenith = np.arccos(-lines[:, 2]) / deg
    limb = np.arcsin(6378.137 / (6378.137 + 600)) / deg
    assert zenith == pytest.approx(np.full(3, 180 - limb - 75), abs=0.5)
    assert found.after.one == found.after.two == 1
    turn = np.sort(np.arctan2(lines[:, 1], lines[:, 0])) / deg
    assert np.diff(turn) == pytest.approx([120, 120], abs=5)  # the variance is flat there


def test_the_example_gets_better_and_keeps_clear(loaded):
    """Beside the usual 30 degrees from the zenith, by all steps of the mission."""
    cone = KeepClear((0.0, -1.0, 0.0), 40 * deg)
    mission = dataclasses.replace(loaded.mission, keep_out=(cone,))
    plan = plan_of(dataclasses.replace(loaded, mission=mission))
    found = place(plan)
    assert found.after.keep_out < 0.1 * deg
    for head in found.mission.heads:
        assert cone.depth(head.mounting.as_matrix()[:, 2]) < 0.1 * deg
    before, after = (fly(one) for one in (plan, moved_plan(plan, found.mission)))
    assert after.rms.max() < 0.5 * before.rms.max()
    assert availability_of(after).at_least(2) > availability_of(before).at_least(2)
    assert availability_of(after).none.longest <= availability_of(before).none.longest


def test_the_map_knows_the_sun_and_the_ground(loaded):
    """Down is always blind by the ground; up never by it."""
    lines, blind, longest = map_of(plan_of(loaded), 0, 20 * deg)
    down, up = lines[:, 2] > 0.99, lines[:, 2] < -0.99
    assert blind[down].min() == 1
    assert blind[up].max() < 0.3
    assert longest[down].min() > longest[up].max()


def test_the_grid_covers_the_sphere():
    lines = sphere(10 * deg)
    assert np.linalg.norm(lines, axis=1) == pytest.approx(np.ones(len(lines)))
    some = np.random.default_rng(1).normal(size=(2000, 3))
    some /= np.linalg.norm(some, axis=1, keepdims=True)
    assert np.arccos(np.clip((some @ lines.T).max(axis=1), -1, 1)).max() < 8 * deg
    azimuth, elevation = np.array([angles_of(line) for line in lines]).T
    back = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                     np.sin(elevation)], axis=1)  # fmt: skip
    assert back == pytest.approx(lines, abs=1e-12)
