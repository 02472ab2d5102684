"""Laws of unknown values in a design file."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import lognorm, uniform

from startrack import Refused, arcsec, load_design
from startrack.design import Unknown, replaced, save_design
from startrack.optimise import expected_objective

NAME = "instrument.optics.f_number"


@pytest.fixture
def written(tmp_path):
    def write(text, name="design"):
        path = tmp_path / f"{name}.toml"
        path.write_text(f'base = "designs/noise_only.toml"\n{text}')
        return path

    return write


@pytest.mark.parametrize("quantile", [0.025, 0.16, 0.5, 0.84, 0.975])
def test_values_have_the_quantiles_of_their_laws(quantile):
    between = Unknown(NAME, {"low": 1.2, "high": 2.0})
    assert between.at(quantile) == pytest.approx(uniform(1.2, 0.8).ppf(quantile))
    factor = Unknown(NAME, {"median": "100 ms", "factor": 1.5})
    number, unit = factor.at(quantile).split()
    assert float(number) == pytest.approx(lognorm(math.log(1.5), scale=100).ppf(quantile))
    assert unit == "ms"


def test_a_choice_has_its_values_by_their_weights():
    law = Unknown("x", {"among": ["a", "b", "c"], "weight": [1, 2, 1]})
    drawn = [law.at(float(u)) for u in (np.arange(400) + 0.5) / 400]
    assert [drawn.count(value) for value in "abc"] == [100, 200, 100]
    assert law.at(None) == "b", "the middle of a choice is its likeliest value"


def test_a_design_has_the_middle_of_what_is_not_known_and_its_laws(written):
    path = written(
        "[instrument.optics]\nf_number = { low = 1.2, high = 2.0 }\n"
        '[instrument.detector]\nexposure = { median = "100 ms", factor = 1.5 }\n'
    )
    design = load_design(path)
    assert [unknown.name for unknown in design.unknowns] == [NAME, "instrument.detector.exposure"]
    assert design.case.instrument.optics.f_number == pytest.approx(1.6)
    assert design.case.instrument.detector.exposure == pytest.approx(0.1)
    drawn = load_design(path, quantile={NAME: 0.25}.get).case
    assert drawn.instrument.optics.f_number == pytest.approx(1.4)
    assert drawn.instrument.detector.exposure == pytest.approx(0.1)
    told = load_design(path, [f"{NAME}=1.3"])
    assert [unknown.name for unknown in told.unknowns] == ["instrument.detector.exposure"]


def test_one_of_several_files_is_included(written, tmp_path):
    for name, prnu in (("part-fine", 0.001), ("part-coarse", 0.02)):
        (tmp_path / f"{name}.toml").write_text(f"[instrument.detector]\nprnu = {prnu}\n")
    path = written(
        'include = [{ among = ["part-fine.toml", "part-coarse.toml"], weight = [3, 1] }]\n'
    )
    (unknown,) = load_design(path).unknowns
    assert unknown.name == "include part"
    fine, coarse = (
        load_design(path, quantile=lambda name, u=u: u).case.instrument.detector.prnu
        for u in (0.74, 0.76)
    )
    assert (fine, coarse) == (0.001, 0.02), "weights of the files, and their values"


def test_a_products_law_is_drawn_before_its_values_are_read(written):
    text = '[instrument.detector]\nproduct = { among = ["cmv4000", "mt9p031"] }\n'
    pitches = [
        load_design(
            written(text), quantile=lambda name, u=u: u
        ).case.instrument.detector.pixel_pitch
        for u in (0.2, 0.8)
    ]
    assert pitches == pytest.approx([5.5e-6, 2.2e-6])


def test_a_law_replaces_a_law_below_it(written, tmp_path):
    below = written("[instrument.optics]\nf_number = { low = 1.2, high = 2.0 }\n", "below")
    above = tmp_path / "above.toml"
    above.write_text(
        f'base = "{below.name}"\n[instrument.optics]\nf_number = {{ median = 1.4, factor = 1.1 }}\n'
    )
    (unknown,) = load_design(above).unknowns
    assert unknown.law == {"median": 1.4, "factor": 1.1}


def test_a_saved_design_keeps_its_laws(written, tmp_path):
    design = load_design(written("[instrument.optics]\nf_number = { low = 1.2, high = 2 }\n"))
    save_design(tmp_path / "again.toml", design)
    again = load_design(tmp_path / "again.toml")
    assert again == design


def test_a_told_figure_is_one_sigma_of_its_level(written):
    """15 arcsec that 99.73 % of normal errors do not exceed are 5 arcsec rms."""
    given = '[[told]]\nfigure = "accuracy"\nvalue = "15 arcsec"\nlevel = "99.73 %"\n'
    (told,) = load_design(written(f'{given}axis = "across"\n')).told
    assert told.rms / arcsec == pytest.approx(5.0, rel=1e-3)
    with pytest.raises(Refused, match=r"told\[0\].axis must be one of across, about"):
        load_design(written(f'{given}axis = "x"\n'))


@pytest.mark.parametrize(
    ("law", "says"),
    [
        ('{ low = "1 mm", high = 2 }', "high must have the unit of low, 'mm', got ''"),
        ("{ low = 2, high = 1 }", "low must be below high, got 2 and 1"),
        ("{ low = true, high = 1 }", "low must be a number, or a number with a unit"),
        ("{ median = -1, factor = 2 }", "median must be positive, got -1"),
        ("{ median = 1, factor = 1 }", r"factor must lie in \(1, 1000\], got 1"),
        ("{ among = [1] }", "among must be a list of 2 to 100 values"),
        ("{ among = [1, 2], weight = [1] }", "weight must be a list of 2 positive numbers"),
        ("{ among = [1, 2], weight = [1, -1] }", "weight must be a list of 2 positive numbers"),
        ("{ low = 1 }", "f_number must be a number"),
        ("{ low = -2, high = 1 }", "f_number must"),
    ],
)
def test_what_is_no_law_is_refused_with_its_place(written, law, says):
    with pytest.raises(Refused, match=rf"design.toml: {NAME}.*{says.removeprefix('f_number ')}"):
        load_design(written(f"[instrument.optics]\nf_number = {law}\n"))


@pytest.mark.parametrize("entry", ["3", "{ among = [1, 2] }", '{ low = "a", high = "b" }'])
def test_an_include_that_names_no_file_is_refused(written, entry):
    with pytest.raises(Refused, match="include must be a list of file names"):
        load_design(written(f"include = [{entry}]\n"))


def test_a_search_keeps_the_laws_of_what_it_does_not_choose(written):
    """The example with noise only varies its f-number, not its background."""
    path = written(
        "[instrument.optics]\nf_number = { low = 1.8, high = 2.2 }\n"
        "[scene]\nbackground_g = { low = 21, high = 22 }\n"
    )
    design = load_design(path)
    (kept,) = design.open_unknowns
    assert kept.name == "scene.background_g"


BACKGROUND = "[scene]\nbackground_g = { low = 19, high = 22 }\n"


def test_draws_of_what_is_not_known_are_conditions_of_a_campaign(written):
    """Each draw lies in its third of the law; the error is the geometric mean with the design's."""
    design = load_design(written(BACKGROUND), ["campaign.unknown_draws=3"])
    campaign = design.asked
    drawn = [condition for condition in campaign.conditions if condition.name.startswith("draw")]
    values = sorted(condition.change[0].value for condition in drawn)
    assert [19 + k <= value < 20 + k for k, value in enumerate(values)] == [True] * 3
    assert not design.undrawn
    errors = [
        expected_objective(
            replaced(design.case, "scene.background_g", value),
            dataclasses.replace(design.campaign, conditions=(), unknown_draws=0),
        )
        for value in [design.case.scene.background_g, *values]
    ]
    together = expected_objective(design.case, dataclasses.replace(campaign, conditions=drawn))
    assert together == pytest.approx(np.prod(errors) ** (1 / 4), rel=1e-9)
    assert errors[1] > errors[2] > errors[3]  # a brighter sky is worse


def test_draws_need_something_that_is_not_known(written):
    with pytest.raises(Refused, match=r"campaign.unknown_draws must be 0 if no value"):
        load_design(written(""), ["campaign.unknown_draws=2"]).asked  # noqa: B018
