"""One self-contained HTML page from sections and figures."""

import base64
import io
import re
from collections.abc import Iterable, Sequence
from html import escape
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import matplotlib
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from startrack.metrics import Table
from startrack.plots import SETTINGS, plain_numbers


def inline(figure: Figure, name: str, alternative: str) -> str:
    """SVG with identifiers that are unique on the page.

    name         letters that no other figure of the page has
    alternative  text for readers who cannot see the figure
    """
    text = io.StringIO()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            plain_numbers(axis)
    # Letters stay text, for search and screen readers.
    with matplotlib.rc_context({**SETTINGS, "svg.fonttype": "none", "svg.hashsalt": name}):
        # As figure.savefig, but drawn once.
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", svg)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(alternative)}"', 1)


STYLE = """
:root { color-scheme: light dark; --ink: #1c2530; --paper: #fff; --soft: #eef2f6; --line: #c9d3de;
  --link: #1f5fa8 }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e9ef; --paper: #14181d; --soft: #1f262e;
  --line: #3a4652; --link: #8ab8f0 } }
* { box-sizing: border-box }
body { margin: 0 auto; max-width: 62rem; padding: 0 1rem 3rem; color: var(--ink);
  background: var(--paper); font: 1rem/1.5 system-ui, sans-serif }
h1 { font-size: 1.6rem; line-height: 1.2; overflow-wrap: anywhere }
h2 { font-size: 1.25rem; margin: 2.2rem 0 .5rem; border-bottom: 1px solid var(--line) }
h3 { font-size: 1.05rem; margin: 1.4rem 0 .3rem }
a { color: var(--link) }
a:focus-visible, summary:focus-visible, .scroll:focus-visible { outline: 3px solid var(--link);
  outline-offset: 2px }
.skip { position: absolute; left: -99rem } .skip:focus { position: static }
nav ol { padding-left: 1.4rem; columns: 2 15rem }
figure { margin: 1rem 0 } figcaption { font-size: .9rem }
figure svg, figure img { display: block; width: 100%; height: auto; background: #fff;
  border-radius: 4px }
.panels { display: grid; gap: .6rem;
  grid-template-columns: repeat(auto-fit, minmax(min(22rem, 100%), 1fr)) }
figure img { max-width: 42rem }
.scroll { overflow-x: auto; margin: .6rem 0 }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
caption { text-align: left; font-size: .9rem; padding-bottom: .3rem }
th, td { padding: .25rem .8rem .25rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line) }
td.number, th.number { text-align: right }
pre { background: var(--soft); padding: .8rem; overflow-x: auto; font-size: .85rem }
summary { cursor: pointer; padding: .3rem 0 }
@media (max-width: 40rem) {
  .wide, .wide caption, .wide tbody, .wide td { display: block; width: 100% }
  .wide thead { display: none }
  .wide tr { display: grid; grid-template-columns: 1fr 1fr; column-gap: 1.2rem; padding: .3rem 0;
    border-bottom: 2px solid var(--line) }
  .wide td, .wide td.number { display: flex; justify-content: space-between; gap: .6rem;
    text-align: right; border: 0; padding: .05rem 0 }
  .wide td::before { content: attr(data-of); text-align: left; opacity: .75 }
  .wide td:first-child, .wide td.long { grid-column: 1 / -1 }
  .wide td:first-child { justify-content: start; text-align: left; font-weight: 600 }
  .wide td:empty { display: none } }
@media print { nav, .skip { display: none } }
"""
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


class PagePicture(NamedTuple):
    """A figure, and alternative text for readers who cannot see it."""

    figure: Figure
    alternative: str


NARROW = 3  # columns of a table that a narrow screen shows unchanged
# Letters of a cell and of its column's name; a longer cell takes a narrow screen's width.
LONG = 19
# inch, size of a figure in `panels`: letters of 9 points are legible at 400 pixel
WIDE, HIGH = 4.6, 3.7


class Section(NamedTuple):
    """A titled part of the page; the body is HTML."""

    title: str
    body: str


def page(title: str, lead: str, sections: Sequence[Section]) -> str:
    """The whole page.

    title  plain text
    lead   plain text, one paragraph
    """
    titles = (section.title.lower() for section in sections)
    names = ["".join(c if c.isalnum() else "-" for c in title) for title in titles]
    contents = "".join(
        f'<li><a href="#{name}">{escape(section.title)}</a></li>'
        for name, section in zip(names, sections, strict=True)
    )
    bodies = "".join(
        f'<section aria-labelledby="{name}"><h2 id="{name}" tabindex="-1">'
        f"{escape(section.title)}</h2>\n{section.body}</section>\n"
        for name, section in zip(names, sections, strict=True)
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f'<a class="skip" href="#{names[0]}">Skip to the results</a>\n'
        f"<header><h1>{escape(title)}</h1>{paragraph(lead)}</header>\n"
        f'<nav aria-label="Contents"><ol>{contents}</ol></nav>\n<main>\n{bodies}</main>\n'
        "</body>\n</html>\n"
    )


def paragraph(text: str) -> str:
    """Plain text as a paragraph."""
    return f"<p>{escape(text)}</p>"


def table(caption: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Plain text in cells; numbers are right-aligned. Wide tables scroll, also by keyboard.

    On a narrow screen a table with more than `NARROW` columns shows each row as a block: the first
    cell is the title, then names and values follow in two columns.
    """
    cells = [list(row) for row in rows]
    right = {i for row in cells[:1] for i, text in enumerate(row) if _numeric(text)}
    body = "".join(f"<tr>{_row('td', row, right, head)}</tr>" for row in cells)
    wide = ' class="wide"' if len(head) > NARROW else ""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
        f"<table{wide}>"
        f"<caption>{escape(caption)}</caption><thead><tr>{_row('th', head, right)}</tr></thead>"
        f"<tbody>{body}</tbody></table></div>\n"
    )


def records(caption: str, shown: Table) -> str:
    """A table of results in the form of `table`."""
    return table(caption, shown.head, shown.cells)


def panels(pictures: Sequence[PagePicture], name: str, caption: str) -> str:
    """Figures side by side, one below the other on a narrow screen, with one caption (plain text).

    Figures are drawn at the width of a phone, so that letters are legible there.

    name  letters that no other figure of the page has
    """
    drawn = "".join(
        f"<div>{inline(picture.figure, f'{name}{n}', picture.alternative)}</div>"
        for n, picture in enumerate(pictures)
    )
    return (
        f'<figure><div class="panels">{drawn}</div><figcaption>{escape(caption)}</figcaption>'
        "</figure>\n"
    )


def embedded(caption: str, file: Path, alternative: str = "") -> str:
    """A picture file embedded in the page, with its caption (plain text).

    alternative  text for readers who cannot see the picture; empty: the caption
    """
    data = base64.b64encode(file.read_bytes()).decode()
    kind = {".png": "png", ".jpg": "jpeg"}[file.suffix]
    alt = escape(alternative or caption)
    return (
        '<figure><div class="scroll" tabindex="0" role="region" aria-label="Picture">'
        f'<img alt="{alt}" src="data:image/{kind};base64,{data}">'
        f"</div><figcaption>{escape(caption)}</figcaption></figure>\n"
    )


def code(title: str, text: str) -> str:
    """Preformatted plain text, collapsed under its title."""
    return (
        f"<details><summary>{escape(title)}</summary>"
        f'<pre class="scroll" tabindex="0">{escape(text)}</pre></details>\n'
    )


def _row(kind: str, texts: Sequence[str], right: set[int], head: Sequence[str] = ()) -> str:
    """Cells of a row or of the head; cells of a row name their column, for narrow screens."""
    scope, cells = ' scope="col"' if kind == "th" else "", []
    for i, (text, name) in enumerate(zip_longest(texts, head[: len(texts)])):
        long = len(text) + len(name or "") > LONG
        kinds = " ".join(["number"] * (i in right) + ["long"] * long)
        look = f' class="{kinds}"' if kinds else ""
        named = "" if name is None else f' data-of="{escape(name)}"'
        cells.append(f"<{kind}{scope}{look}{named}>{escape(text)}</{kind}>")
    return "".join(cells)


def _numeric(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
