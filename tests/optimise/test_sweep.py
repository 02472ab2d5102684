"""Sweeps and values at a limit, against single designs, hand calculations and dense sweeps."""

import dataclasses
import math
import sys

import numpy as np
import pytest

import startrack
from startrack import Fidelity, Refused, load_design, run_trials, save_design
from startrack.design import Campaign, Requirements, Variation
from startrack.metrics import Interval, summarise
from startrack.optimise import Ledger, TrialRunner, expect
from startrack.optimise.figures import DesignFigures, middle
from startrack.optimise.solve_for import KeyLine, read_limit
from startrack.optimise.sweep import SweptKey

F_NUMBER = "instrument.optics.f_number"
TRIALS = 20


@pytest.fixture(scope="module")
def path(small, tmp_path_factory):
    """The small design in its nominal condition alone, as a file."""
    needs = dataclasses.replace(small.campaign.requirements, max_rate=None)
    campaign = dataclasses.replace(small.campaign, requirements=needs)
    file = tmp_path_factory.mktemp("swept") / "small.toml"
    save_design(file, dataclasses.replace(small, campaign=campaign))
    return file


@pytest.mark.parametrize(
    ("text", "texts", "numbers"),
    [
        ("a.b=1..2", ("1", "1.5", "2"), (1, 1.5, 2)),
        ("a.b = 500 um .. 2 mm", ("0.5 mm", "1.25 mm", "2 mm"), (0.5, 1.25, 2)),
        ("a=20..40ms", ("20 ms", "30 ms", "40 ms"), (20, 30, 40)),
        ("a=10 %..90 %", ("10 %", "50 %", "90 %"), (10, 50, 90)),
        ("a=-1..1", ("-1", "0", "1"), (-1, 0, 1)),
        ("a=0..1", ("0", "0.5", "1"), (0, 0.5, 1)),
        ("a=2 mm,500 um", ("2 mm", "500 um"), (2000, 500)),
        ("a=imx174,cmv4000", ("imx174", "cmv4000"), None),
        ("a=true,false", ("true", "false"), None),
        (
            "a=2026-12-31T22:00 .. 2027-01-01T03:00",
            ("2026-12-31T22:00", "2027-01-01T00:30:00", "2027-01-01T03:00"),
            (0, 2.5, 5),
        ),
        ("a=2026-06-01,2026-06-02", ("2026-06-01", "2026-06-02"), (0, 24)),
    ],
)
def test_values_are_read_as_a_user_writes_them(text, texts, numbers):
    key = SweptKey.read(text, 3)
    assert key.texts == texts
    assert key.numbers == (pytest.approx(numbers) if numbers else None)


def test_ratios_are_equal_and_ends_exact():
    key = SweptKey.read("a=0.1..10 ms", 5, log=True)
    assert key.numbers[0] == 0.1
    assert key.numbers[-1] == 10
    np.testing.assert_allclose(np.diff(np.log(key.numbers)), math.log(100) / 4, rtol=2e-6)


@pytest.mark.parametrize(
    ("text", "log", "words"),
    [
        ("a", False, "must be KEY=A..B or KEY=A,B,C"),
        ("a=", False, "must be KEY=A..B or KEY=A,B,C"),
        ("a=1..", False, "must be a range such as"),
        ("a=1..x", False, "must be a range such as"),
        ("a=1..2..3", False, "must be a range such as"),
        ("a=2..1", False, "from low to high"),
        ("a=1 kg..1 mm", False, "unit that converts to mm"),
        ("a=0..1", True, "above 0"),
        ("a=1,,2", False, "each once"),
        ("a=1,1", False, "each once"),
        ("a=2026-06-02..2026-06-01", False, "from early to late"),
        ("a=2026-06-01..3", False, "or of dates"),
    ],
)
def test_what_is_no_range_is_refused(text, log, words):
    with pytest.raises(Refused, match=words):
        SweptKey.read(text, 3, log)


def test_hours_between_dates_are_written_as_dates():
    key = SweptKey.read("scene.date=2026-08-21T20:00..2026-08-22T03:00", 2)
    assert key.label == "date (h after 2026-08-21T20:00)"
    assert key.at(5.5) == "2026-08-22T01:30:00"


def test_a_whole_number_has_whole_values(path):
    key = SweptKey.read("tracker.detection.max_spots=10..12", 5, design=load_design(path))
    assert key.texts == ("10", "11", "12")


def test_by_formula_each_row_is_that_of_the_single_design(path):
    swept = startrack.sweep(path, f"{F_NUMBER}=1.2..1.8", points=2)
    for row in swept.rows:
        design = load_design(path, [f"{F_NUMBER}={row.values[0]}"])
        budget, margins, *_ = expect(design.case, design.campaign)
        assert row.figures.across == budget.whole.across
        assert row.figures.about == budget.whole.about
        assert row.figures.margins == margins
        assert row.figures.costs["mass"] == design.campaign.requirements.mass(design.case)


def test_by_trials_each_row_is_that_of_the_single_design(path):
    swept = startrack.sweep(
        path, f"{F_NUMBER}=1.8", trials=TRIALS, fidelity=Fidelity.COVARIANCE, runner=TrialRunner(3)
    )
    for row in swept.rows:
        case = load_design(path, [f"{F_NUMBER}={row.values[0]}"]).case
        summary = summarise(run_trials(case, 3, range(TRIALS), Fidelity.COVARIANCE))
        assert row.figures.across == summary.across
        assert row.figures.availability == summary.availability
        assert isinstance(row.margin("availability"), Interval)


def test_a_value_that_the_design_refuses_is_a_row(path):
    swept = startrack.sweep(path, f"{F_NUMBER}=1.4,-3")
    assert [bool(row.figures) for row in swept.rows] == [True, False]
    assert "must lie in [0.3, 200], got -3" in swept.rows[1].refused
    assert math.isnan(swept.table["across"][1])
    assert "1 values are refused" in swept.answer
    with pytest.raises(Refused, match="must lie in"):
        startrack.sweep(path, f"{F_NUMBER}=-4,-3")
    with pytest.raises(Refused, match="f_numbr"):
        startrack.sweep(path, "instrument.optics.f_numbr=1..2")


def test_a_saturation_beyond_the_converter_of_a_value_is_said(path):
    bits = "instrument.detector.bits=8,10"
    with pytest.warns(UserWarning, match="999, is above the largest number of 8 bits, 255"):
        startrack.sweep(path, bits, changes=["tracker.detection.saturation=999"])


def test_two_keys_and_words(path):
    swept = startrack.sweep(
        path, f"{F_NUMBER}=1.4,1.6", "tracker.detection.centroid=gravity,likelihood"
    )
    assert [row.values for row in swept.rows] == [
        ("1.4", "gravity"),
        ("1.4", "likelihood"),
        ("1.6", "gravity"),
        ("1.6", "likelihood"),
    ]
    data = pytest.importorskip("xarray") and swept.to_xarray()
    assert dict(data.sizes) == {F_NUMBER: 2, "tracker.detection.centroid": 2}
    across = data["across"].sel({F_NUMBER: 1.6, "tracker.detection.centroid": "likelihood"})
    assert float(across) == swept.rows[3].figures.across
    with pytest.raises(Refused, match="one or two"):
        startrack.sweep(path, "a=1", "b=1", "c=1")
    with pytest.raises(Refused, match="twice"):
        startrack.sweep(path, "a=1", "a=2")


def test_a_ledger_keeps_designs_and_trials(path, tmp_path, monkeypatch):
    def swept():
        with Ledger(tmp_path / "ledger.sqlite") as ledger:
            runner = TrialRunner(1, ledger=ledger)
            rows = startrack.sweep(path, f"{F_NUMBER}=1.2,1.5", runner=runner).rows
            tried = startrack.sweep(path, f"{F_NUMBER}=1.2,1.5", trials=8, runner=runner).rows
            return [str(row) for row in (*rows, *tried)]

    first = swept()
    monkeypatch.setattr("startrack.optimise.figures.expect", None)
    monkeypatch.setattr("startrack.optimise.runner.run", None)
    assert swept() == first


def test_the_mass_is_solved_for_as_by_hand(path):
    """mass = 0.15 kg + 6000 kg/m3 D^3 with D = f / N; the campaign has its own coefficients."""
    design = load_design(path)
    needs, optics = design.campaign.requirements, design.case.instrument.optics
    found = startrack.solve_for(path, F_NUMBER, "mass=0.4 kg", points=5)
    aperture = ((0.4 - needs.mass_fixed) / needs.mass_per_volume) ** (1 / 3)
    [crossing] = found.crossings
    assert crossing.value == pytest.approx(optics.focal_length / aperture, rel=1e-4)
    assert crossing.above
    assert "must be at least" in found.answer


@pytest.mark.slow
def test_an_error_is_solved_for_as_a_dense_sweep_has_it(path):
    """On the same skies and noise, so that the two differ only by the interpolation."""
    runner = TrialRunner(1)
    found = startrack.solve_for(
        path, f"{F_NUMBER}=1.2..2", "across=0.6 arcsec", points=4, trials=200, runner=runner
    )
    [crossing] = found.crossings
    near = crossing.value.value
    dense = startrack.sweep(
        path, f"{F_NUMBER}={0.95 * near}..{1.05 * near}", points=5, trials=200, runner=runner
    )
    error = np.log([row.figures.across.value / startrack.arcsec for row in dense.rows])
    root = np.interp(math.log(0.6), error, dense.keys[0].numbers)
    assert near == pytest.approx(root, rel=0.005)
    assert crossing.value.low < near < crossing.value.high
    assert not crossing.above


class Known:
    """Designs whose error across is a known function of the f-number, by formula and by trials.

    error   arcsec, of an f-number
    factor  of the error by trials, and the ends of its interval
    """

    def __init__(self, monkeypatch, error, factor=(1.0, 0.9, 1.1)):
        self.error, self.factor, self.tried = error, factor, []
        module = sys.modules["startrack.optimise.solve_for"]  # a function has this name, too
        monkeypatch.setattr(module, "all_by_formula", self.by_formula)
        monkeypatch.setattr(module, "by_trials", self.by_trials)

    def by_formula(self, asked, *_):
        return [self.figures(*design, (1.0,)) for design in asked]

    def by_trials(self, case, campaign, runner, trials, fidelity, progress):
        self.tried.append(case.instrument.optics.f_number)
        progress(trials // 4)
        progress(trials // 4)
        return self.figures(case, campaign, self.factor)

    def figures(self, case, campaign, factors):
        error = self.error(case.instrument.optics.f_number) * startrack.arcsec
        [limit] = campaign.requirements.accuracy
        value, *ends = (1 - factor * error / limit.most for factor in factors)
        margin = Interval(value, *sorted(ends)) if ends else value
        return DesignFigures(error, error, 1.0, 9.0, {"across": margin}, {})


def test_two_values_and_none_are_said(path, monkeypatch):
    """error = (N - 3)^2 + 1: 2 at N = 2 and 4, never below 1."""
    Known(monkeypatch, lambda f_number: (f_number - 3) ** 2 + 1)
    key = f"{F_NUMBER}=1..6"
    found = startrack.solve_for(path, key, "across=2 arcsec", points=6, trials=0)
    assert [crossing.above for crossing in found.crossings] == [True, False]
    assert [crossing.value for crossing in found.crossings] == pytest.approx([2, 4], rel=1e-3)
    assert found.answer == f"across=2 arcsec: {F_NUMBER} must be from 2 to 4"
    none = startrack.solve_for(path, key, "across=0.9 arcsec", points=3, trials=0)
    assert none.crossings == ()
    assert "kept at no value of" in none.answer
    every = startrack.solve_for(path, key, "across=20 arcsec", points=3, trials=0)
    assert "kept at every value of" in every.answer
    twice = startrack.solve_for(path, f"{F_NUMBER}=2.5..6", "across=2 arcsec", points=3, trials=0)
    assert twice.answer == f"across=2 arcsec: {F_NUMBER} must be at most 4"


def test_trials_correct_the_formula(path, monkeypatch):
    """error = N^2 arcsec, 1.21 [1.1, 1.44] times as large by trials: N = sqrt(4 / factor)."""
    known = Known(monkeypatch, lambda f_number: f_number**2, (1.21, 1.1, 1.44))
    said = []
    found = startrack.solve_for(
        path, f"{F_NUMBER}=1..6", "across=4 arcsec", points=4, watch=said.append
    )
    assert said[:3] == ["2", "2, 250 done", "2, 500 done"]
    [crossing] = found.crossings
    assert crossing.formula == pytest.approx(2, rel=1e-3)
    assert crossing.value.value == pytest.approx(2 / 1.1, rel=1e-3)
    assert crossing.value.low == pytest.approx(2 / 1.2, rel=1e-3)
    assert crossing.value.high == pytest.approx(2 / math.sqrt(1.1), rel=1e-3)
    assert len(known.tried) == 2


def test_an_end_beyond_the_range_is_open(path, monkeypatch):
    Known(monkeypatch, lambda f_number: f_number**2, (1.0, 0.5, 1.1))
    found = startrack.solve_for(path, f"{F_NUMBER}=1.5..2.1", "across=4 arcsec", points=4)
    assert found.crossings[0].value.high == math.inf
    assert "open" in found.answer


def test_a_whole_number_is_the_last_that_keeps_the_limit(path):
    """Power grows with the number of bits: the largest number of bits for which 12 values meet
    the limit."""
    power = [load_design(path, [f"instrument.detector.bits={bits}"]) for bits in (12, 13)]
    most = [design.campaign.requirements.power(design.case) for design in power]
    limit = f"power={(most[0] + most[1]) / 2} W"
    found = startrack.solve_for(path, "instrument.detector.bits=8..16", limit, points=4)
    assert found.crossings[0].value == 12


def test_the_interval_of_a_whole_number_has_whole_ends():
    """Margin 3.2 - n, in trials from 1.1 lower to 0.9 higher: 3, from 2 to 4."""
    line = KeyLine(
        SweptKey.of("n", map(str, range(1, 7))),
        whole=True,
        expected=lambda number: 3.2 - round(number),
        tried=lambda number: Interval(*(3.2 - round(number) + by for by in (0, -1.1, 0.9))),
        known=[(float(number), 3.2 - number) for number in range(1, 7)],
    )
    [crossing] = line.crossings()
    assert crossing.value == Interval(3, 2, 4)


def test_a_limit_that_trials_meet_nowhere_is_said(path, monkeypatch):
    """Errors in trials are a hundred times those of the formula."""
    Known(monkeypatch, lambda f_number: f_number**2, (100.0, 90.0, 110.0))
    found = startrack.solve_for(path, f"{F_NUMBER}=1..6", "across=4 arcsec", points=4)
    assert found.answer.endswith("must be at most a value below 1, by trials (2 by formula)")


def test_a_key_without_effect_has_no_best_value(path):
    swept = startrack.sweep(path, "scene.date=2026-08-21,2026-08-22")
    assert "the error across is the same at all values" in swept.answer


@pytest.mark.parametrize(
    ("until", "margin", "changes"),
    [
        ("across=5 arcsec", "across", ["max_across=5 arcsec", "level=rms", "kind=per axis"]),
        ("about-99.73=1arcmin", "about", ["max_about=1arcmin", "level=99.73 %", "kind=radial"]),
        ("across (max rate)=5 arcsec", "across (max rate)", None),
        ("availability=0.99", "availability", ["min_availability=0.99"]),
        ("power", "power", []),
    ],
)
def test_limits_are_those_of_requirements(until, margin, changes):
    name, found = read_limit(until)
    assert name == margin
    if changes is not None:
        assert found == [f"campaign.requirements.{change}" for change in changes]


def test_limits_and_keys_that_are_none_are_refused(path):
    for until, words in (
        ("noise=3", "a limit must be of across, about"),
        ("across-0=3 arcsec", "objective must be"),
        ("mass=", "a limit must have a value"),
        ("both=3 arcsec", "a limit must be of"),
        ("nothing", "or a margin of the design"),
        ("across=3 kg", "the limit must have a unit that converts to rad"),
    ):
        with pytest.raises(Refused, match=words):
            startrack.solve_for(path, f"{F_NUMBER}=1.2..1.8", until, points=2)
    with pytest.raises(Refused, match="must have a range"):
        startrack.solve_for(path, "tracker.detection.centroid", "mass=1 kg")
    with pytest.raises(Refused, match="must have numbers"):
        startrack.solve_for(path, "tracker.detection.centroid=gravity,likelihood", "mass=1 kg")


def test_a_limit_on_a_whole_number_is_the_first_that_keeps_it():
    """The margins of single designs at that number and at the one below have opposite signs."""
    design, key = startrack.shipped("designs/noise_only.toml"), "tracker.detection.max_spots"
    solution = startrack.solve_for(design, f"{key}=8..40", "across=0.6arcsec", points=3, trials=0)
    [crossing] = solution.crossings
    first = int(crossing.value)
    assert crossing.value == first
    assert crossing.above
    swept = startrack.sweep(
        design, f"{key}={first - 1},{first}", changes=["campaign.requirements.max_across=0.6arcsec"]
    )
    before, after = (row.margin("across") for row in swept.rows)
    assert before < 0 <= after


def test_values_that_a_lens_family_refuses_are_left_out():
    """The mass at the solution is the limit; the range of ten times begins below that of the
    family."""
    design = startrack.shipped("designs/nanosatellite.toml")
    found = startrack.solve_for(design, F_NUMBER, "mass=0.22 kg", points=5)
    [crossing] = found.crossings
    own = load_design(design, [f"{F_NUMBER}={crossing.value}"])
    assert own.campaign.requirements.mass(own.case) == pytest.approx(0.22, rel=1e-4)
    assert min(found.margins) >= 1.2
    assert "values are refused (f_number must be at least 1.2" in found.answer


@pytest.fixture(scope="module")
def of_units(tmp_path_factory):
    """A design that is judged over units, with boresight errors of 60 arcsec about x."""
    own = load_design(startrack.shipped("designs/noise_only.toml"))
    case = dataclasses.replace(
        own.case, variation=(Variation("instrument.mounting.x", sigma="60 arcsec"),)
    )
    needs = Requirements(max_across=50 * startrack.arcsec, max_about=100 * startrack.arcsec)
    campaign = Campaign(
        requirements=needs, units=0.9, unit_count=4, trials=8, fidelity=Fidelity.COVARIANCE
    )
    file = tmp_path_factory.mktemp("units") / "units.toml"
    save_design(file, dataclasses.replace(own, case=case, campaign=campaign))
    return file


@pytest.mark.parametrize("trials", [0, 8])
def test_errors_and_margins_of_a_sweep_are_of_the_same_units(of_units, trials):
    """margin = 1 - error / limit, also if 90 % of the units must meet it."""
    swept = startrack.sweep(of_units, f"{F_NUMBER}=2.0,2.4", trials=trials)
    for row in swept.rows:
        for name, limit in (("across", 50), ("about", 100)):
            error = middle(row.figure(name)) / startrack.arcsec
            assert middle(row.margin(name)) == pytest.approx(1 - error / limit, rel=1e-9)
        assert middle(row.figure("across")) > 30 * startrack.arcsec
    assert "that 90 % of units at 0 yr do not exceed" in swept.how
