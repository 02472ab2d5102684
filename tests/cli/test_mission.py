"""`startrack mission` from its arguments to its table, picture and JSON."""

import csv
import json
from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from astropy.io import fits
from scipy.io import netcdf_file

from startrack import shipped
from startrack.cli import mission
from startrack.cli.main import main
from startrack.core import arcsec, deg
from startrack.mission import Fleet, exports, load_mission, placement, save_timeline, surrogate
from startrack.space import radiation

ORACLE = Path(__file__).parents[1] / "oracle"
DAY = ["--set", "time.duration=1 d"]


def survey_less(patch):
    """Survey the errors of a head at fewer directions and rates."""
    patch.setattr(surrogate, "PLACES", 192)
    patch.setattr(surrogate, "RATES", 2)


def draw_nothing(path, *_):
    path.write_bytes(b"")


def row_last(rows, head):
    return rows[-1][f"{head}_blind"]


def test_a_timeline_is_netcdf(tmp_path):
    """scipy's reader gives the same numbers, with units."""
    table = np.zeros(3, [("second", float), ("a b_sun_deg", float), ("a b_blind", np.uint8)])
    table["second"], table["a b_sun_deg"], table["a b_blind"] = [0, 10, 20], [1.5, 2, np.inf], 3
    save_timeline(tmp_path / "t.nc", table)
    with netcdf_file(tmp_path / "t.nc", mmap=False) as file:
        assert file.variables["a b_sun_deg"][:].tolist() == [1.5, 2, np.inf]
        assert file.variables["a b_sun_deg"].units == b"degree"
        assert file.variables["a b_blind"][:].tolist() == [3, 3, 3]


@pytest.mark.parametrize(
    ("begin", "duration", "days"),
    [
        ("2008-09-20T12:25:40", 3600.0, 0),  # the epoch of these elements
        ("2008-09-20T12:25:40", 10 * 86400.0, 10),
        ("2010-09-20T12:25:40", 3600.0, 730),
        ("2007-09-20T12:25:40", 3600.0, 366),
    ],
)
def test_the_age_of_two_line_elements_is_said(begin, duration, days):
    time = SimpleNamespace(begin=begin, duration=duration)
    lines = (
        "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
        "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
    )
    own = SimpleNamespace(
        time=time, orbit=SimpleNamespace(tle=lines), radiation=SimpleNamespace(hits=None)
    )
    said = mission._left_out(SimpleNamespace(loaded=SimpleNamespace(mission=own)))
    assert (f"up to {days} days from their epoch" in " ".join(said)) is (days > 0)


def test_a_head_without_the_motion_of_its_platform_is_said():
    """Two heads with one motion, of which one does not state it, and heads without motion."""
    moved = (np.array([9.0, 25.0, 4.0]) * arcsec**2, np.zeros(3))
    a, b, still = (
        SimpleNamespace(name=name, moved=moved[k]) for name, k in (("A", 0), ("B", 0), ("C", 1))
    )
    (both,) = mission._platform_lines(SimpleNamespace(heads=(a, b)))
    assert "4.12 across and 2.00 about (A), 4.12 across and 2.00 about (B); it is common" in both
    first, second = mission._platform_lines(SimpleNamespace(heads=(a, still)))
    assert first.endswith("(A)")
    assert "the design of C has no such motion" in second
    assert mission._platform_lines(SimpleNamespace(heads=(still,))) == []


def test_the_first_line_answers():
    """Availability, the error about the worst axis, and the requirement that is missed."""
    verdicts = [SimpleNamespace(name=name, met=name == "a") for name in ("a", "max_error")]
    flown = SimpleNamespace(known=np.array([True]), rms=np.array([1, 3, 2]) * arcsec)
    available = SimpleNamespace(at_least=lambda count: 0.25)
    flight = SimpleNamespace(available=available, flown=flown, verdicts=verdicts)
    assert mission._answer(flight) == (
        "at least 1 head valid 25.0000 % of the time; fused attitude 3.00 arcsec rms about the "
        "worst axis; 1 of 2 requirements met, not max_error"
    )


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A day of the example: the folder of its results, and what is printed."""
    out = tmp_path_factory.mktemp("flown") / "out"
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as printed:
        survey_less(patch)
        asked = ["--frames", "4", "--set", "check.fidelity=covariance"]
        status = main(["mission", *DAY, *asked, "--out", str(out), "--json"])
    assert status == 3  # the example's heads do not meet its requirements
    return out, json.loads(printed.getvalue())


def test_all_heads_are_rendered_together(flown):
    out, result = flown
    with (out / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    for h, head in enumerate(result["frames"]["heads"]):
        tried = [row for row in rows if int(row["head"]) == h and row["blind"] == "0"]
        assert head["tried"] == len(tried)
        assert head["right"] <= len(tried)
        assert 0.3 < head["across_ratio"][0] < 2
    assert result["frames"]["between"] == []  # of too few frames


def test_the_lightest_heads_are_searched(capsys, tmp_path, monkeypatch):
    survey_less(monkeypatch)
    monkeypatch.setattr(placement, "WINDOWS", 1)
    monkeypatch.setattr(placement, "COARSE", 60 * deg)
    asked = ["--set", "time.duration=6000 s", "--place", "--heads", "2", "--baffle"]
    out = ["--out", str(tmp_path), "--json"]
    main(["mission", *asked, "30", "60", *out])
    [trade] = json.loads(capsys.readouterr().out)["trades"]
    assert trade["heads"] == 2
    assert 30 <= trade["baffle_deg"] <= 60
    heads = load_mission(tmp_path / "placed.toml").mission.heads
    assert [head.exclusion.sun / deg for head in heads] == pytest.approx([trade["baffle_deg"]] * 2)
    assert main(["mission", *asked, "30", *out]) == 2
    assert "two angles" in capsys.readouterr().err


def test_a_mission_is_flown(flown):
    out, result = flown
    assert result["steps"] == 8640
    assert result["left_out"] == []
    assert sum(result["availability"]["exactly"]) == pytest.approx(1)
    assert not all(one["met"] for one in result["requirements"])
    for name in ("mission", "beta", "tracks"):
        assert cv2.imread(str(out / f"{name}.png")) is not None
    assert json.loads((out / "summary.json").read_text())["heads"] == result["heads"]
    with open(out / "timeline.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8640
    both = result["availability"]["at_least"][3]
    page = (out / "report.html").read_text()
    assert "NOT MET" in page
    assert page.count("data:image/png;base64") == 3
    beta = result["by_beta"]
    assert sum(one["time"] for one in beta) == pytest.approx(1)
    one = sum(each["time"] * each["one"] for each in beta)
    assert one == pytest.approx(sum(result["availability"]["valid"][1:]))
    times = [each["reacquisition_s"]["times"] for each in result["heads"]]
    assert times == [
        each["times_blind"] - (row_last(rows, each["name"]) != "0") for each in result["heads"]
    ]
    assert sum(row["valid_heads"] == "3" for row in rows) / len(rows) == pytest.approx(both)
    blind = sum(row["up-right_blind"] != "0" for row in rows) / len(rows)
    assert 1 - blind == pytest.approx(result["heads"][1]["valid"])


@pytest.mark.slow
def test_heads_are_placed(capsys, tmp_path, monkeypatch):
    survey_less(monkeypatch)
    monkeypatch.setattr(placement, "WINDOWS", 6)
    monkeypatch.setattr(placement, "GRID", 0.6)
    monkeypatch.setattr("startrack.mission.map_of", partial(placement.map_of, step=0.4))
    for draw in ("draw_mission", "draw_beta"):  # of a mission that is flown
        monkeypatch.setattr(f"startrack.plots.{draw}", draw_nothing)
    out = tmp_path / "out"
    changes = ["time.duration=3 d", "time.step=60 s"]
    options = [text for one in changes for text in ("--set", one)]
    status = main(["mission", *options, "--place", "--out", str(out), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert status in (0, 3)
    assert max(result["after"]["fused_rms_arcsec"]) < max(result["before"]["fused_rms_arcsec"])
    assert cv2.imread(str(out / "placement.png")) is not None
    again = load_mission(out / "placed.toml").mission
    assert again.heads[0].azimuth * 57.29578 == pytest.approx(
        result["mountings"][0]["azimuth_deg"], abs=1e-4
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("time.step=0 s", "time.step must be positive"),
        ('time.begin="yesterday"', "must be a time such as"),
        ("orbit.altitude=40000 km", "no orbit is Sun-synchronous"),
        ('attitude.law="aem"', "aem must be given with law"),
        ("orbits.altitude=3 km", "unknown"),
        ("time.duration=300 yr", "year of the end must lie in [1900, 2100]"),
        ("time.step=1 us", "number of steps (duration / step) must be"),
    ],
)
def test_wrong_missions_are_one_sentence(capsys, tmp_path, change, words):
    assert main(["mission", "--set", change, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_the_frame_of_an_instant_is_rendered(flown, capsys, tmp_path, monkeypatch):
    """The frame has the timeline's attitude, and an error of the size that the mission expects."""
    survey_less(monkeypatch)
    monkeypatch.setattr("startrack.cli.mission.draw_record", draw_nothing)
    status = main(["mission", *DAY, "--frame", "3000", "--out", str(tmp_path / "f"), "--json"])
    heads = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert status == 0
    assert [one["head"] for one in heads] == ["up-left", "up-right", "up-back"]
    with open(flown[0] / "timeline.csv") as file:
        row = next(row for row in csv.DictReader(file) if float(row["second"]) == 3000)
    for one in heads:
        assert float(row[f"{one['head']}_ra_deg"]) == pytest.approx(one["ra_deg"], abs=1e-4)
        assert float(row[f"{one['head']}_dec_deg"]) == pytest.approx(one["dec_deg"], abs=1e-4)
        assert one["error_across_arcsec"] < 6 * one["expected_across_rms_arcsec"]
        assert fits.getdata(one["fits"]).shape == (512, 512)
    assert main(["mission", *DAY, "--frame", "1e6", "--out", str(tmp_path / "f")]) == 2


def test_a_design_is_exported(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(exports, "SMEARS", (1.0,))
    out = tmp_path / "export"
    assert main(["export", "aocs", "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["name"] == "noise_only"
    assert {path.name for path in out.iterdir()} == {
        "startrack_head.c",
        "startrack_head.h",
        "startrack_head_data.h",
        "startrack_head.json",
    }


@pytest.mark.slow
def test_several_missions_over_workers(capsys, tmp_path):
    """Two workers give the same results as one."""
    text = shipped("missions/sun-synchronous.toml").read_text()
    files = []
    for name, step in (("a", "60 s"), ("b", "120 s")):
        files.append(tmp_path / f"{name}.toml")
        text_here = text.replace('"365 d"', '"1 d"').replace('"10 s"', f'"{step}"')
        files[-1].write_text(text_here + '\n[radiation]\nhits = "5 mm"\n' * (name == "b"))
    found = []
    for workers in ("1", "2"):
        out = ["--out", str(tmp_path / workers), "--workers", workers, "--json"]
        assert main(["mission", *map(str, files), *out]) == 3
        lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        assert [one["steps"] for one in lines] == [1440, 720]
        assert not lines[0]["left_out"]
        assert "hits of protons and electrons (radiation.hits)" in lines[1]["left_out"][0]
        found.append([{**one, "out": ""} for one in lines])
        assert (tmp_path / workers / "b" / "report.html").exists()
    assert found[0] == found[1]
    assert main(["mission", str(files[0]), str(files[0])]) == 2


def test_the_dose_of_the_orbit_is_printed_where_detectors_age_in_it(tmp_path, monkeypatch):
    """A geostationary orbit behind 5 mm, compared with SHIELDOSE-2; electrons make nearly all of
    the dose."""
    pytest.importorskip("radbelt")
    monkeypatch.setattr(radiation, "PLACES", 200)  # a circle about the equator is much the same
    text = shipped("missions/sun-synchronous.toml").read_text()
    text = text.replace("designs/noise_only.toml", "designs/nanosatellite.toml")
    (tmp_path / "mission.toml").write_text(text)
    changes = ["orbit.altitude=35786 km", "orbit.local_time=", "orbit.inclination=0 deg"]
    plans = [
        SimpleNamespace(loaded=load_mission(tmp_path / "mission.toml", [*changes, *more]))
        for more in ([], ["radiation.ageing=orbit"])
    ]
    assert mission._radiation(plans[0]) == []
    [row] = mission._radiation(plans[1])
    assert row["shielding_mm"] == 5
    oracle = json.loads((ORACLE / "shieldose.json").read_text())
    [there] = [orbit for orbit in oracle["orbits"] if orbit["altitude_km"] == 35786]
    expected = sum(rad[oracle["aluminium_mm"].index(5)] for rad in there["rad_per_year"].values())
    assert row["krad_per_year"] == pytest.approx(expected / 1e3, rel=0.15)
    assert 1e8 < row["protons_10_mev_per_cm2_year"] < 1e10


def test_drawn_units_are_judged_by_the_limit_of_the_mission():
    """Forty spacecraft with 1 to 6 arcsec about the worst axis: 95 % keep 7, and not 5."""
    rms = np.linspace(1, 6, 40)[:, None] * arcsec * np.ones(3)
    fleet = Fleet(rms, rms, np.stack([rms[:, :2]], axis=1), np.zeros((1, 3)), 1.0, None)
    for limit, met, verdict in ((5.0, False, "NOT MET"), (7.0, True, "met")):
        needs = SimpleNamespace(max_error=limit * arcsec)
        loaded = SimpleNamespace(mission=SimpleNamespace(requirements=needs))
        plan = SimpleNamespace(loaded=loaded, heads=[SimpleNamespace(name="A")])
        assert mission._fleet_values(plan, fleet)["max_error_met"] is met
        line = f"max_error of {limit:g} arcsec by 95 % of the spacecraft: {verdict}"
        assert line in mission._fleet_text(plan, fleet)
