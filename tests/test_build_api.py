"""The pages of the API are built without a warning, and docstrings are rendered as intended."""

import re
from html import unescape

import pytest

pytest.importorskip("pdoc", reason="extra `docs`")

from build_api import build, markdown
from list_api import public


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Warnings are errors here as in all tests."""
    folder = tmp_path_factory.mktemp("api")
    build(folder)
    return folder


@pytest.mark.slow
def test_each_public_module_has_a_page_and_no_other(pages):
    built = {path.relative_to(pages).with_suffix("") for path in pages.rglob("*.html")}
    asked = {module.__name__.replace(".", "/") for module, _ in public()}
    assert {path.as_posix() for path in built} - {"index"} == asked


@pytest.mark.slow
def test_each_public_name_stands_on_its_page(pages):
    for module, names in public():
        page = (pages / f"{module.__name__.replace('.', '/')}.html").read_text(encoding="utf-8")
        missing = [one.name for one in names if f'<section id="{one.name}">' not in page]
        assert not missing, module.__name__


@pytest.mark.slow
def test_an_equation_stands_as_it_was_written(pages):
    page = (pages / "startrack" / "optics.html").read_text(encoding="utf-8")
    shown = unescape(re.sub(r"<[^>]+>", "", page))
    assert "\nPsf = sum_k weight_k diffraction(wavelength_k) * blur * seeing * diffusion" in shown
    assert "<strong>fill_factor</strong> 1, area of the active square in the middle" in page


DOCSTRING = """\
What a star's light makes of *three* pixels [1].

    E(r) = a_1 * b_2,
        where a < b

Source: somebody (2011).

radius          (n,) metre, from the axis,
                or nothing
a_very_long_one 1
f, g            `a * b`
Errors          numerical: 1e-3.  ValueError where it is none.
"""
MARKDOWN = """\
What a star's light makes of \\*three\\* pixels \\[1\\].

```
E(r) = a_1 * b_2,
    where a < b
```

Source: somebody (2011).

- **radius** (n,) metre, from the axis, or nothing
- **a\\_very\\_long\\_one** 1
- **f, g** `a * b`
- **Errors** numerical: 1e-3.  ValueError where it is none."""


def test_a_docstring_as_markdown():
    assert markdown(DOCSTRING) == MARKDOWN


def test_a_third_column_stands_as_it_was_written():
    table = "scene   what arrives     -> Light\noptics  how it blurs     -> Psf"
    assert markdown(table) == f"```\n{table}\n```"
