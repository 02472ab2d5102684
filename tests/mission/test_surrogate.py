"""The error that a mission expects equals that of trials at its own attitudes."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack import Fidelity, run_trials, shipped
from startrack.budget import survey
from startrack.core import deg
from startrack.design import KeepOut
from startrack.detector import Age, Thermal
from startrack.mission import load_mission, plan_of, surrogate, timeline
from startrack.mission.parameters import Check, HeadTemperature, MissionRequirements
from startrack.mission.rendered import checked, fitted, judged_by_the_other_half, scenes_at
from startrack.mission.surrogate import Ranges, cell_of, middles, places_of, surrogate_of
from startrack.optics import Baffle

EXAMPLE = shipped("missions/sun-synchronous.toml")
INSTANTS = 250
YAW = 'attitude.yaw="velocity"'  # the same rate at all times
DAYS = 60
CHANGES = [f"time.duration={DAYS} d", "time.step=60 s", YAW]


@pytest.fixture(scope="module")
def plan():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(surrogate, "PLACES", 1536)
        return plan_of(load_mission(EXAMPLE, CHANGES))


def test_errors_are_those_of_trials(plan):
    """Rms over random instants of two months, by trials of fidelity `covariance`: within 12 %.

    The rms of 250 drawn errors has a standard error of 3.2 % across, where two axes count, and of
    4.5 % about for equal errors; where they differ over the sky, of up to twice that.
    """
    second = np.random.default_rng(3).uniform(0, DAYS * 86400, INSTANTS)
    head = [scenes_at(plan, one)[0] for one in second]
    assert np.ptp([one.case.instrument.motion.rate for one in head]) < 1e-6  # the same at all times
    attitudes = Rotation.concatenate([one.icrs_to_camera for one in head])
    drawn = run_trials(head[0].case, 1, range(INSTANTS), Fidelity.COVARIANCE, attitudes)
    right = drawn["solved"] & ~drawn["false"]
    assert right.mean() == pytest.approx(np.mean([one.solved for one in head]), abs=0.02)
    for axes, name in (("xy", "across"), ("z", "about")):
        got = np.mean([(drawn[f"error_{axis}"][right] ** 2).mean() for axis in axes])
        expected = np.mean([getattr(one, name) ** 2 for one in head])
        assert np.sqrt(got / expected) == pytest.approx(1, abs=0.12), name


def test_like_heads_share_surveys_of_which_there_are_as_many_as_the_smear_asks_for(
    plan, monkeypatch
):
    """Two rates that smear a star by 0.2 pixel more or less, and at most four for any smear."""
    loaded, counted, done = plan.loaded, list[int](), list[float]()
    case = loaded.designs[0].case
    of_sky = survey(case, 48)

    def count(_case, places):
        counted.append(places)
        return of_sky

    monkeypatch.setattr(surrogate, "survey", count)
    shared = plan_of(loaded, advance=done.append).surrogates
    assert len(counted) == 2  # the slowest and the fastest of the heads
    assert len(shared) == len(loaded.mission.heads) == sum(done) == 3
    assert shared[0] is shared[2]
    apart = np.sqrt(4 * np.pi / places_of(case))
    assert apart == pytest.approx(case.instrument.camera.half_diagonal / 3, rel=1e-3)
    pixel = 1 / (case.instrument.detector.exposure * case.instrument.camera.focal_length_px)
    for smear, rates in ((0.2, 2), (0.8, 4), (50.0, 4)):
        counted.clear()
        done.clear()
        surrogate_of(case, Ranges((0.0, smear * pixel), case.scene.sky_g), advance=done.append)
        assert len(counted) == rates
        assert sum(done) == pytest.approx(1)


def test_a_correction_finds_what_trials_differ_by():
    """Squared errors drawn with a known factor over two features, and none over a third.

    Each coefficient is within five standard errors, and these equal the scatter of 100 repetitions.
    """
    true, draw, found = np.array([0.3, -0.4, 0.0]), np.random.default_rng(4), []
    for _ in range(100):
        values = {"stars": draw.uniform(2, 5, 400), "rate": draw.uniform(0, 1e-3, 400)}
        features = fitted(np.ones((400, 2)), values).features(values)
        factor = np.exp(features @ true)
        ratio = factor[:, None] * np.stack(
            [draw.exponential(size=400), draw.chisquare(1, size=400)], axis=1
        )
        found.append(fitted(ratio, values))
    for k in (0, 1):
        got = np.array([one.coefficient[k] for one in found])
        spread = found[0].spread[k]
        assert np.abs(got.mean(axis=0) - true).max() < 5 * spread.max() / np.sqrt(100) + 0.08
        assert got.std(axis=0) == pytest.approx(spread, rel=0.3)


def test_each_half_is_judged_with_what_the_other_half_says():
    """A factor that both halves have is removed; one that differs is removed with the wrong
    sign."""
    draw = np.random.default_rng(4)
    values = {"stars": draw.uniform(2, 5, 4000), "rate": draw.uniform(0, 1e-3, 4000)}
    noise = draw.exponential(size=(4000, 2))
    steep = np.exp(0.6 * (values["stars"] - 3.5))[:, None]
    left = judged_by_the_other_half(steep * noise, values)
    assert np.cov(np.log(steep).T, left[:, 0])[0, 1] == pytest.approx(0, abs=0.05)
    assert left.mean() == pytest.approx(1, abs=0.06)
    apart = np.where(np.arange(4000) % 2 == 0, 1.5, 0.7)[:, None]
    left = judged_by_the_other_half(apart * noise, values)
    assert left[::2].mean() == pytest.approx(1.5 / 0.7, rel=0.06)
    assert left[1::2].mean() == pytest.approx(0.7 / 1.5, rel=0.06)


def old_and_warm(trials):
    """A head that ages by eight years in 20 days, and whose temperature varies over the orbit."""
    loaded = load_mission(EXAMPLE, ["time.duration=20 d", "time.step=60 s", YAW])
    case = loaded.designs[0].case
    fast = 8 / (20 * 86400)  # 1 / second, for one a year
    age = Age(time=0.0, fluence=3e10 * fast, sensitivity_loss=0.08 * fast)
    detector = dataclasses.replace(case.instrument.detector, thermal=Thermal(303.15), age=age)
    case = dataclasses.replace(
        case, instrument=dataclasses.replace(case.instrument, detector=detector)
    )
    head = dataclasses.replace(
        loaded.mission.heads[0], age=0.0, temperature=HeadTemperature(swing=12.0, ahead=1.0)
    )
    mission = dataclasses.replace(
        loaded.mission,
        heads=(head,),
        check=Check(trials, Fidelity.WINDOW),
        requirements=MissionRequirements(),
    )
    design = dataclasses.replace(loaded.designs[0], case=case)
    return plan_of(dataclasses.replace(loaded, mission=mission, designs=(design,)))


@pytest.mark.slow
def test_heads_age_and_warm(monkeypatch):
    monkeypatch.setattr(surrogate, "PLACES", 384)
    plan = old_and_warm(0)
    table = timeline(plan)
    error = table["up-left_across_arcsec"] ** 2
    young, old = table["second"] < 3 * 86400, table["second"] > 17 * 86400
    assert error[old].mean() > 1.1 * error[young].mean()
    warm = np.sin(np.radians(table["orbit_phase_deg"]) + 1.0)
    assert error[warm > 0.7].mean() > 1.02 * error[warm < -0.7].mean()


@pytest.mark.slow
def test_errors_of_old_and_warm_heads_are_those_of_trials():
    """Windows over ages and temperatures, within 4.5 standard errors, with and without the
    correction.

    Stars near hot pixels make the distribution of errors long-tailed: 8 of 320 trials made 40 % of
    the squares. Therefore a ratio of 80 is uncertain by 22 %, and a correction that has little to
    correct does not improve it.
    """
    plan, (found,) = checked(old_and_warm(80))
    for value, error in (found.across, found.corrected_across, found.about, found.corrected_about):
        assert value == pytest.approx(1, abs=4.5 * error)
    assert found.attitudes == pytest.approx(found.expected, abs=4)
    assert set(plan.surrogates[0].correction.feature) == {"all", "stars", "temperature", "age"}


def test_cells_hold_their_middles():
    middle = middles()
    assert (cell_of(middle.T) == np.arange(len(middle))).all()
    # Each direction is near the middle of its cell, except at the poles.
    line = np.random.default_rng(1).normal(size=(3, 5000))
    line /= np.linalg.norm(line, axis=0)
    line = line[:, np.abs(line[2]) < 0.9]
    apart = np.arccos((middle[cell_of(line)].T * line).sum(axis=0))
    assert apart.max() < 2.5 * deg


@pytest.mark.slow
def test_stray_light_raises_the_error(monkeypatch):
    """Behind a weak baffle a head is worse near the Sun; its exclusion angle is the baffle's."""
    monkeypatch.setattr(surrogate, "PLACES", 768)
    loaded = load_mission(EXAMPLE, [*CHANGES, "time.duration=2 d"])
    case = loaded.designs[0].case
    baffle = Baffle((20 * deg, 60 * deg, 100 * deg), (3e-7, 1e-8, 1e-10))
    case = dataclasses.replace(case, instrument=dataclasses.replace(case.instrument, baffle=baffle))
    design = dataclasses.replace(loaded.designs[0], case=case)
    free = KeepOut(sun=25 * deg, moon=15 * deg, earth=25 * deg)
    heads = [dataclasses.replace(one, exclusion=free) for one in loaded.mission.heads[:2]]
    heads[0] = dataclasses.replace(heads[0], exclusion=KeepOut(moon=15 * deg, earth=25 * deg))
    mission = dataclasses.replace(loaded.mission, heads=tuple(heads))
    plan = plan_of(dataclasses.replace(loaded, mission=mission, designs=(design,) * 2))
    assert 40 * deg < plan.heads[0].limits.sun < 100 * deg
    table = timeline(plan)
    sun, here = table["up-right_sun_deg"], table["up-right_blind"] == 0
    near, far = here & (sun < 45) & ~table["eclipse"], here & (sun > 100)
    assert near.sum() > 20
    error = table["up-right_across_arcsec"]
    assert np.sqrt((error[near] ** 2).mean()) > 1.3 * np.sqrt((error[far] ** 2).mean())
