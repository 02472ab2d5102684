"""The documents enter; a site of HTML with search leaves.

    python docs/build_site.py [FOLDER]      (extra `docs`; default: docs/site, which git ignores)

Sphinx with MyST reads the pages as they stand in the repository: README, docs, and the pages and
files of the catalogues that they link to. The docstrings are pdoc's (`build_api`).
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import warnings
from functools import partial
from pathlib import Path

import build_api
from sphinx.application import Sphinx

import startrack

ROOT = Path(__file__).parents[1]
FOLDER = Path(__file__).parent / "site"
FRONT = "docs/index"
# The order of a newcomer; other pages follow by their names.
FIRST = {
    "Tutorials": ["README", "docs/tutorial", "docs/tutorial-earth", "docs/gallery"],
    "How-to": [
        "docs/choose-a-detector",
        "docs/choose-what-to-minimise",
        "docs/datasheet-to-verdict",
        "docs/how-sure",
        "docs/calibrate-night-frames",
        "docs/optimise-an-earth-camera",
        "docs/own-air",
        "docs/search-moving-objects",
        "docs/units",
        "docs/mission",
        "docs/onboard",
        "docs/extensions",
        "docs/clusters",
        "docs/caches",
    ],
    "Reference": [
        "docs/commands",
        "docs/design-file",
        "docs/reference",
        "docs/mission-keys",
        "docs/scene-keys",
        "docs/profile-keys",
        "docs/search-keys",
        "docs/api",
        "docs/json",
        "docs/conventions",
        "docs/glossary",
    ],
    "Explanation": ["docs/models", "docs/departures", "docs/layout"],
}
LINK = re.compile(r"\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")
REDIRECT = (
    '<!doctype html><meta charset="utf-8"><title>startrack</title>'
    f'<meta http-equiv="refresh" content="0; url={FRONT}.html">'
    f'<a href="{FRONT}.html">startrack</a>\n'
)


def sources(folder: Path) -> list[str]:
    """Copy all pages, and the files that they link to, into a folder; the names of the pages."""
    pages = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
    pages += sorted((ROOT / "docs").rglob("*.md")) + sorted((ROOT / "catalogs").rglob("*.md"))
    for page in pages:
        _copy(folder, page, LINK.sub(partial(_linked, folder, page), page.read_text("utf-8")))
    return [page.relative_to(ROOT).with_suffix("").as_posix() for page in pages]


def _linked(folder: Path, page: Path, link: re.Match[str]) -> str:
    """A link as it stands, after its file is copied; the text alone of a folder without a page."""
    text, target, place = link[1], link[2], link[3] or ""
    file = (page.parent / target).resolve()
    if "://" in target or file.suffix == ".md":
        return link[0]
    if file.is_dir():
        if not (file / "README.md").exists():
            return text
        return f"[{text}]({target}/README.md{place})"
    _copy(folder, file)
    return link[0]


def _copy(folder: Path, file: Path, text: str | None = None) -> None:
    """A file, or its changed text, at its place of the repository.

    Raises  FileNotFoundError for a link to a file that is not there.
    """
    copy = folder / file.relative_to(ROOT)
    copy.parent.mkdir(parents=True, exist_ok=True)
    if text is None:
        shutil.copyfile(file, copy)
    else:
        copy.write_text(text, encoding="utf-8")


def contents(pages: list[str]) -> str:
    """The tables of contents of the front page, which make the menu."""
    known = {name for names in FIRST.values() for name in names} | {FRONT}
    rest = [page for page in pages if page not in known and page.startswith("docs/")]
    other = [page for page in pages if page not in known and not page.startswith("docs/")]
    figures = [page for page in rest if page.startswith("docs/figures/")]
    groups = FIRST | {
        "Measured figures": sorted(figures),
        "More": sorted(set(rest) - set(figures)),
        "Catalogues and changes": sorted(other),
    }
    blocks = []
    for title, names in groups.items():
        there = "\n".join(f"/{name}" for name in names if name in pages)
        blocks.append(
            f"```{{toctree}}\n:hidden:\n:maxdepth: 1\n:caption: {title}\n\n{there}\n```\n"
        )
    return "\n" + "\n".join(blocks)


def build(folder: Path) -> None:
    """Write the site.

    Raises  ValueError where a page has a fault, such as a link to what is not there.
    """
    with tempfile.TemporaryDirectory() as work:
        source, extra = Path(work) / "source", Path(work) / "extra"
        pages = sources(source)
        with (source / f"{FRONT}.md").open("a", encoding="utf-8") as front:
            front.write(contents(pages))
        with (source / "docs/api.md").open("a", encoding="utf-8") as names:
            names.write(
                '\nTheir docstrings: <a href="../api/startrack.html">pages of the API</a>.\n'
            )
        extra.mkdir()
        build_api.build(extra / "api")
        (extra / "index.html").write_text(REDIRECT, encoding="utf-8")
        settings = {
            "project": "startrack",
            "release": startrack.__version__,
            "extensions": ["myst_parser"],
            "root_doc": FRONT,
            "myst_heading_anchors": 4,
            "smartquotes": False,
            "html_theme": "furo",
            "html_title": "startrack",
            "html_extra_path": [str(extra)],
            "html_show_sphinx": False,
            "html_copy_source": False,
        }
        with warnings.catch_warnings():
            # Between Sphinx and its extensions; of no concern to the pages.
            for category in (DeprecationWarning, PendingDeprecationWarning):
                warnings.simplefilter("ignore", category)
            app = Sphinx(
                str(source),
                None,
                str(folder),
                str(Path(work) / "doctrees"),
                "html",
                settings,
                status=None,
                warning=sys.stderr,
                freshenv=True,
            )
            app.build()
        if app.statuscode or app._warncount:
            raise ValueError(f"the pages must be without warnings, got {app._warncount}")


if __name__ == "__main__":
    build_api.run(__doc__ or "", FOLDER, build)
