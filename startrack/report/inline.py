"""A matplotlib figure -> SVG to put into a page."""

from __future__ import annotations

import io
import re
from html import escape

import matplotlib
from matplotlib.figure import Figure

BLUE, RED, GREEN, GREY = "#3567a8", "#c0392b", "#2e7d5b", "#777777"


def inline(figure: Figure, name: str, alternative: str) -> str:
    """SVG whose identifiers are its own, though many of its like stand on one page.

    name         letters that no other figure of the page has
    alternative  what a reader who does not see it must know
    """
    text = io.StringIO()
    # Letters stay text, which a reader can search and a screen reader can read.
    with matplotlib.rc_context({"svg.fonttype": "none", "font.size": 9, "svg.hashsalt": name}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", svg)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(alternative)}"', 1)
