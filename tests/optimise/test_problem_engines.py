"""Every engine takes a user's problem: the photometer of the gallery, with known answers."""

from pathlib import Path

import numpy as np
import pytest

from startrack.core import Refused
from startrack.optimise import (
    OBJECTIVE,
    VERIFYING,
    Ledger,
    ProblemGoals,
    ProblemSource,
    improve,
    problem_front,
    sample,
    sensitivities,
)
from startrack.problem import Margin, compare_problems, ratios_answer
from startrack.report import write_problem_report
from startrack.verification import Answer, Looks, problem_verdict_table, verify_problem

SCRIPT = Path(__file__).parents[2] / "docs" / "gallery" / "problem_of_a_photometer.py"


@pytest.fixture(scope="module")
def photometer():
    """The class of the script, without the search at its end."""
    names = dict[str, object]()
    exec(SCRIPT.read_text(encoding="utf-8").partition("found = improve")[0], names)
    return names["Photometer"]


def test_the_script_ends_with_its_search():
    assert "found = improve(Photometer(), seed=1)" in SCRIPT.read_text(encoding="utf-8")


def test_limits_are_judged_at_looks_until_decided(photometer):
    problem, asked = photometer(), []
    source = ProblemSource(problem, 1)

    def rows(count):
        asked.append(count)
        return source.rows(problem, count, VERIFYING)

    verified = verify_problem(problem, rows, Looks(first=64, most=256))
    assert verified.answer is Answer.PASS
    assert [row.name for row in verified.verdicts] == ["mass", "exposure", "full well"]
    assert max(asked) == 64
    assert problem_verdict_table(verified).json()[0]["unit"] == "kg"
    heavy = photometer(aperture=0.15)
    failed = verify_problem(heavy, lambda n: ProblemSource(heavy, 1).rows(heavy, n), Looks(64, 64))
    answers = {row.name: row.answer for row in failed.verdicts}
    assert answers == {"mass": Answer.FAIL, "exposure": Answer.PASS, "full well": Answer.PASS}


def test_sensitivities_are_those_of_the_formula(photometer):
    """If photon noise dominates, the error goes as 1 / (aperture sqrt(exposure)).

    Read noise adds 225 electrons^2 to 1.3 times the star's 156: the slope of ln error over ln
    aperture is -2 (1 - 0.5 203 / (203 + 225)).
    """
    studied = sensitivities(ProblemSource(photometer()), 32)
    star = photometer().star
    slope = -2 * (1 - 0.5 * 1.3 * star / (1.3 * star + 225))
    assert [row.name for row in studied] == ["aperture", "exposure"]
    assert studied[0].slope == pytest.approx(slope, rel=0.02)
    assert studied[1].slope == pytest.approx(slope / 2, rel=0.02)
    assert studied[1].total.value > studied[0].total.value > 0.1


@pytest.mark.slow
def test_the_tolerance_region_keeps_the_objective(photometer):
    problem = photometer(aperture=0.1, exposure=3.0)
    tolerance = sample(ProblemSource(problem, 2))
    assert tolerance.chains.converged
    errors = [
        problem.replaced(tolerance.source.values(point)).expect().value
        for point in tolerance.samples[:: len(tolerance.samples) // 200]
    ]
    within = np.mean(np.array(errors) <= tolerance.limit)
    assert within > 0.9
    assert tolerance.limit == pytest.approx(1.2 * problem.expect().value, rel=0.1)


def test_a_front_trades_the_error_for_mass(photometer):
    source = ProblemSource(photometer(), 1)
    with pytest.raises(Refused, match="a goal must be one of objective, mass, exposure, full well"):
        ProblemGoals(photometer(), OBJECTIVE, "power")
    points = problem_front(source, ProblemGoals(photometer(), OBJECTIVE, "mass"), 4)
    expected = np.array([point.expected for point in points])
    assert len(points) >= 3
    assert (np.diff(expected[:, 0]) > 0).all()
    assert (np.diff(expected[:, 1]) < 0).all()
    assert all(np.allclose(point.measured, point.expected, rtol=0.2) for point in points)
    # At any aperture the longest exposure is best; at the least, any has the same mass.
    assert all(point.values["exposure"] > 3 for point in points[:-1])


def test_two_problems_are_compared_on_the_same_trials(photometer):
    first, second = photometer(), photometer(exposure=2.0)
    rows = [problem.trials(1, range(400)) for problem in (first, second)]
    (found,) = compare_problems((first, second), (rows[0], rows[1]))
    truth = second.expect().value / first.expect().value
    assert found.ratio.low < truth < found.ratio.high
    assert found.ratio.high / found.ratio.low < 1.4
    better = ratios_answer(("a", "b"), {"error": found.ratio})
    assert better.endswith(f"; {'a' if truth > 1 else 'b'} is better (error)")
    (same,) = compare_problems((first, first), (rows[0], rows[0]))
    assert same.ratio.low == same.ratio.value == same.ratio.high == 1


@pytest.mark.slow
def test_an_interrupted_search_continues_from_its_ledger(photometer, tmp_path, monkeypatch):
    whole = improve(photometer(), seed=3)
    calls, cls = [], photometer
    plain = cls.trials

    def trials(self, seed, numbers):
        calls.append(len(numbers))
        if len(calls) == 12:
            raise KeyboardInterrupt
        return plain(self, seed, numbers)

    monkeypatch.setattr(cls, "trials", trials)
    with Ledger(tmp_path / "ledger.sqlite") as ledger, pytest.raises(KeyboardInterrupt):
        improve(photometer(), seed=3, ledger=ledger)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        again = improve(photometer(), seed=3, ledger=ledger)
    done = len(calls)
    with Ledger(tmp_path / "ledger.sqlite") as ledger:
        third = improve(photometer(), seed=3, ledger=ledger)
    assert len(calls) == done, "all trials are kept"
    assert whole.best == again.best == third.best
    assert whole.judged == again.judged == third.judged


def test_the_page_has_question_results_and_what_is_not_counted(photometer):
    problem = photometer()
    studied = sensitivities(ProblemSource(problem), 8)
    html = write_problem_report(problem, problem.trials(1, range(200)), studied, "A photometer")
    for words in ("relative error of the flux", "full well", "Sensitivity", "Not counted"):
        assert words in html
    assert html.count("<svg") == 2


def test_margins_from_below_fail_from_below():
    assert Margin(1.0, 2.0, False).relative < 0 < Margin(3.0, 2.0, False).relative
