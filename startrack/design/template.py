"""Detector product -> a design file to begin with, each value with its meaning beside it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator
from textwrap import wrap
from typing import Any

from startrack.design.keys import Key, design_keys, toml
from startrack.design.products import of_product
from startrack.io import shipped

EXAMPLE = "designs/nanosatellite.toml"
WIDEST = 100  # letters of a line
# Of a detector product a design keeps what is its own choice.
OWN = ("exposure",)
AGEING = "instrument.detector.dark_current"


def template(product: str = "", optional: bool = False) -> str:
    """The text of a design file that `load_design` reads.

    The values are those of the example in the catalogue, a tracker for a nanosatellite.

    product   detector of the catalogue; "": the example's, without a name
    optional  whether keys that may be left out stand there, too, with their defaults, as comments
    Raises    ValueError for a product that the catalogue does not have.
    """
    table = tomllib.loads(shipped(EXAMPLE).read_text(encoding="utf-8"))
    if product:
        detector = of_product(product)
        own = {name: table["instrument"]["detector"][name] for name in OWN}
        table["instrument"]["detector"] = {"product": product} | own
        table["tracker"]["detection"]["saturation"] = float(2 ** detector["bits"] - 1)
        # The example's detector ages by a law of its own; another one by that of the class.
        del table["tracker"]["detection"]["dark_map_age"]
        table["variation"] = [one for one in table["variation"] if one["name"] != AGEING]
    keys = {key.name: key for key in design_keys()}
    head = "# A star tracker; the values are those of an example. All keys: startrack keys"
    return "\n".join([head, *_tables(table, "", keys, optional)]) + "\n"


def _tables(table: Any, place: str, keys: dict[str, Key], optional: bool) -> Iterator[str]:
    """The lines of a table and of those within it."""
    lines = {name: one for name, one in table.items() if not _is_table(one)}
    beside = _left_out(place, set(table), keys) if optional else []
    if place and (lines or beside):
        yield from ("", *_about(keys[place].meaning), f"[{place}]")
    for name, value in lines.items():
        yield from _line(name, toml(value), keys[f"{place}.{name}" if place else name])
    for key in beside:
        yield from _line(f"# {key.name.rpartition('.')[2]}", key.default, key)
    for name, one in table.items():
        where = f"{place}.{name}" if place else name
        if isinstance(one, dict):
            yield from _tables(one, where, keys, optional)
        elif _is_table(one):
            yield from _rows(one, where, keys)


def _rows(rows: Iterable[dict[str, Any]], place: str, keys: dict[str, Key]) -> Iterator[str]:
    """Tables of a list; only the first says what its keys mean."""
    for number, row in enumerate(rows):
        yield from ("", *(_about(keys[place].meaning) if number == 0 else ()), f"[[{place}]]")
        for name, value in row.items():
            if number == 0:
                yield from _line(name, toml(value), keys[f"{place}.{name}"])
            else:
                yield f"{name} = {toml(value)}"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict))


def _left_out(place: str, there: set[str], keys: dict[str, Key]) -> list[Key]:
    return [
        key
        for key in keys.values()
        if key.name.rpartition(".")[0] == place
        and key.kind not in ("table", "tables")
        and key.name.rpartition(".")[2] not in there
        and key.default not in ("required", "none", "")
    ]


def _about(meaning: str) -> list[str]:
    return [f"# {line}" for line in wrap(meaning, WIDEST - 2)]


def _line(name: str, value: str, key: Key) -> Iterator[str]:
    """A value, and its meaning beside it or, where that is long, above it."""
    text, words = f"{name} = {value}", key.meaning + (f" ({key.range})" if key.range else "")
    if max(len(text), 34) + len(words) + 4 <= WIDEST:
        yield f"{text:34s}  # {words}"
    else:
        yield from _about(words)
        yield text
