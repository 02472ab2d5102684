"""Files of parameters from anybody: each is read, or refused in one sentence."""

import os
from dataclasses import dataclass
from typing import Annotated

import pytest

from startrack.core import Unit
from startrack.io import from_table, read_table, to_table


@dataclass(frozen=True)
class Part:
    inside: Annotated[float | None, Unit("s", "ms")] = None
    outside: Annotated[float, Unit("s", "ms")] | None = None
    pairs: tuple[tuple[float, ...], ...] = ()
    times: tuple[Annotated[float, Unit("s", "ms")], ...] | None = None
    count: int = 1
    most: float = float("inf")


@pytest.mark.parametrize("field", ["inside", "outside"])
def test_a_unit_beside_none_is_read_written_and_checked(field):
    part = from_table(Part, {field: "5 ms", "times": ["1 ms", "2 s"], "pairs": [[1, 2], []]})
    assert getattr(part, field) == 5e-3
    assert part.times == (1e-3, 2.0)
    assert from_table(Part, to_table(part)) == part
    with pytest.raises(ValueError, match=f"{field} must have a unit, such as '1 ms', got 5"):
        from_table(Part, {field: 5})


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"inside": "1e999999999 s"}, "inside must be a finite number in s"),
        ({"inside": "1e-320 s"}, "inside must be 0 or of a size from 1e-30 to 1e"),
        ({"inside": "1" + " " * 10**6 + "s"}, "at most 100 characters, got 1000002"),
        ({"inside": "1 m**(1/0)"}, "inside must have a unit that converts to s"),
        ({"pairs": [[1e308]]}, r"pairs\[0\]\[0\] must be 0 or of a size"),
        ({"pairs": [10**400]}, r"pairs\[0\] must be a list, got a whole number of 401 digits"),
        ({"pairs": [[10**400]]}, "must be a number below 2"),
        ({"count": 10**50}, "count must be a number below 2"),
        ({"count": "x" * 10**6}, r"count must be a whole number, got 'x{70,80}\.\.\.$"),
        ({"x" * 10**6: 1}, r"^.{1,200}$"),
        ({"count": float("nan")}, "count must be a whole number"),
        ({"pairs": [[float("nan")]]}, "must be finite, got nan"),
    ],
)
def test_numbers_that_nothing_has_are_refused(table, words):
    with pytest.raises(ValueError, match=words):
        from_table(Part, table)


def test_a_field_without_limit_by_default_may_be_without_limit():
    assert from_table(Part, {"most": float("inf")}).most == float("inf")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"\0", "must be a TOML file"),
        (b"\xff", "must be a TOML file"),
        (b"a = " + b"[" * 50_000 + b"]" * 50_000, "without deeply nested values"),
        (b"a = " + b"{b=" * 50_000 + b"1" + b"}" * 50_000, "without deeply nested values"),
        (b"a" + b".a" * 100_000 + b" = 1", "keys of at most 32 parts"),
        (b"[" + b'"a" . ' * 1000 + b"a]", "keys of at most 32 parts"),
        (b"a = " + b"9" * 5000, "must be a TOML file: Exceeds the limit"),
        (b"#" * 2**21, "at most 1048576 bytes, got 2097152"),
    ],
)
def test_texts_that_are_no_table_are_refused(tmp_path, text, words):
    path = tmp_path / "any.toml"
    path.write_bytes(text)
    with pytest.raises(ValueError, match=words):
        read_table(path, "a design file")


def test_dots_that_separate_no_keys_are_read(tmp_path):
    path = tmp_path / "any.toml"
    path.write_text(f"a = {[0.5] * 100}  # {'.' * 100}\nb = '{'.' * 100}'\n")
    assert len(read_table(path, "a design file")["a"]) == 100


@pytest.mark.parametrize("kind", ["none", "folder", "device", "fifo"])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, kind):
    path = {"device": "/dev/zero", "folder": tmp_path}.get(kind, tmp_path / "any.toml")
    if kind == "fifo":
        os.mkfifo(path)
    words = "there is none" if kind == "none" else f"is a {kind}"
    with pytest.raises(ValueError, match=f"(?i){words}"):
        read_table(path, "a design file")
