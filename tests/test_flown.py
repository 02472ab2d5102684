"""The page on flown cameras agrees with its figures, and these with the committed files."""

import json

import pytest

from tests.conftest import ROOT

FLOWN = ROOT / "experiments" / "flown"
FROZEN = json.loads((FLOWN / "predictions.json").read_text(encoding="utf-8"))["figures"]


@pytest.fixture(scope="module")
def flown():
    """The experiment."""
    return pytest.importorskip("flown")


def test_the_page_is_of_its_figures(flown):
    page = (ROOT / "docs" / "figures" / "flown.md").read_text(encoding="utf-8")
    assert page == flown.page()


def test_intervals_are_in_order():
    for row in FROZEN.values():
        ends = [row[f"{side}_{level}"] for side, level in (("low", 95), ("low", 90), ("low", 68))]
        ends += [row["median"]]
        ends += [row[f"high_{level}"] for level in (68, 90, 95)]
        assert ends == sorted(ends)


def test_as_many_intervals_hold_as_the_page_says(flown):
    scores = flown.scores()
    assert scores["figures"] == 76
    assert scores["held_90"] >= 0.8
    assert scores["tim_background_ratio_second"] == pytest.approx(1, abs=0.2)


def test_each_value_of_a_design_has_its_source():
    for path in FLOWN.glob("*.toml"):
        text = path.read_text(encoding="utf-8")
        for line in text.splitlines():
            if " = " in line and not line.startswith(("#", "source", "value", "psf", "saturation")):
                assert "#" in line or line.startswith(("columns", "rows", "wavelength")), (
                    path,
                    line,
                )


def test_the_model_gives_the_frozen_figures_again(flown):
    """A few draws agree with the frozen intervals."""
    made = flown.tim(flown.draws("tim", 1, flown.SEED)[0])
    assert all(
        FROZEN[name]["low_95"] * 0.3 < made[name] < FROZEN[name]["high_95"] * 3 + 0.1
        for name in ("T6", "T9", "T7 21:10")
    )
