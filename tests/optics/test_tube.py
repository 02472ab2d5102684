"""A baffle by its geometry: against light traced forwards, closed forms, and its limits."""

import math
from dataclasses import replace

import numpy as np
import pytest

from startrack import deg, load_design, mm, shipped
from startrack.core import Refused
from startrack.design import DesignSpace, Fidelity, Requirements, replaced
from startrack.optics import BaffleTube
from startrack.optics import baffle as tube
from startrack.optics.baffle import transmittance_of
from startrack.trial import run_trials
from startrack.verification import cost_margins

TUBE, LENS, FIELD = BaffleTube(150 * mm), 25 * mm, 10 * deg


def on_lens(angles, baffle=TUBE, lens=LENS):
    """Direct and scattered light on the lens as the package has it, of a lens that scatters evenly,
    per steradian, so that the scattered part is an irradiance."""
    shape = baffle.shape(lens, FIELD)
    random = np.random.default_rng(1).random((2**15, 2 + 2 * tube.BOUNCES))
    nodes = np.array([FIELD, *angles])
    direct = tube._direct_light(*shape, nodes, random)
    return shape, direct[1:], tube._scattered_light(*shape, nodes, random, 0.0)[1:]


def forwards(shape, angle, photons, bounces, seed):
    """Light on the lens over that at the entrance, by photons from the Sun that walk the tube.

    Returns  direct, and after each number of bounces off walls that reflect all
    """
    random = np.random.default_rng(seed)
    length, wall = shape.height[-1], shape.wall
    r, turn = shape.edge[-1] * np.sqrt(random.random(photons)), 2 * np.pi * random.random(photons)
    place = np.stack([r * np.cos(turn), r * np.sin(turn), np.full(photons, length)], axis=1)
    way = np.tile([-math.sin(angle), 0.0, -math.cos(angle)], (photons, 1))
    found = []
    for _ in range(bounces + 1):
        # Distances to all planes and to the wall; the nearest that is solid ends the flight.
        planes = np.append(shape.height, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (planes - place[:, 2:]) / way[:, 2:]
            a = (way[:, :2] ** 2).sum(axis=1)
            b = (place[:, :2] * way[:, :2]).sum(axis=1)
            c = (place[:, :2] ** 2).sum(axis=1) - wall**2
            side = (-b + np.sqrt(np.maximum(b * b - a * c, 0))) / a
        across = np.linalg.norm(place[:, None, :2] + far[..., None] * way[:, None, :2], axis=2)
        solid = (across >= np.append(shape.edge, 0.0)) & (across <= wall) & (far > 1e-10)
        far = np.where(solid, far, np.inf)
        up = place[:, 2] + side * way[:, 2]
        side = np.where((side > 1e-10) & (up > 0) & (up < length), side, np.inf)
        every = np.column_stack([far, side])
        what, distance = every.argmin(axis=1), every.min(axis=1)
        place, met = place + np.where(np.isfinite(distance), distance, 0)[:, None] * way, what
        lens = (met == len(shape.height)) & (np.linalg.norm(place[:, :2], axis=1) < shape.radius)
        found.append(lens[np.isfinite(distance)].sum())
        kept = np.isfinite(distance) & ~lens
        place, way, met = place[kept], way[kept], met[kept]
        normal = np.zeros_like(place)
        normal[:, 2] = np.where(way[:, 2] > 0, -1.0, 1.0)
        on_wall = met == len(shape.height) + 1
        normal[on_wall] = np.column_stack([-place[on_wall, :2] / wall, np.zeros(on_wall.sum())])
        # A point on a unit sphere that touches the surface: the cosine law.
        ball = random.standard_normal(place.shape)
        way = ball / np.linalg.norm(ball, axis=1, keepdims=True) + normal
        way /= np.linalg.norm(way, axis=1, keepdims=True)
    entrance = shape.edge[-1] ** 2 * math.cos(angle) / shape.radius**2
    return np.array(found) / photons * entrance


@pytest.mark.parametrize("angle", [pytest.param(45 * deg, marks=pytest.mark.slow), 60 * deg])
def test_light_traced_backwards_is_that_of_photons_forwards(angle):
    """A wide lens behind a short tube, with one of two angles before the cutoff of 50 deg.

    Compared are the direct light and that after each of three bounces, within 4 standard errors of
    both: 6 to 14 % of the light after two bounces, which is most of it beyond the cutoff.
    """
    shape, direct, scattered = on_lens([angle], BaffleTube(60 * mm), 60 * mm)
    photons = 200_000
    theirs = forwards(shape, angle, photons, 3, 2)
    one = shape.edge[-1] ** 2 * math.cos(angle) / shape.radius**2 / photons
    mine = [direct[0], *scattered[0, :3]]
    for ours, their in zip(mine, theirs, strict=True):
        # Of 2^15 paths, of which each may carry as much as all of the sky has.
        own = ours / 2**15
        assert ours == pytest.approx(their, abs=4 * math.sqrt(their * one + own))


def test_direct_light_is_the_overlap_of_lens_and_entrance():
    """Two discs, one of them shifted by L tan(angle); no vane is in the way."""
    angles = np.array([11, 13, 15, 17]) * deg
    shape, direct, _ = on_lens(angles)
    small, large, apart = shape.radius, shape.edge[-1], shape.height[-1] * np.tan(angles)
    left = (apart**2 + small**2 - large**2) / (2 * apart)
    inner = np.arccos(np.clip(left / small, -1, 1))
    outer = np.arccos(np.clip((apart - left) / large, -1, 1))
    common = small**2 * (inner - np.sin(2 * inner) / 2) + large**2 * (outer - np.sin(2 * outer) / 2)
    assert direct == pytest.approx(np.cos(angles) * common / (np.pi * small**2), rel=0.01)


def test_no_lit_wall_is_seen_by_the_lens():
    """Beyond the cutoff no light reaches the lens after one bounce: each vane hides the wall."""
    cutoff = TUBE.cutoff(LENS, FIELD)
    _, direct, scattered = on_lens([cutoff + 1 * deg, 40 * deg, 70 * deg])
    assert (direct == 0).all()
    assert scattered[:, 0].max() < 0.02 * scattered[:, 1].min()


def test_a_longer_tube_keeps_the_sun_out_at_smaller_angles():
    curves = [transmittance_of(BaffleTube(long), LENS, FIELD, 1.6) for long in (0.1, 0.2)]
    short, long = (curve(np.array([20 * deg]))[0] for curve in curves)
    assert long < 1e-3 * short
    assert TUBE.cutoff(LENS, FIELD) == pytest.approx(math.atan((12.5 + 38.949) / 150), rel=1e-4)


def test_paint_and_edges_make_the_light_past_the_cutoff():
    """With two bounces, nearly the square of the reflectance for infinitely thin edges."""
    knife = replace(TUBE, edge=0.0)
    dark, light = (
        transmittance_of(replace(knife, reflectance=r), LENS, FIELD, 1.6)(np.array([30 * deg]))[0]
        for r in (0.02, 0.04)
    )
    assert light / dark == pytest.approx(4, rel=0.08)
    thick = transmittance_of(replace(TUBE, edge=200e-6), LENS, FIELD, 1.6)(np.array([30 * deg]))[0]
    assert thick > transmittance_of(knife, LENS, FIELD, 1.6)(np.array([30 * deg]))[0]


def test_a_design_with_a_tube_has_its_curve_its_mass_and_its_volume():
    case = load_design(shipped("designs/noise_only.toml")).case
    with_tube = replace(case, instrument=replace(case.instrument, tube=TUBE))
    needs = Requirements(density=None)
    field, lens = case.instrument.camera.half_diagonal, case.instrument.optics.aperture
    assert needs.mass(with_tube) - needs.mass(case) == pytest.approx(TUBE.mass(lens, field))
    dense = replace(needs, density=1500.0)  # of the camera; the tube is hollow
    assert dense.mass(with_tube) - dense.mass(case) == pytest.approx(TUBE.mass(lens, field))
    assert needs.volume(with_tube) - needs.volume(case) == pytest.approx(TUBE.volume(lens, field))
    assert with_tube.instrument.stray(np.array([80 * deg])) < 1e-8
    with pytest.raises(Refused, match=r"requirements\.baffle_angle must be left out"):
        replace(needs, baffle_angle=0.5).volume(with_tube)
    curve = with_tube.instrument.stray
    with pytest.raises(Refused, match="baffle must be left out where tube"):
        replace(with_tube.instrument, baffle=curve)


def test_a_campaign_varies_the_length_of_a_tube(tmp_path):
    """Between 60 and 240 mm: the mass grows by that of walls and vanes, until it is too large."""
    text = shipped("designs/noise_only.toml").read_text()
    variable = """
[[campaign.variables]]
name = "instrument.tube.length"
low = "60 mm"
high = "240 mm"
"""
    path = tmp_path / "tube.toml"
    path.write_text(text + '\n[instrument.tube]\nlength = "100 mm"\n' + variable)
    design = load_design(path)
    space = DesignSpace(design.case, design.campaign.variables)
    ends = [space.design(np.append(space.start[:-1], end)) for end in (0.0, 1.0)]
    assert [one.instrument.tube.length for one in ends] == pytest.approx([60e-3, 240e-3])
    field, lens = ends[0].instrument.camera.half_diagonal, ends[0].instrument.optics.aperture
    short, long = (one.instrument.tube.mass(lens, field) for one in ends)
    needs = design.campaign.requirements
    assert needs.mass(ends[1]) - needs.mass(ends[0]) == pytest.approx(long - short)
    tight = replace(needs, max_mass=(needs.mass(ends[0]) + needs.mass(ends[1])) / 2)
    light, heavy = (cost_margins(tight, one)["mass"] for one in ends)
    assert light > 0 > heavy


def test_a_tube_of_a_hair_hides_nothing():
    """Up to grazing incidence the lens is lit, as without a baffle."""
    curve = transmittance_of(BaffleTube(10e-6), LENS, FIELD, 1.6)
    bare = np.cos(60 * deg) * (1 + (np.sin(60 * deg) / tube.SHOULDER) ** 2) ** (tube.SLOPE / 2)
    bare *= tube._per_steradian(1e-3) * math.pi / (4 * 1.6**2)
    assert curve(np.array([60 * deg]))[0] == pytest.approx(bare, rel=0.1)


def test_a_wall_inside_the_entrance_is_refused():
    with pytest.raises(Refused, match=r"tube\.diameter must be wider than the entrance"):
        replace(TUBE, diameter=50 * mm).shape(LENS, FIELD)


def test_a_wall_inside_the_entrance_is_refused_where_no_source_shines():
    case = load_design(shipped("designs/noise_only.toml")).case
    case = replaced(case, "instrument.baffle", None)
    case = replaced(case, "instrument.tube", replace(TUBE, diameter=5 * mm))
    with pytest.raises(Refused, match=r"tube\.diameter must be wider than the entrance"):
        run_trials(case, 1, range(1), Fidelity.FRAME)
