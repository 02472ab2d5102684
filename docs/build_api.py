"""The package enters; a page of HTML for each public module leaves.

    python docs/build_api.py [FOLDER]      (extra `docs`; default: docs/api, which git ignores)

Pages have the docstrings, and what the declarations of parameters say. A docstring here is aligned
text: paragraphs, indented equations, columns of names and what they are. pdoc takes Markdown, and
`markdown` makes that of it.
"""

from __future__ import annotations

import argparse
import inspect
import os
import re
import warnings
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from pkgutil import ModuleInfo
from statistics import mode
from textwrap import dedent
from typing import Any, get_type_hints

import pdoc
import pygments
from jinja2 import pass_context
from jinja2.runtime import Context
from list_api import public
from markupsafe import Markup
from pdoc import extract, render
from pdoc.render_helpers import lexer, linkify, signature_formatter

import startrack
from startrack.core import fields_of

FOLDER = Path(__file__).parent / "api"
GAP = re.compile(r"(?<=\S) {2,}(?=\S)")
# How pdoc writes the types of arrays, and what the house calls them.
ARRAYS = {
    f"numpy.ndarray[tuple[typing.Any, ...], numpy.dtype[numpy.{kind}]]": name
    for kind, name in (("float64", "Floats"), ("int64", "Ints"))
}


def markdown(docstring: str) -> str:
    """A docstring of the house as Markdown."""
    return "\n\n".join(_block(block) for block in re.split(r"\n{2,}", docstring.strip("\n")))


def _block(block: str) -> str:
    lines = block.splitlines()
    if all(line.startswith("    ") for line in lines):
        return _as_it_stands(dedent(block))
    rows = _rows(lines)
    if rows is None:
        return _escaped(" ".join(line.strip() for line in lines))
    if any("   " in text for _, text in rows):  # a third column
        return _as_it_stands(block)
    return "\n".join(f"- **{_escaped(name)}** {_escaped(text)}" for name, text in rows)


def _as_it_stands(text: str) -> str:
    return f"```\n{text}\n```"


def _rows(lines: list[str]) -> list[tuple[str, str]] | None:
    """Names in a column with what is said of each beside them, None where there are none."""
    ends = [gap.end() for line in lines if line[0] != " " and (gap := GAP.search(line))]
    if not ends:
        return None
    column = mode(ends)
    rows = list[tuple[str, str]]()
    for line in lines:
        gap = GAP.search(line)
        if line.startswith("  ") and rows:
            rows[-1] = rows[-1][0], f"{rows[-1][1]} {line.strip()}".strip()
        elif len(line) <= column or line[column - 1] == " ":
            rows.append((line[:column].strip(), line[column:]))
        elif gap:
            rows.append((line[: gap.start()], line[gap.end() :]))
        else:
            return None
    return rows


def _escaped(text: str) -> str:
    """Stars, brackets and the like mean themselves, but for what stands in back quotes."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(
        part if part.startswith("`") else re.sub(r"([*_<>\\\[\]#])", r"\\\1", part)
        for part in parts
    )


def build(folder: Path) -> None:
    """Write the pages of all public modules.

    Raises  UserWarning from pdoc where a type or a page cannot be made, if warnings are errors.
    """
    _tell_declared_meanings()
    _tell_types()
    children = extract.iter_modules2
    modules = sorted(module.__name__ for module, _ in public())
    # Rooms are no names of the package itself, in whose `__all__` pdoc looks for them.
    extract.iter_modules2 = lambda module: {
        name.rpartition(".")[2]: ModuleInfo(None, name, ispkg=True)  # type: ignore[arg-type]
        for name in modules
        if name.rpartition(".")[0] == module.__name__
    }
    try:
        render.configure(docformat="markdown", footer_text=f"startrack {startrack.__version__}")
        render.env.filters["to_markdown"] = markdown
        render.env.filters["linkify"] = _linked
        pdoc.pdoc("startrack", output_directory=folder)
    finally:
        extract.iter_modules2 = children


def _tell_types() -> None:
    """Resolve types whose names are in another module than the one in which pdoc looks for them.

    A NamedTuple is made in a module without them; a dataclass has fields of its bases.
    """
    for _, names in public():
        for thing in (one.thing for one in names if inspect.isclass(one.thing)):
            if issubclass(thing, tuple):
                thing.__new__.__annotations__ = get_type_hints(thing)
            elif is_dataclass(thing):
                own = thing.__init__.__annotations__
                hints = get_type_hints(thing)
                own.update({name: hints[name] for name in own if name in hints})


def _tell_declared_meanings() -> None:
    """Print the meanings of the fields of parameters, which stand in their declarations."""
    for _, names in public():
        for thing in (name.thing for name in names if is_dataclass(name.thing)):
            kind: Any = thing
            meanings = {name: field.meaning for name, field in fields_of(kind).items()}
            rows = "".join(f"\n{name}  {text}" for name, text in meanings.items() if text)
            thing.__doc__ = inspect.cleandoc(thing.__doc__ or "") + ("\n" + rows) * bool(rows)


@pass_context
def _linked(context: Context, code: str, namespace: str = "", shorten: bool = True) -> str:
    """Code with links, as pdoc makes it, and with short names of arrays."""
    for long, short in ARRAYS.items():
        highlighted = pygments.highlight(long, lexer, signature_formatter).strip()
        code = Markup(str(code).replace(highlighted, short).replace(long, short))
    return linkify(context, code, namespace, shorten)


def run(description: str, usual: Path, build: Callable[[Path], None]) -> None:
    """Build into the folder that the command line names."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, default=usual, metavar="FOLDER")
    folder = parser.parse_args().folder
    warnings.simplefilter("error")
    build(folder)
    print(f"wrote {os.path.relpath(folder)}/index.html")


if __name__ == "__main__":
    run(__doc__ or "", FOLDER, build)
