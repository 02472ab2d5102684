"""Times without an attitude, availability and verdicts."""

import dataclasses

import numpy as np
import pytest

from startrack import load_design, shipped
from startrack.mission import engine, flown_from, load_mission, plan_of, store, surrogate
from startrack.mission.engine import Flown
from startrack.mission.heads import Blind
from startrack.mission.parameters import MissionRequirements
from startrack.mission.store import key_of
from startrack.mission.summary import availability_of, intervals_of, reacquisition_of, verdicts
from startrack.report import verdict_table


def flown(*blind):
    steps = np.array(blind, np.uint8)
    heads, count = steps.shape
    return Flown(
        10.0,
        steps,
        np.zeros(count, bool),
        np.zeros((heads, 3)),
        np.zeros((heads, 5)),
        np.zeros((heads, 2)),
        *(np.zeros((1, 1)) for _ in range(3)),
        np.zeros((3, 1, 1)),
        np.zeros((heads, 4)),
        np.zeros(heads + 1),
        [],
        np.zeros((7, 2, 1)),
        ([],) * heads,
    )


def test_spells_are_counted_as_by_hand():
    found = intervals_of(np.array([1, 1, 0, 1, 0, 0, 1, 1, 1, 1], bool), 10.0)
    assert found.begin.tolist() == [0, 30, 60]
    assert found.length.tolist() == [20, 10, 40]
    assert found.longest == 40
    assert found.histogram()[:3].tolist() == [1, 1, 1]
    assert found.worst(1) == [(60.0, 40.0)]
    assert intervals_of(np.zeros(5, bool), 10.0).longest == 0


def test_availability_is_counted_as_by_hand():
    found = availability_of(flown([1, 0, 0, 3], [0, 0, 4, 2], [0, 0, 0, 4]))
    assert found.heads.tolist() == [0.25, 0, 0.5, 0.25]
    assert found.at_least(1) == 0.75
    assert found.causes[Blind.SUN].tolist() == [0.5, 0, 0]
    assert found.causes[Blind.MOON].tolist() == [0.25, 0.25, 0]
    assert found.alone.tolist() == [0.5, 0.5, 0.75]
    assert found.none.longest == 10
    told = verdicts(
        MissionRequirements(max_blind=5.0, availability_one=0.7, availability_two=0.8), found
    )
    assert [one.met for one in told] == [False, True, False]


def test_a_head_that_is_never_valid_has_no_error_and_meets_no_limit_of_it():
    always_blind = flown([1, 1, 4])
    assert np.isposinf(always_blind.rms).all()
    assert np.isposinf(always_blind.head_rms).all()
    error = float(always_blind.rms.max())
    needs = MissionRequirements(max_error=2.0)
    [verdict] = verdicts(needs, availability_of(always_blind), error)
    assert not verdict.met
    assert verdict_table([verdict]).text((0,))[1].split()[1:] == [
        *("no", "attitude"),
        *("412530", "arcsec"),
        *("NOT", "MET"),
    ]


def test_needs_are_refused_by_name():
    with pytest.raises(ValueError, match="availability_one must lie in"):
        MissionRequirements(availability_one=1.5)


def test_reacquisition_is_that_of_drawn_frames():
    """Mean and 99 % level, compared with a million drawn series of frames: within 1 %."""
    case = load_design(shipped("designs/noise_only.toml")).case
    chances = [0.9, 0.5, 0.2, 1.0]
    found = reacquisition_of(case, chances)
    draw = np.random.default_rng(3)
    frames = np.concatenate([draw.geometric(one, 250_000) for one in chances])
    detector = case.instrument.detector
    latency = detector.exposure / 2 + detector.rows * detector.columns / detector.pixel_rate
    times = latency + (frames - draw.uniform(size=len(frames))) / detector.update_rate
    assert found.mean == pytest.approx(times.mean(), rel=0.01)
    assert found.level == pytest.approx(np.quantile(times, 0.99), rel=0.01)
    assert reacquisition_of(case, []).times == 0


class Stopped(Exception):
    pass


@pytest.mark.parametrize("trials", [0, pytest.param(20, marks=pytest.mark.slow)])
def test_a_stopped_mission_goes_on(tmp_path, monkeypatch, trials):
    """Equal to the bit to an uninterrupted run; no part is computed twice; another mission
    begins anew."""
    monkeypatch.setattr(engine, "PART", 300)
    monkeypatch.setattr(surrogate, "PLACES", 192)
    loaded = load_mission(
        shipped("missions/sun-synchronous.toml"),
        [
            "time.duration=20000 s",
            "time.step=20 s",
            f"check.trials={trials}",
            'check.fidelity="spots"',
            'attitude.yaw="velocity"',
        ],
    )
    plan, once = plan_of(loaded), []
    straight = flown_from(plan, None)
    part = engine.fly_part

    def counted(plan, first, count):
        if first == 600 and len(once) == 2:
            raise Stopped
        once.append(first)
        return part(plan, first, count)

    monkeypatch.setattr(store, "fly_part", counted)
    path = tmp_path / "mission.sqlite"
    with pytest.raises(Stopped):
        flown_from(plan, path)
    once.append("again")
    monkeypatch.setattr(store, "checked", None)  # it is kept what the trials say
    again = flown_from(plan, path)
    assert once == [0, 300, "again", 600, 900]
    assert again[1] == straight[1]
    for one in dataclasses.fields(Flown):
        mine, theirs = (getattr(each[2], one.name) for each in (again, straight))
        assert np.array_equal(mine, theirs) if isinstance(mine, np.ndarray) else mine == theirs
    moved = dataclasses.replace(
        loaded.mission.heads[0], design=str(tmp_path / "elsewhere.toml"), name="up-left"
    )
    heads = (moved, *loaded.mission.heads[1:])
    same = dataclasses.replace(loaded, mission=dataclasses.replace(loaded.mission, heads=heads))
    assert key_of(same) == key_of(loaded)
    turned = dataclasses.replace(moved, azimuth=0.1)
    other = dataclasses.replace(loaded.mission, heads=(turned, *heads[1:]))
    assert key_of(dataclasses.replace(loaded, mission=other)) != key_of(loaded)
    orbit, law, clock = (tmp_path / name for name in ("a.bsp", "a.bc", "a.tsc"))
    filed = dataclasses.replace(
        loaded.mission,
        orbit=dataclasses.replace(loaded.mission.orbit, altitude=None, oem=str(orbit)),
        attitude=dataclasses.replace(loaded.mission.attitude, law="aem", aem=str(law)),
    )
    keys = set()
    for content, file in enumerate((orbit, law, clock) * 2):
        file.write_bytes(b"%d" % content)
        keys.add(key_of(dataclasses.replace(loaded, mission=filed)))
    assert len(keys) == 6
