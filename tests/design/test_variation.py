"""Draws of units: their laws, their streams, and the values that they leave unchanged."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from startrack.core import YEAR
from startrack.design import Case, Moment, Scope, Variation, load_design, unit_case
from startrack.design.variation import differences
from startrack.io import shipped

CASE = load_design(shipped("designs/noise_only.toml")).case
FOCAL, READ = "instrument.optics.focal_length", "instrument.detector.read_noise"
MANY = 2000


def varied(*variations: Variation, **changes) -> Case:
    return replace(CASE, variation=variations, **changes)


def drawn(case: Case, moment=Moment, which=0):
    return np.array([differences(case, 6, moment(unit))[which][1] for unit in range(MANY)])


@pytest.mark.parametrize(
    ("variation", "law"),
    [
        (Variation(READ, sigma="2 electron", mean="1 electron"), stats.norm(1, 2)),
        (Variation(READ, "uniform", low=-0.1, high=0.3, vary="relative"), stats.uniform(-0.1, 0.4)),
        (
            Variation(READ, "truncated", sigma=0.1, low=-0.05, high=0.2, vary="relative"),
            stats.truncnorm(-0.5, 2, 0, 0.1),
        ),
        (Variation(READ, "lognormal", sigma=0.5, vary="relative"), stats.lognorm(0.5, loc=-1)),
        (Variation(READ, "sinusoid", amplitude="3 electron"), stats.arcsine(-3, 6)),
        (
            Variation(READ, "table", values=("0 electron", "1 electron", "4 electron")),
            stats.rv_histogram((np.array([0.5, 0.5 / 3]), np.array([0, 1, 4])), density=True),
        ),
    ],
    ids=["normal", "uniform", "truncated", "lognormal", "sinusoid", "table"],
)
def test_differences_follow_their_law(variation, law):
    """The test of Kolmogorov and Smirnov with 2000 draws of a fixed seed."""
    found = drawn(varied(variation))
    assert stats.kstest(found, law.cdf).pvalue > 0.01


def test_a_draw_depends_on_nothing_but_seed_unit_and_name():
    one = Variation(FOCAL, sigma=1e-3, vary="relative")
    other = Variation(READ, sigma=0.1, vary="relative")
    alone, behind = varied(one), varied(other, one)
    assert (drawn(alone) == drawn(behind, which=1)).all()
    seen = unit_case(behind, 6, Moment(7))
    assert seen.instrument.optics.focal_length == pytest.approx(
        CASE.instrument.optics.focal_length * (1 + drawn(alone)[7]), rel=1e-12
    )
    assert seen.as_designed.instrument == CASE.instrument


def test_a_group_shares_its_draw_by_its_correlation():
    one = Variation(FOCAL, sigma=1e-3, vary="relative", group="lens", correlation=0.6)
    other = Variation(READ, sigma=0.1, vary="relative", group="lens")
    case = varied(one, other)
    correlation = np.corrcoef(drawn(case), drawn(case, which=1))[0, 1]
    assert correlation == pytest.approx(0.6, abs=4 * 0.64 / math.sqrt(MANY))


def test_scopes_apply_where_they_should():
    each = {
        scope: Variation(name, sigma=0.01, vary="relative", per=scope)
        for scope, name in zip(
            Scope,
            [
                FOCAL,
                READ,
                "instrument.optics.blur",
                "instrument.detector.exposure",
                "instrument.detector.dark_current",
            ],
            strict=True,
        )
    }
    case = varied(*each.values())

    def scopes(moment):
        return [one.per for one, _ in differences(case, 1, moment)]

    assert scopes(Moment(0, launched=False)) == [Scope.UNIT]
    assert scopes(Moment(0)) == [Scope.UNIT, Scope.LAUNCH]
    assert scopes(Moment(0, 3, 5, YEAR)) == list(Scope)
    first, second = (differences(case, 1, Moment(0, 0, 0, years * YEAR)) for years in (1, 3))
    by = {one.per: (a, b) for (one, a), (_, b) in zip(first, second, strict=True)}
    assert by[Scope.LIFE][1] == pytest.approx(3 * by[Scope.LIFE][0])
    assert by[Scope.UNIT][1] == by[Scope.UNIT][0]
    other = differences(case, 1, Moment(0, 1, 0, YEAR))
    assert [a == b for (_, a), (_, b) in zip(first, other, strict=True)] == [
        one.per not in (Scope.ENVIRONMENT, Scope.FRAME) for one, _ in first
    ]


def test_a_unit_without_number_is_as_designed():
    assert unit_case(varied(Variation(READ, sigma="1 electron")), 1, Moment(-1)) == CASE


@pytest.mark.parametrize(
    ("variation", "message"),
    [
        ({"name": "tracker.attitude.gate", "sigma": 1.0}, "only true values vary"),
        ({"name": READ, "sigma": 1.0}, "must have a unit"),
        ({"name": READ, "sigma": "1 mm"}, "converts to electron"),
        ({"name": "instrument.optics.nothing", "sigma": 1.0}, "nothing is none"),
        ({"name": "instrument.optics.psf", "sigma": 1.0}, "must be a number or a curve"),
        (
            {"name": READ, "law": "uniform", "vary": "relative", "low": 1.0, "high": 0.0},
            "low must be below",
        ),
        ({"name": READ, "law": "lognormal", "sigma": 1.0}, "relative"),
        ({"name": READ, "law": "table", "values": (1.0,)}, "two or more"),
        ({"name": READ, "law": "odd"}, "law must be one of"),
    ],
)
def test_what_cannot_be_drawn_is_refused(variation, message):
    with pytest.raises(ValueError, match=message):
        varied(Variation(**variation))


def test_the_same_number_and_scope_is_refused_twice():
    one = Variation(READ, sigma="1 electron")
    with pytest.raises(ValueError, match="once per unit"):
        varied(one, replace(one, sigma="2 electron"))


def test_a_unit_that_a_parameter_refuses_is_named():
    case = varied(Variation(READ, sigma="100 electron"))
    with pytest.raises(ValueError, match=r"unit \d+ of seed 5: .*read_noise"):
        [unit_case(case, 5, Moment(unit)) for unit in range(20)]


def test_variations_are_read_from_a_design_file(tmp_path):
    path = tmp_path / "varied.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\nlifetime = "5 yr"\n[[variation]]\n'
        f'name = "{READ}"\nsigma = "1 electron"\nper = "life"\n'
    )
    case = load_design(path).case
    assert case.lifetime == 5 * YEAR
    assert case.variation == (Variation(READ, sigma="1 electron", per=Scope.LIFE),)


def test_variations_of_a_design_and_of_its_class_count_together(tmp_path):
    """A variation of a design replaces that of its class with the same name and scope."""
    path, name = tmp_path / "varied.toml", "instrument.optics.focal_length"
    path.write_text(
        'base = "designs/noise_only.toml"\ninclude = ["variations/space-lens.toml"]\n'
        f'[[variation]]\nname = "{READ}"\nsigma = "1 electron"\n'
        f'[[variation]]\nname = "{name}"\nper = "unit"\nvary = "relative"\nsigma = 0.5\n'
    )
    found = load_design(path).case.variation
    assert READ in {one.name for one in found}
    assert len(found) > 3
    assert [one.sigma for one in found if (one.name, one.per) == (name, Scope.UNIT)] == [0.5]


def test_a_design_lies_over_its_class_and_its_orbit(tmp_path):
    """Both parts count: differences between units, and stars that the tracker does not know."""
    path = tmp_path / "flown.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\n'
        'include = ["variations/space-lens.toml", "variations/low-orbit.toml"]\n'
    )
    case = load_design(path).case
    assert case.differs
    assert not CASE.differs
    assert case.end_of_life == pytest.approx(5 * YEAR)
    assert case.instrument.motion.drawn
    assert case.believed_catalog.limit_g < case.catalog.limit_g


def test_a_hash_does_not_travel_with_a_case():
    """The hash of a text differs between processes."""
    case = replace(CASE)
    kept = {case: "kept"}
    vars(case)["_hash"] += 1  # as of another process
    assert kept.get(case) is None
    assert kept[copy.copy(case)] == "kept"
