"""Figures of pages that whole commands measure: their words are on the pages, and are written."""

import re

import figures
import pytest

COMMANDS, FIGURES = figures.read(figures.TABLE)
WITHOUT_COMMIT = {"scenes", "where-time-goes"}  # pages whose figures are older than the commits


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.text[:30])
def test_each_figure_has_its_words_in_its_page_once(figure):
    text = (figures.ROOT / figure.page).read_text(encoding="utf-8")
    assert len(figure.pattern.findall(text)) == 1
    assert set(figures.PLACE.findall(figure.text)) == set(figure.places)
    assert figure.command in COMMANDS
    assert not figure.text.endswith("}"), "without words behind it, a place has no end"


@pytest.mark.parametrize(
    "page", sorted((figures.ROOT / "docs" / "figures").glob("*.md")), ids=lambda page: page.stem
)
def test_each_page_of_figures_names_scripts_that_are_there_and_its_commit(page):
    text = page.read_text(encoding="utf-8")
    scripts = re.findall(r"experiments/(\w+\.py)", text)
    assert scripts
    assert page.stem in WITHOUT_COMMIT or re.search(r"\b(?=\w*\d)[0-9a-f]{8}\b", text)
    assert all((figures.ROOT / "experiments" / name).is_file() for name in scripts)


def test_each_measure_in_the_readme_is_written_by_a_command_or_has_a_page():
    lines = [line for line in figures.unwritten() if line.startswith("README.md")]
    assert all("](" in line for line in lines), lines


def test_figures_that_differ_are_said_and_written_where_that_is_asked_for(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text("It takes 12 s (*abc*), by a factor of 1.92 [1.73, 2.06]. Not this 12 s.\n")
    places = {"time": ("s", ".0f"), "at": ("commit", "s"), "low": ("factor_95/0", ".2f")}
    one = figures.Figure(
        "page.md", "takes {time} s (*{at}*), by a factor of 1.92 [{low},", "", places
    )
    result = {"s": 14.4, "commit": "def", "factor_95": [1.731, 2.0]}
    before = page.read_text()
    assert figures.compared(one, result, page, write=False) == 2
    assert page.read_text() == before
    assert "page.md: time is 12, measured: 14" in capsys.readouterr().out
    figures.compared(one, result, page, write=True)
    assert page.read_text() == before.replace("12 s (*abc*)", "14 s (*def*)")
    assert figures.compared(one, result, page, write=True) == 0


def test_words_that_no_longer_stand_in_the_page_end_the_run(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("It is fast.\n")
    one = figures.Figure("page.md", "takes {time} s", "", {"time": ("s", ".0f")})
    with pytest.raises(
        SystemExit, match=r"page\.md must contain once: takes \{time\} s; it does 0 times"
    ):
        figures.compared(one, {"s": 1.0}, page, write=True)
