"""Temperatures along a mission, and spacecraft of drawn units, compared with other methods."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import Refused, arcsec, deg
from startrack.design import Fidelity, load_design
from startrack.io import shipped
from startrack.mission import fly_units, load_mission, placement, plan_of
from startrack.mission import units as of_units
from startrack.mission.engine import at
from startrack.mission.fusion import fuse
from startrack.mission.surrogate import COLUMNS, ROWS, Surrogate
from startrack.mission.units import temperatures_of
from startrack.space import Heat, orbit_temperatures
from startrack.trial import run_trials

STRUCTURE = """
[instrument.structure]
material = "aluminium"
swing = "5 K"
gradient_x = "20 K / m"
gradient_y = "10 K / m"

[[variation]]
name = "instrument.mounting.x"
law = "normal"
sigma = "10 arcsec"
per = "launch"
"""
MISSION = """
[time]
begin = "2026-03-20T12:00:00"
duration = "5800 s"
step = "60 s"
[orbit]
altitude = "600 km"
local_time = "10.5 h"
"""
HEAD = """
[[heads]]
name = "{0}"
design = "head.toml"
azimuth = "{1} deg"
elevation = "-60 deg"
exclusion = {{ sun = "{2} deg", moon = "1 deg", earth = "1 deg" }}
"""


def plan_with(tmp_path, heads, across=2.0, about=20.0):
    """A plan whose heads have constant errors (arcsec)."""
    text = shipped("designs/noise_only.toml").read_text()
    (tmp_path / "head.toml").write_text(text + STRUCTURE)
    (tmp_path / "mission.toml").write_text(MISSION + "".join(HEAD.format(*head) for head in heads))
    plan = plan_of(load_mission(tmp_path / "mission.toml"), errors=False)
    values = [2 * math.log(across * arcsec), 2 * math.log(about * arcsec), 1.0]
    table = np.repeat(values, ROWS * COLUMNS).reshape(3, 1, 1, 1, 1, -1)
    one = Surrogate(np.zeros(1), np.array([22.0]), np.zeros(1), np.zeros(1), table, np.zeros(1))
    many = len(plan.heads)
    return replace(plan, surrogates=(one,) * many, stray=(None,) * many)


def test_temperatures_are_those_of_the_periodic_orbit(tmp_path):
    """Integration in time, compared with Newton's method over an orbit; 600 km, a head at the
    zenith.

    The Sun is 0.4 % nearer than 1 au in March, which is 0.3 K.
    """
    plan = plan_with(tmp_path, [("up", 0, 5)])
    up = replace(plan.heads[0], axes=np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]))
    heat = Heat(altitude=600e3, local_time=10.5 * 3600, capacity=30e3)
    found, periodic = temperatures_of(replace(plan, heads=(up,)), heat), orbit_temperatures(heat)
    place = np.arange(len(periodic.head)) / len(periodic.head) * periodic.period
    for marched, known in ((found.platform, periodic.platform), (found.heads[0], periodic.head)):
        assert np.ptp(known) > 2
        assert np.abs(np.interp(place, found.second, marched) - known).max() < 1.0
    side = np.interp(place, found.second, found.sides[0, 0])
    assert (side - periodic.side_x).std() < 0.2 * periodic.side_x.std()


def test_the_motion_of_the_platform_is_one_in_every_sum_of_heads(tmp_path):
    """Three heads of 2.5 arcsec, of which 2 are the platform's motion: their fusion is no better
    than 2."""
    heads = [("left", -90, 60), ("right", 90, 60), ("back", 180, 60)]
    plan = plan_with(tmp_path, heads, math.hypot(1.5, 2.0), math.hypot(15.0, 2.0))
    moved = np.full(3, 2 * arcsec) ** 2
    of_platform = replace(plan, heads=tuple(replace(head, moved=moved) for head in plan.heads))
    still = plan_with(tmp_path, heads, 1.5, 15.0)
    instants = plan.motion.at(0.0, 60.0, 100)
    want = at(still, instants).variance + (2 * arcsec) ** 2
    assert at(of_platform, instants).variance == pytest.approx(want, rel=1e-9)
    apart = at(plan, instants).variance  # of the heads' own mounts
    three = np.all([seen.blind == 0 for seen in at(plan, instants).seen], axis=0)
    assert three.sum() > 10
    assert apart[:, three].min() < 0.7 * (2 * arcsec) ** 2 < want[:, three].min()
    bias = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(of_units, "_drawn", lambda *_: bias)
        patch.setattr(of_units, "turned_by_heat", lambda *a: np.zeros((3, len(a[3].second))))
        fleet, alone = (fly_units(one, 1, 1).rms for one in (of_platform, still))
    assert fleet**2 - alone**2 == pytest.approx(np.full((1, 3), (2 * arcsec) ** 2), rel=1e-6)


def test_two_heads_of_one_direction_share_the_platforms_motion(tmp_path, monkeypatch):
    """Their covariance in closed form: half of the heads' own noise, and all of the motion.

    Trials correct the variance across by 1.5 and about by 3, and the motion with it. The placement
    of heads uses the errors without this correction.
    """
    plan = plan_with(tmp_path, [("first", 0, 60), ("second", 0, 60)])
    moved = (arcsec * np.array([1.0, 1.0, 4.0])) ** 2
    factor = np.array([1.5, 3.0])
    correction = SimpleNamespace(
        coefficient=np.log(factor)[:, None],
        features=lambda values: np.ones_like(values["stars"])[:, None],
    )
    heads = tuple(replace(head, moved=moved) for head in plan.heads)
    stars = np.zeros(ROWS * COLUMNS)
    corrected = tuple(replace(one, stars=stars, correction=correction) for one in plan.surrogates)
    noise = (arcsec * np.array([2.0, 2.0, 20.0])) ** 2 - moved

    def variance(factor):
        camera = (noise / 2 + moved) * factor
        axes = plan.heads[0].axes
        return np.diag(axes @ np.diag(camera) @ axes.T)

    seen = at(replace(plan, heads=heads, surrogates=corrected), plan.motion.at(0.0, 60.0, 20))
    free = seen.seen[0].blind == 0
    assert free.sum() > 5
    want = variance(factor[[0, 0, 1]])
    assert seen.variance[:, free] == pytest.approx(np.tile(want[:, None], free.sum()), rel=1e-9)
    monkeypatch.setattr(placement, "WINDOWS", 2)
    placed = placement.place(replace(plan, heads=heads), grid_step=90 * deg, evaluations=0)
    assert placed.before.error**2 == pytest.approx(variance(1.0).max(), rel=1e-9)


def test_fused_errors_are_those_of_fused_rotations(tmp_path, monkeypatch):
    """Biases and thermo-elastic turns as rotations, fused one step after the other."""
    plan = plan_with(tmp_path, [("left", -90, 60), ("right", 90, 60), ("back", 180, 60)])
    bias = np.array([[[30.0, -20, 90], [-10, 25, -40], [15, 5, 120]]]) * arcsec
    monkeypatch.setattr(of_units, "_drawn", lambda *_: (bias, np.zeros((1, 3, 3))))
    fleet = fly_units(plan, 1, 1)
    chunk = at(plan, plan.motion.at(0.0, 60.0, plan.loaded.mission.time.steps))
    errors = []
    for n, phase in enumerate(chunk.instants.phase):
        given = []
        for h, head in enumerate(plan.heads):
            if chunk.seen[h].blind[n]:
                continue
            turns = of_units.turns_of(plan.loaded.designs[h].case)
            case = plan.loaded.designs[h].case.instrument
            loads = case.structure.loads(case.optics, np.array([phase / math.tau]))
            error = bias[0, h] - (turns @ loads)[:, 0]
            size = np.diag(np.array([2.0, 2, 20]) ** 2 * arcsec**2)
            given.append((head.axes @ error, head.axes @ size @ head.axes.T))
        if given:
            turned = [Rotation.from_rotvec(error) for error, _ in given]
            mean, size = fuse(turned, [cov for _, cov in given])
            errors.append(mean.as_rotvec() ** 2 + np.diag(size))
    assert 60 < len(errors) <= 97
    np.testing.assert_allclose(fleet.rms[0], np.sqrt(np.mean(errors, axis=0)), rtol=1e-3)
    assert fleet.aligned[0].max() < fleet.rms[0].max()


def test_drawn_units_are_those_of_the_budget(tmp_path):
    """One head alone: the squares of its biases, of its structure and of its noise add up."""
    plan = plan_with(tmp_path, [("up", 0, 5)])
    fleet = fly_units(plan, 12, 3)
    across, about = fleet.heads[:, 0].T
    np.testing.assert_allclose((fleet.rms**2).sum(axis=1), 2 * across**2 + about**2, rtol=1e-6)
    # Ten arcseconds about x alone are 7.1 per axis; twelve units know that to 20 %.
    turned = math.sqrt(float((across**2).mean()) - (fleet.swing[0, :2] ** 2).mean())
    assert turned / arcsec == pytest.approx(math.hypot(10 / math.sqrt(2), 2), rel=0.5)
    assert fleet.level().low <= fleet.level().value
    structure = plan.loaded.designs[0].case.instrument.structure
    swings = structure.swings(plan.loaded.designs[0].case.instrument.optics)
    np.testing.assert_allclose(fleet.swing[0], swings, rtol=0.05)


def test_a_detector_that_moves_turns_the_sky_as_in_trials():
    """Trials with the principal point displaced by 10 K, compared with the rotation in a
    mission."""
    structure = 'instrument.structure={material="aluminium", detector_offset="5 mm"}'
    case = load_design(shipped("designs/noise_only.toml"), [structure]).case
    instrument, optics = case.instrument, case.instrument.optics
    moved = instrument.structure.responses(optics, instrument.detector.pitch)
    pixel = 10 * float(moved["instrument.optics.principal_x"][0])
    true = replace(instrument, structure=None, optics=replace(optics, principal_x=pixel))
    still = replace(case, instrument=replace(instrument, structure=None))
    knowing = replace(case.tracker, camera=still.instrument.camera)
    errors = []
    for trial in (still, replace(case, instrument=true, tracker=knowing)):
        table = run_trials(trial, 1, range(20), Fidelity.COVARIANCE)
        errors.append([table[f"error_{axis}"].mean() for axis in "xyz"])
    turned = -of_units.turns_of(case) @ [10.0, 0, 0, 0, 0]
    assert abs(turned[1]) > 2 * arcsec
    np.testing.assert_allclose(np.diff(errors, axis=0)[0, :2], turned[:2], atol=0.05 * arcsec)


def test_units_that_do_not_differ_are_refused(tmp_path):
    plan = plan_with(tmp_path, [("up", 0, 5)])
    alike = replace(plan.loaded, designs=(load_design(shipped("designs/noise_only.toml")),))
    plan = replace(plan, loaded=alike)
    with pytest.raises(Refused, match="so that its units differ"):
        of_units._drawn(plan, 2, 1)


def test_detectors_age_in_the_orbit_of_the_mission(tmp_path):
    text = shipped("designs/noise_only.toml").read_text()
    age = '\n[instrument.detector.age]\ntime = "1 yr"\ninclination = "30 deg"\nshielding = "5 mm"\n'
    (tmp_path / "head.toml").write_text(text + age)
    (tmp_path / "mission.toml").write_text(MISSION + HEAD.format("up", 0, 5))
    named, flown = (
        load_mission(tmp_path / "mission.toml", changes).designs[0].case.instrument.detector.age
        for changes in ([], ["radiation.ageing=orbit"])
    )
    assert (named.altitude, named.inclination) == (550e3, pytest.approx(math.radians(30)))
    assert (flown.altitude, flown.inclination) == (600e3, pytest.approx(1.7066, abs=1e-3))
