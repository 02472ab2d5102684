"""Files of parameters from anybody: each is read, or refused in one sentence."""

import os
from dataclasses import dataclass
from typing import Annotated

import pytest

from startrack.core import Unit
from startrack.design import Case
from startrack.io import from_table, read_table, to_table
from startrack.io.layers import DEEPEST, LayerRules, read_layers


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
        ("# UTF-16".encode("utf-16"), "must be a TOML file in UTF-8"),
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


@pytest.fixture
def written(tmp_path):
    """Files of a folder, by name; the path of the last."""

    def write(**files: str):
        for name, text in files.items():
            path = tmp_path / f"{name}.toml"
            path.write_text(text)
        return path

    return write


def table(path, *changes):
    return read_layers(path, "a file", changes).table


def test_a_file_lies_over_its_includes_and_these_over_the_base(written):
    path = written(
        ground="a = 1\nb = 1\nc = 1\nd = 1\n[t]\nx = 1\ny = [1, 2, 3]",
        one="b = 2\nc = 2\nd = 2\n[t]\ny = [4]",
        two="c = 3\nd = 3",
        top='base = "ground.toml"\ninclude = ["one.toml", "two.toml"]\nd = 4\n[t]\nz = 5',
    )
    assert table(path) == {"a": 1, "b": 2, "c": 3, "d": 4, "t": {"x": 1, "y": [4], "z": 5}}


def test_lists_of_tables_that_are_joined(tmp_path, written):
    path = written(
        ground="[[v]]\nname = 'a'\nx = 1\n[[v]]\nname = 'b'\nx = 2",
        one="v = []\nw = [1]",
        two="w = [2]\n[[v]]\nname = 'b'\nx = 3",
        top='base = "ground.toml"\ninclude = ["one.toml", "two.toml"]\n[[v]]\nname = "c"',
    )
    found = read_layers(path, "a file", rules=LayerRules({"v": {"name": None}})).table
    assert found["v"] == [{"name": "a", "x": 1}, {"name": "b", "x": 3}, {"name": "c"}]
    assert found["w"] == [2]
    cleared = read_layers(path, "a file", ("v=[]",), LayerRules({"v": {"name": None}})).table
    assert cleared["v"] == []


def test_names_are_those_beside_the_file_that_names_them_or_of_the_catalogue(tmp_path, written):
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "middle.toml").write_text('base = "ground.toml"\nb = 2')
    (tmp_path / "inner" / "ground.toml").write_text("a = 1")
    assert table(written(top='base = "inner/middle.toml"')) == {"a": 1, "b": 2}
    shipped = table(written(top='base = "designs/noise_only.toml"\n[scene]\nbackground_g = 20'))
    assert shipped["scene"]["background_g"] == 20
    assert "instrument" in shipped


@pytest.mark.parametrize(
    ("change", "value"),
    [
        ("t.x=2", 2),
        ("t.x = [1.5, 2]", [1.5, 2]),
        ("t.x=3 um", "3 um"),
        ('t.x="3 um"', "3 um"),
        ("t.x=true", True),
        ("t.x={ y = 1 }", {"y": 1}),
        ("t.x=1\nother = 2", "1\nother = 2"),
    ],
)
def test_a_change_lies_over_all(written, change, value):
    assert table(written(top="a = 1\n[t]\nx = 1\nz = 2"), change) == {
        "a": 1,
        "t": {"x": value, "z": 2},
    }


def test_a_change_without_a_value_takes_a_key_out(written):
    assert table(written(top="a = 1\n[t]\nx = 1\nz = 2"), "t.x =") == {"a": 1, "t": {"z": 2}}
    assert table(written(top="a = 1\n[t]\nx = 1\nz = 2"), "t=") == {"a": 1}
    with pytest.raises(ValueError, match=r"--set t\.y= must name a key that the files have"):
        table(written(top="[t]\nx = 1"), "t.y=")


def test_all_unknown_keys_are_named_at_once():
    with pytest.raises(ValueError, match=r"f_numbr is unknown.*; tracker\.wondow is unknown"):
        from_table(Case, {"instrument": {"optics": {"f_numbr": 2}}, "tracker": {"wondow": 3}})


def test_lists_of_known_keys_do_not_cut_off_other_unknown_ones():
    """A command prints 600 letters of a message; the known keys of a detector alone have more."""
    table = {"instrument": {"optics": {"foo": 1}, "detector": {"qux": 1}}, "scene": {"baz": 1}}
    with pytest.raises(
        ValueError, match=r"foo is unknown; .*qux is unknown; scene\.baz is"
    ) as told:
        from_table(Case, table)
    assert "known here" not in str(told.value)
    with pytest.raises(ValueError, match=r"scene\.baz is unknown; known here are .*background_g"):
        from_table(Case, {"scene": {"baz": 1}})


def test_a_change_may_name_a_table_that_is_not_there(written):
    assert table(written(top="a = 1"), "b.c.d=2") == {"a": 1, "b": {"c": {"d": 2}}}


def test_messages_name_the_file_of_a_value(written):
    path = written(ground="[t]\nx = 1\ny = 1", top='base = "ground.toml"\n[t]\ny = 2')
    layers = read_layers(path, "a file", ("t.z=3",))
    assert layers.blamed("t.x must be", path) == f"{path.parent / 'ground.toml'}: t.x must be"
    assert layers.blamed("t.y must be", path) == f"{path}: t.y must be"
    assert layers.blamed("t.z must be", path) == "--set: t.z must be"
    assert layers.blamed("t must be", path) == f"{path}: t must be"
    assert layers.blamed("u is missing", path) == f"{path}: u is missing"


def test_a_change_reaches_into_an_entry_of_a_list(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("[[v]]\nx = 1\nt = {y = 2, z = 3}\n[[v]]\nx = 4\n")
    layers = read_layers(path, "a file", ("v.0.t.y=5", "v.1.x=6", "v.1.w=7"))
    assert layers.table == {"v": [{"x": 1, "t": {"y": 5, "z": 3}}, {"x": 6, "w": 7}]}
    assert layers.blamed("v[1].x must be", path) == "--set: v[1].x must be"
    assert layers.blamed("v[0].x must be", path) == f"{path}: v[0].x must be"
    for change in ("v.2.x=1", "v.0=1", "v.x=1", "v.-1.x=1"):
        with pytest.raises(ValueError, match=r"--set.*v\.0\.KEY to v\.1\.KEY|KEY=VALUE"):
            read_layers(path, "a file", (change,))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('base = "top.toml"', "must not lead back to"),
        ('base = "none.toml"', "base must be the name of a file beside it.*'none.toml'"),
        ('base = ""', "base must be the name of a file beside it"),
        ('base = "\\u0000"', "base must be the name of a file beside it"),
        ('base = "."', "must be a file, but is a folder"),
        ("base = 3", "base must be the name of a file, got 3"),
        ('include = "a.toml"', "include must be a list of names"),
        ("include = [3]", "include must be a list of names"),
        ('include = ["none.toml"]', "include must be the name of a file beside it"),
        ('include = ["space-lens"]', "such as 'variations/space-lens.toml', got 'space-lens'"),
    ],
)
def test_what_is_no_file_is_refused(written, text, words):
    path = written(top=text)
    with pytest.raises(ValueError, match=words) as caught:
        table(path)
    assert str(path.parent) in str(caught.value)


@pytest.mark.parametrize("change", ["", "x", "=1", "a..b=1", "a b=1", "a.b[0]=1", "\n=1"])
def test_what_is_no_change_is_refused(written, change):
    with pytest.raises(ValueError, match="--set must be KEY=VALUE"):
        table(written(top="a = 1"), change)


def test_files_below_each_other_are_limited(written):
    files = {f"f{n}": f'base = "f{n + 1}.toml"' for n in range(DEEPEST)}
    path = written(**files, **{f"f{DEEPEST}": "a = 1"}).parent / "f0.toml"
    with pytest.raises(ValueError, match=f"at most {DEEPEST} files"):
        table(path)


def test_files_that_a_design_is_made_of_are_limited(tmp_path):
    """Ten files that each name the next one ten times would be read 10^9 times."""
    for number in range(9):
        below = ", ".join([f'"{number + 1}.toml"'] * 10)
        (tmp_path / f"{number}.toml").write_text(f"include = [{below}]")
    (tmp_path / "9.toml").write_text("")
    with pytest.raises(ValueError, match=r"0.toml must be made of at most 256 files"):
        read_layers(tmp_path / "0.toml", "a design file")
