"""The site is built without a warning, its front page runs, and the menu has every page."""

import re
from html import unescape

import pytest

pytest.importorskip("furo", reason="extra `docs`")

import build_api
from build_site import FRONT, ROOT, build
from sphinx.builders.html import StandaloneHTMLBuilder


@pytest.fixture(scope="session")  # Sphinx warns where it builds twice in a process
def site(tmp_path_factory):
    """A warning of Sphinx, such as a broken link, is an error.

    One page replaces the docstrings, which `test_build_api` builds.
    """
    folder = tmp_path_factory.mktemp("site")

    def one_page(pages):
        pages.mkdir()
        (pages / "startrack.html").write_text("docstrings", encoding="utf-8")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_api, "build", one_page)
        patch.setattr(StandaloneHTMLBuilder, "search", False)  # stems the words of all pages
        menu = StandaloneHTMLBuilder._get_local_toctree  # the same of all pages, but for a mark
        patch.setattr(
            StandaloneHTMLBuilder,
            "_get_local_toctree",
            lambda self, page, *given, **named: (
                menu(self, page, *given, **named) if page == FRONT else ""
            ),
        )
        build(folder)
    return folder


def test_every_document_is_a_page_of_the_menu(site):
    front = (site / f"{FRONT}.html").read_text(encoding="utf-8")
    asked = {f"{path.stem}.html" for path in (ROOT / "docs").glob("*.md")} - {"index.html"}
    assert asked <= set(re.findall(r'href="([\w-]+\.html)"', front))


def test_pages_keep_their_pictures_files_and_docstrings(site):
    assert (site / "api" / "startrack.html").exists()
    assert (site / "_images" / "frame.png").exists()
    assert list((site / "_downloads").rglob("nanosatellite.toml"))
    assert "docs/index.html" in (site / "index.html").read_text(encoding="utf-8")


def test_the_code_of_the_front_page_runs(site, capsys):
    page = (ROOT / f"{FRONT}.md").read_text(encoding="utf-8")
    code = page.split("```python\n")[1].split("```")[0]
    shown = unescape(re.sub(r"<[^>]+>", "", (site / f"{FRONT}.html").read_text(encoding="utf-8")))
    assert code.strip() in shown
    exec(code, {})
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 3
    assert all("stars matched" in line for line in said)
