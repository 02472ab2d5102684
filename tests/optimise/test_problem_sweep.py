"""Keys of a problem over their values: a problem whose margins and trials have closed forms."""

import numpy as np
import pytest

from startrack.core import Refused
from startrack.metrics import Interval
from startrack.optimise import ProblemSource, solve_problem_for, sweep_problem
from startrack.problem import Expectation, Judgement, Margin, Settings, Words

TRUE = 1.2  # error by trials over that by formula


class Sight:
    """An error of 6 / aperture by formula, 1.2 times as large by trials, at most 3; a mass of
    aperture^2, at most 9."""

    columns = np.dtype([("error", float)])
    settings = Settings()
    variables = ()

    def __init__(self, aperture):
        self.aperture = aperture

    @property
    def error(self):
        return 6 / self.aperture

    def costs(self):
        return {"mass": Margin(self.aperture**2, 9.0, unit="kg")}

    def expect(self):
        margins, parts = {"sharp": Margin(self.error, 3.0)}, {"half": self.error / 2}
        left_out = ("flare of a wide aperture",) if self.aperture > 2 else ()
        return Expectation(self.error, margins, parts, left_out)

    def trials(self, seed, numbers):
        rows = np.empty(len(numbers), self.columns)
        for row, number in zip(rows, numbers, strict=True):
            draw = np.random.default_rng([seed, number]).normal(1, 0.1)
            row["error"] = TRUE * self.error * draw
        return rows

    def judge(self, rows, confidence=0.95):
        mean, half = rows["error"].mean(), 2 * rows["error"].std() / len(rows) ** 0.5
        ends = [Margin(value, 3.0) for value in (mean, mean + half, mean - half)]
        half_of = Interval(mean / 2, (mean - half) / 2, (mean + half) / 2)
        value = Interval(mean, mean - half, mean + half)
        return Judgement(value, {"sharp": tuple(ends)}, {"half": half_of})

    def described(self):
        return f"{self.aperture!r}"

    def text(self):
        return Words("error", "px", {"half": ("half of it", "px")})


def load(changes):
    [change] = changes
    name, _, value = change.partition("=")
    if name != "aperture" or not float(value) > 0:
        raise Refused(f"aperture must be positive, got {change}")
    return Sight(float(value))


def source():
    return ProblemSource(Sight(2.0), 1)


def test_a_sweep_has_the_values_of_the_formula_and_says_what_is_refused():
    swept = sweep_problem(load, ["aperture=1..4"], source(), points=4)
    assert [row.value for row in swept.rows] == [6, 3, 2, 1.5]
    assert [row.margins["sharp"] for row in swept.rows] == pytest.approx([-1, 0, 1 / 3, 1 / 2])
    assert swept.answer == (
        "2 of 4 values meet the requirements (the others miss sharp, mass); of these error is "
        "least at aperture 3, 2 px"
    )
    assert swept.left_out == ("flare of a wide aperture",)
    [*_, refused] = sweep_problem(load, ["aperture=1,0"], source()).rows
    assert refused.note == "aperture must be positive, got aperture=0"
    with pytest.raises(Refused, match="aperture must be positive, got width=1"):
        sweep_problem(load, ["width=1"], source())


def test_trials_of_a_sweep_have_intervals():
    swept = sweep_problem(load, ["aperture=2,3"], source(), trials=400)
    assert swept.left_out == ("flare of a wide aperture",)
    for row, error in zip(swept.rows, (3.0, 2.0), strict=True):
        assert row.value.low < TRUE * error < row.value.high
        assert row.margins["sharp"].low < 1 - TRUE * error / 3 < row.margins["sharp"].high
    assert swept.columns.json()[0]["part: half"] == swept.rows[0].value.value / 2


def test_a_limit_is_just_kept_where_trials_say_so():
    """6 / a = 3 at a = 2 by formula; by trials it is 1.2 times as large, which gives a = 2.4."""
    by_formula = solve_problem_for(load, "aperture=1..4", "sharp", source(), 7, trials=0)
    [crossing] = by_formula.crossings
    assert crossing.value == pytest.approx(2, rel=1e-3)
    assert crossing.above
    tried = []
    found = solve_problem_for(load, "aperture=1..4", "sharp", source(), 7, watch=tried.append)
    [crossing] = found.crossings
    assert tried[0] == "2"
    assert float(tried[-1]) == pytest.approx(2 * TRUE, rel=0.01)
    assert crossing.value.low < 2 * TRUE < crossing.value.high
    assert crossing.value.value == pytest.approx(2 * TRUE, rel=0.01)
    [crossing] = solve_problem_for(load, "aperture=1..4", "mass", source(), 7).crossings
    assert crossing.value == pytest.approx(3, rel=1e-3)
    assert not crossing.above
    assert not crossing.tried


def test_a_margin_that_there_is_not_is_named():
    with pytest.raises(Refused, match=r"the name of a margin \(mass, sharp\), got 'blur'"):
        solve_problem_for(load, "aperture=1..4", "blur", source(), 3)
