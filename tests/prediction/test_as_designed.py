"""Errors of the unit as designed over unknown values, against its budget for each value."""

import pytest

from startrack import load_design
from startrack.budget import analytic
from startrack.design import stratified
from startrack.prediction import draw_as_designed

NAME = "instrument.optics.f_number"


def test_each_draw_is_the_budget_of_its_value(tmp_path):
    path = tmp_path / "design.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\n[instrument.optics]\n'
        "f_number = { low = 1.6, high = 2.4 }\n"
        '[campaign.requirements]\nmax_across = "0.45 arcsec"\n'
    )
    found = draw_as_designed(path, 3, 3)
    middle = analytic(load_design(path, [f"{NAME}=2.0"]).case).sum
    assert found.middle.errors == pytest.approx(middle)
    met = 0
    for part, draw in zip(stratified(3, NAME, 3), found.draws, strict=True):
        expected = analytic(load_design(path, [f"{NAME}={1.6 + 0.8 * part}"]).case)
        assert draw.errors == pytest.approx(expected.sum)
        met += expected.whole.across <= 0.45 / 206264.8
    assert 0 < met < 3
    assert found.count_met()["across"] == met
    assert found.lost == 0
    assert found.factors[:, 0] == pytest.approx([d.errors[0] / middle[0] for d in found.draws])


def test_a_draw_that_sees_no_stars_has_no_error(tmp_path):
    path = tmp_path / "design.toml"
    path.write_text(
        'base = "designs/noise_only.toml"\n[instrument.detector]\n'
        'exposure = { among = ["100 ms", "1 us"] }\n'
    )
    found = draw_as_designed(path, 1, 2)
    assert found.lost == 1
    assert found.all_met == sum(all(d.met.values()) for d in found.draws if d.met)
