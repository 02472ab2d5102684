"""Mountings found by a search, compared with a case with a known optimum."""

import dataclasses

import numpy as np
import pytest

from startrack import load_design, shipped
from startrack.budget import exclusions
from startrack.core import deg
from startrack.design import KeepOut, replaced_all
from startrack.mission import load_mission, placement, plan_of, surrogate
from startrack.mission.engine import at, fly
from startrack.mission.heads import Blind, faces_of, nearest
from startrack.mission.instants import Instants
from startrack.mission.parameters import KeepClear, MissionOrbit, MissionRequirements, Obstacle
from startrack.mission.placement import (
    angles_of,
    lightest,
    map_of,
    moved_plan,
    place,
    sphere,
    trades,
)
from startrack.mission.summary import availability_of

EXAMPLE = shipped("missions/sun-synchronous.toml")


@pytest.fixture
def loaded(monkeypatch):
    monkeypatch.setattr(surrogate, "PLACES", 384)
    monkeypatch.setattr(placement, "WINDOWS", 24)
    return load_mission(EXAMPLE, ["time.duration=10 d", 'attitude.yaw="velocity"'])


@pytest.mark.slow
def test_three_heads_above_the_earth(loaded, monkeypatch):
    """Only the Earth's limb blinds, at 75 degrees: the heads lie in a cone about the zenith.

    The variance about the zenith is that across a boresight over the sum of the squared sines of
    the zenith angles, and is the largest while 3 sin^2 < 2. So the best lies on the cone, and at
    120 degrees from each other, where the zenith axis is uncorrelated with the others.
    """
    earth = KeepOut(sun=0.0, moon=0.0, earth=75 * deg)
    monkeypatch.setattr(placement, "WINDOWS", 12)
    monkeypatch.setattr(placement, "GRID", 15 * deg)
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
        orbit=MissionOrbit(altitude=600e3, inclination=0.0),
        requirements=MissionRequirements(availability_two=0.999),
    )
    found = place(plan_of(dataclasses.replace(loaded, mission=mission)))
    lines = np.array([head.mounting.as_matrix()[:, 2] for head in found.mission.heads])
    zenith = np.arccos(-lines[:, 2]) / deg
    limb = np.arcsin(6378.137 / (6378.137 + 600)) / deg
    assert zenith == pytest.approx(np.full(3, 180 - limb - 75), abs=0.5)
    assert found.after.one == found.after.two == 1
    turn = np.sort(np.arctan2(lines[:, 1], lines[:, 0])) / deg
    assert np.diff(turn) == pytest.approx([120, 120], abs=5)  # the variance is flat there


def test_the_example_gets_better_and_keeps_clear(loaded, monkeypatch):
    """Outside a cone about the zenith, where a head would be best, by all steps of the mission."""
    monkeypatch.setattr(placement, "WINDOWS", 12)
    monkeypatch.setattr(placement, "GRID", 20 * deg)
    cone = KeepClear((0.0, 0.0, -1.0), 40 * deg)
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
    """The ground always blinds a head that looks down, and never one that looks up."""
    lines, blind, longest, score = map_of(plan_of(loaded), 0, 20 * deg)
    down, up = lines[:, 2] > 0.99, lines[:, 2] < -0.99
    assert blind[down].min() == 1
    assert blind[up].max() < 0.3
    assert longest[down].min() > longest[up].max()
    assert score[down].min() > score[up].min()


def test_more_heads_and_longer_baffles_weigh_more_and_see_more(loaded, monkeypatch):
    """Lengths by the tangents of both angles; one head without a panel is below 100 %."""
    monkeypatch.setattr(placement, "WINDOWS", 2)
    monkeypatch.setattr(placement, "COARSE", 45 * deg)
    plan = plan_of(loaded)
    found = {
        (one.heads, round(one.angle / deg)): one
        for one in trades(plan, [1, 2], [30 * deg, 60 * deg])
    }
    case = loaded.designs[0].case
    half = case.instrument.camera.half_diagonal
    narrow = found[1, 30]
    # The ray at the angle from the rim of the baffle meets the far rim of the lens.
    rim = case.instrument.optics.aperture / 2 + narrow.length * np.tan(half)
    assert rim - narrow.length * np.tan(30 * deg) == pytest.approx(
        -case.instrument.optics.aperture / 2
    )
    assert found[2, 30].mass == pytest.approx(2 * narrow.mass)
    assert narrow.mass > found[1, 60].mass
    assert narrow.length > found[1, 60].length
    assert narrow.quality.one >= found[1, 60].quality.one
    assert found[2, 30].quality.error < narrow.quality.error
    with pytest.raises(ValueError, match="above the half diagonal"):
        trades(plan, [1], [2 * deg])


def test_heads_and_baffles_together_weigh_no_more_than_on_a_grid(loaded, monkeypatch):
    """Two heads with baffles of 25 to 70 degrees, against the lightest of a grid that meets the
    requirements.

    Its own mountings and angle are evaluated again with all samples.
    """
    monkeypatch.setattr(placement, "WINDOWS", 3)
    monkeypatch.setattr(placement, "COARSE", 45 * deg)
    needs = MissionRequirements(max_blind=600.0, availability_one=0.95)
    mission = dataclasses.replace(loaded.mission, requirements=needs)
    plan = plan_of(dataclasses.replace(loaded, mission=mission))
    grid = [one for one in trades(plan, [2], [25 * deg, 45 * deg, 65 * deg]) if one.met]
    [(trade, found)] = lightest(plan, [2], (25 * deg, 70 * deg), evaluations=120)
    assert trade.met
    assert trade.mass <= min(one.mass for one in grid) + 1e-9
    assert 25 * deg <= trade.angle <= 70 * deg
    heads = found.mission.heads
    assert [head.exclusion.sun for head in heads] == pytest.approx([trade.angle] * 2)
    samples = placement.sample(plan)
    hidden = [
        placement.blind_at(
            samples,
            dataclasses.replace(
                plan.heads[0], limits=dataclasses.replace(plan.heads[0].limits, sun=trade.angle)
            ),
            head.mounting.as_matrix()[:, 2],
        )
        for head in heads
    ]
    assert trade.quality.one == pytest.approx(1 - np.mean(hidden[0] & hidden[1]))
    with pytest.raises(ValueError, match="angles must increase, got 70, 25 deg"):
        lightest(plan, [2], (70 * deg, 25 * deg))


def test_the_grid_covers_the_sphere():
    lines = sphere(10 * deg)
    assert np.linalg.norm(lines, axis=1) == pytest.approx(np.ones(len(lines)))
    some = np.random.default_rng(1).normal(size=(2000, 3))
    some /= np.linalg.norm(some, axis=1, keepdims=True)
    assert np.arccos(np.clip((some @ lines.T).max(axis=1), -1, 1)).max() < 8 * deg
    azimuth, elevation = np.array([angles_of(line) for line in lines]).T
    back = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )
    assert back == pytest.approx(lines, abs=1e-12)


def instants_of(place, sun):
    """Instants of a body whose axes are those of ICRS, and the Sun in them."""
    nothing = np.zeros(sun.shape[1])
    body = np.repeat(np.eye(3)[..., None], sun.shape[1], axis=2)
    return Instants(
        nothing, place, place, place, sun, sun, body, place, nothing, nothing, nothing, place
    )


def test_a_panel_that_follows_the_sun_blocks_for_a_known_time():
    """A long panel of half width r, hinged along y at the distance D of the head.

    As seen along y, its edges run on a circle. A head whose boresight is e + clear above the line
    to the hinge is blocked while an edge is higher than e, r sin(f - e) > D sin e, which is a
    fraction 1 - 2 asin(D sin e / r) / pi of a turn for both edges together.
    """
    turn = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    sun = np.stack([np.cos(turn), np.zeros_like(turn), np.sin(turn)])
    r, distance, clear = 0.9, 1.5, 10 * deg
    panel = Obstacle("panel", (distance, 0, 0), (2 * r, 1000, 0), (0, 1, 0))
    faces = faces_of([panel], instants_of(sun, sun))
    for e in (5 * deg, 20 * deg, 33 * deg):
        line = np.array([np.cos(e + clear), 0, np.sin(e + clear)])
        near = nearest(faces, np.zeros(3), line)
        expected = 1 - 2 * np.arcsin(distance * np.sin(e) / r) / np.pi
        assert (near < clear).mean() == pytest.approx(expected, abs=2e-4)
    free = np.arcsin(r / distance) + clear  # above which it never blocks
    line = np.array([np.cos(free + 0.001), 0, np.sin(free + 0.001)])
    assert nearest(faces, np.zeros(3), line).min() == pytest.approx(clear + 0.001, abs=1e-4)


def test_the_angle_to_a_box_is_that_of_its_points():
    """Against the nearest of many points on its sides, from outside."""
    box = Obstacle("box", (0.4, -0.3, 1.0), (0.8, 0.5, 0.3))
    draw = np.random.default_rng(5)
    faces = faces_of([box], instants_of(np.ones((3, 1)), np.ones((3, 1))))
    points = draw.uniform(-0.5, 0.5, (60_000, 3))
    side = draw.integers(3, size=len(points))
    points[np.arange(len(points)), side] = np.sign(points[np.arange(len(points)), side]) / 2
    points = points * box.size + box.centre
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for line in draw.normal(size=(40, 3)):
        line = line / np.linalg.norm(line)
        expected = np.arccos(np.clip((points @ line).max(), -1, 1))
        assert nearest(faces, np.zeros(3), line)[0] == pytest.approx(expected, abs=0.6 * deg)


def test_a_head_behind_structure_is_blind(loaded):
    """A sunlit plate above the first head blinds it by day; a plate in its field blinds it
    always."""
    line = loaded.mission.heads[0].mounting.as_matrix()[:, 2]
    wide = Obstacle("plate", tuple(2 * line), (2.0, 2.0, 2.0))
    near = Obstacle("plate", tuple(2 * line + np.array([1.0, 0, 0])), (0.6, 0.6, 0.6))
    for obstacle, always in ((wide, True), (near, False)):
        mission = dataclasses.replace(loaded.mission, structure=(obstacle,))
        plan = plan_of(dataclasses.replace(loaded, mission=mission), errors=False)
        chunk = at(plan, plan.motion.at(0.0, 30.0, 300))
        blocked = (chunk.seen[0].blind & Blind.STRUCTURE) > 0
        assert (blocked == (always | ~chunk.shadow.sun)).all()
    with pytest.raises(ValueError, match="size must be above 0 along two axes"):
        Obstacle("line", (0, 0, 0), (1, 0, 0))


@pytest.mark.slow
def test_the_length_of_a_tube_is_searched_with_the_directions(loaded, monkeypatch):
    """At the length that is found, the budget's own exclusion angles are those of the placed heads;
    the mass is that of the design with this tube, and a smaller angle asks for a longer one."""
    monkeypatch.setattr(placement, "WINDOWS", 3)
    monkeypatch.setattr(placement, "COARSE", 45 * deg)
    design = load_design(shipped("designs/noise_only.toml"), ["instrument.tube.length=120 mm"])
    free = dataclasses.replace(loaded.mission.heads[0], exclusion=KeepOut())
    mission = dataclasses.replace(
        loaded.mission, heads=(free,), requirements=MissionRequirements(availability_one=0.8)
    )
    plan = plan_of(dataclasses.replace(loaded, mission=mission, designs=(design,)))
    [(trade, found)] = lightest(plan, [1], (12 * deg, 50 * deg), evaluations=60)
    assert trade.met
    case = replaced_all(design.case, {"instrument.tube.length": trade.length})
    bare = dataclasses.replace(
        design.case, instrument=dataclasses.replace(design.case.instrument, tube=None)
    )
    optics, half = case.instrument.optics, case.instrument.camera.half_diagonal
    tube = case.instrument.tube.mass(optics.aperture, half)
    needs = design.campaign.requirements
    assert trade.mass == pytest.approx(needs.mass(bare) + tube, rel=1e-9)
    angles = exclusions(case, np.arange(0.1, 90, 0.1) * deg)
    placed = found.mission.heads[0].exclusion
    assert trade.angle == placed.sun == pytest.approx(angles["sun"].least(), abs=0.6 * deg)
    assert placed.earth == pytest.approx(angles["earth"].least(), abs=0.6 * deg)
    assert placed.moon == pytest.approx(half, abs=0.3 * deg)  # it is kept out up to the field
    long, short = trades(plan, [1], [12 * deg, 50 * deg])
    assert long.length > 2 * short.length
    assert short.mass <= trade.mass < long.mass
    with pytest.raises(ValueError, match=r"angle of a baffle with instrument\.tube must lie in"):
        trades(plan, [1], [8 * deg])
