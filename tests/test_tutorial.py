"""The tutorials are right as printed: files, commands, Python and all quoted output."""

from pathlib import Path

import pytest
from run_tutorial import PAGES, PICTURE, Told, alike, faults, pairs, rewritten, walk

REPORTS = {"tutorial": "trials/campaign.html", "tutorial-earth": "product/earth.html"}


@pytest.fixture(scope="module", params=PAGES, ids=lambda path: path.stem)
def walked(request, tmp_path_factory) -> tuple[Path, Path, list[Told]]:
    """The page, the folder in which it was run, and its quotations."""
    if request.param.stem == "tutorial-earth":
        pytest.importorskip("rasterio")
    folder = tmp_path_factory.mktemp("tutorial")
    return request.param, folder, walk(request.param.read_text(encoding="utf-8"), folder)


@pytest.mark.slow
def test_what_the_page_quotes_comes(walked):
    _, _, told = walked
    assert len(told) >= 6
    assert [fault for one in told for fault in faults(one)] == []


@pytest.mark.slow
def test_every_picture_is_made_on_the_way(walked):
    page, folder, _ = walked
    names = PICTURE.findall(page.read_text(encoding="utf-8"))
    assert names
    for name in names:
        assert (folder / name).read_bytes().startswith(b"\x89PNG"), name
        shown = (page.parent / "tutorial" / name).read_bytes()
        assert shown.startswith(b"\x89PNG"), name
        assert len(shown) < 200_000, name


@pytest.mark.slow
def test_the_walk_ends_with_a_report(walked):
    page, folder, _ = walked
    assert (folder / REPORTS[page.stem]).read_text().rstrip().endswith("</html>")


QUOTED = Told((0, 0), ["a 1.00", "...", "c 10"], ["a 1.01", "b 7", "c 10"], 0.0)


@pytest.mark.parametrize(
    ("quoted", "came", "fraction", "same"),
    [
        ("error 1.00 arcsec", "error  1.01 arcsec", 0.0, True),
        ("error 1.00 arcsec", "error 1.02 arcsec", 0.0, False),
        ("error 1.00 arcsec", "error 1.02 arcsec", 0.02, True),
        ("error -1.0", "error 1.0", 0.5, False),
        ("solved 3", "lost 3", 0.5, False),
        ("3 of 4", "3 of", 0.5, False),
    ],
)
def test_lines_are_alike(quoted, came, fraction, same):
    assert alike(quoted, came, fraction) is same


def test_lines_may_be_left_out_but_not_made_up():
    assert faults(QUOTED) == []
    assert faults(QUOTED._replace(came=["a 1.00", "b 7"])) == ["did not come: c 10"]
    assert len(faults(QUOTED._replace(quoted=["a 1.00"]))) == 1
    assert [came for _, came in pairs(QUOTED)] == ["a 1.01", "c 10"]


def test_a_page_is_written_anew():
    page = "before\na 1.00\n...\nc 10\nafter"
    span = (page.index("a 1"), page.index("after"))
    assert rewritten(page, [QUOTED._replace(span=span)]) == "before\na 1.01\n...\nc 10\nafter"


def test_a_wrong_exit_status_is_a_fault(tmp_path):
    with pytest.raises(AssertionError, match=r"none\.toml: exit status"):
        walk("```sh\nstartrack budget none.toml\n```", tmp_path)
