"""An aperture instead of an f-number in a design file: read, overridden, varied, unknown."""

import jsonschema
import pytest

from startrack import Refused, load_design, mm
from startrack.design import DesignSpace, design_schema, replaced, replaced_all, save_design
from startrack.optimise import sweep

# Of the shipped design below: 50 mm at f/1.8.
APERTURE, F_NUMBER = "instrument.optics.aperture", "instrument.optics.f_number"
LENGTH = "instrument.optics.focal_length"


@pytest.fixture
def written(tmp_path):
    def write(text, name="design", base="designs/noise_only.toml"):
        path = tmp_path / f"{name}.toml"
        path.write_text(f'base = "{base}"\n[instrument.optics]\n{text}')
        return path

    return write


def optics_of(path, *changes, **more):
    return load_design(path, changes, **more).case.instrument.optics


def test_an_aperture_stands_over_the_f_number_of_files_below_and_the_reverse(written):
    below = written('focal_length = "50 mm"\naperture = "25 mm"', "below")
    assert optics_of(below).f_number == pytest.approx(2.0)
    assert optics_of(below).aperture == pytest.approx(25 * mm)
    assert optics_of(below, f"{LENGTH}=100 mm").f_number == pytest.approx(4.0)
    assert optics_of(below, f"{APERTURE}=2 cm").f_number == pytest.approx(2.5)
    assert optics_of(below, f"{F_NUMBER}=3.0").aperture == pytest.approx(50 * mm / 3)
    above = written("f_number = 1.5", "above", "below.toml")
    assert optics_of(above).f_number == 1.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('aperture = "25 mm"\nf_number = 2.0', "instrument.optics.aperture must be left out"),
        ("aperture = 25", "instrument.optics.aperture must be a length, such as '25 mm', got 25"),
        ('aperture = "25 s"', "instrument.optics.aperture must be a length, such as '25 mm'"),
        ('aperture = "0 mm"', "instrument.optics.aperture must be positive"),
        ('aperture = "1 um"', "f_number must lie in"),
    ],
)
def test_what_is_wrong_is_said(written, text, words):
    with pytest.raises(Refused) as error:
        load_design(written(text))
    assert words in str(error.value)


def test_a_campaign_keeps_the_aperture_where_it_varies_the_focal_length(written):
    campaign = (
        '[[campaign.variables]]\nname = "instrument.optics.focal_length"\nlow = "30 mm"\n'
        'high = "90 mm"\n'
    )
    design = load_design(written(f'aperture = "25 mm"\n{campaign}'))
    asked = design.campaign
    space = DesignSpace(design.case, asked.variables, asked.links)
    for place, length in ((0.0, 30 * mm), (1.0, 90 * mm)):
        optics = space.design([place]).instrument.optics
        assert optics.focal_length == pytest.approx(length)
        assert optics.aperture == pytest.approx(25 * mm)
    plain = load_design(written(f"f_number = 2.0\n{campaign}", "plain"))
    assert not plain.campaign.links, "an f-number stays, as before"


def test_the_aperture_is_a_variable(written):
    text = f'[[campaign.variables]]\nname = "{APERTURE}"\nlow = "20 mm"\nhigh = "30 mm"\n'
    design = load_design(written(f'aperture = "25 mm"\n{text}'))
    space = DesignSpace(design.case, design.campaign.variables)
    assert space.start == pytest.approx([0.5])
    assert space.design([0.2]).instrument.optics.aperture == pytest.approx(22 * mm)
    both = {APERTURE: 30 * mm, F_NUMBER: 2.0}
    with pytest.raises(Refused, match="aperture must not be changed together with f_number"):
        replaced_all(design.case, both)
    with pytest.raises(Refused, match=f"{APERTURE}: aperture must be positive"):
        replaced(design.case, APERTURE, 0.0)


def test_an_aperture_that_is_not_known_keeps_its_law(written, tmp_path):
    path = written('aperture = { low = "20 mm", high = "30 mm" }')
    assert optics_of(path).aperture == pytest.approx(25 * mm)
    assert optics_of(path, quantile=lambda name: 0.9).aperture == pytest.approx(29 * mm)
    copy = tmp_path / "copy.toml"
    save_design(copy, load_design(path))
    assert load_design(copy) == load_design(path)
    assert optics_of(copy, quantile=lambda name: 0.9).aperture == pytest.approx(29 * mm)


def test_an_f_number_that_a_campaign_varies_takes_the_place_of_an_unknown_aperture(written):
    text = f'[[campaign.variables]]\nname = "{F_NUMBER}"\nlow = 1.0\nhigh = 4.0\n'
    design = load_design(written(f'aperture = {{ low = "20 mm", high = "30 mm" }}\n{text}'))
    assert [unknown.name for unknown in design.unknowns] == [APERTURE]
    assert not design.open_unknowns


def test_draws_of_a_campaign_have_apertures(written):
    text = "[campaign]\nvariables = []\nunknown_draws = 4\n"
    text += '[campaign.requirements]\nmax_across = "9 arcsec"\n'
    path = written(f'aperture = {{ low = "20 mm", high = "30 mm" }}\n{text}')
    design = load_design(path)
    found = [
        condition.of(design.case).instrument.optics.aperture
        for condition in design.asked.conditions
    ]
    assert sorted(int((one / mm - 20) / 2.5) for one in found) == [0, 1, 2, 3]


def test_a_sweep_of_apertures_is_one_of_f_numbers(written):
    path = written('focal_length = "50 mm"\naperture = "25 mm"')
    apertures = sweep(path, f"{APERTURE}=20 mm,40 mm").rows
    f_numbers = sweep(path, f"{F_NUMBER}=2.5,1.25").rows
    for one, other in zip(apertures, f_numbers, strict=True):
        assert one.figure("across") == pytest.approx(other.figure("across"))


def test_the_schema_asks_for_one_of_both():
    check = jsonschema.Draft7Validator(
        design_schema()["then"]["properties"]["instrument"]["properties"]["optics"]
    )
    assert check.is_valid({"focal_length": "1 m", "aperture": "1 cm"})
    assert check.is_valid({"focal_length": "1 m", "f_number": 2.0})
    assert not check.is_valid({"focal_length": "1 m"})
    assert not check.is_valid({"focal_length": "1 m", "f_number": 2.0, "aperture": "1 cm"})
