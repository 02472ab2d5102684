"""A parameter declared once is checked, and may name user code where its declaration allows it."""

import os
from dataclasses import field, is_dataclass
from importlib import import_module

import pytest

from startrack import Refused
from startrack.core import (
    FILE,
    NON_NEGATIVE,
    POSITIVE,
    FileState,
    Parameters,
    Range,
    Unit,
    fields_of,
    parameter,
)


class Lens(Parameters):
    """A class with all kinds of declarations."""

    focal_length: float = parameter("of the lens", unit=Unit("m", "mm"), limit=POSITIVE)
    blur: float | None = parameter(limit=NON_NEGATIVE, default=None)
    loss: float = parameter(limit=Range(0, 1, above=True), default=0.5)
    stop: float = parameter(limit=Range(1, 100, above=True), default=2.0)
    elements: int = parameter(limit=Range(1, 20), default=4)
    first: int = parameter(limit=Range(0), default=0)
    kind: str = parameter(limit=Range(choices=("thin", "thick")), default="thin")
    radii: tuple[float, ...] = parameter(limit=POSITIVE, default=())
    methods: tuple[str, ...] = parameter(
        limit=Range(choices=("own",), code="centroids"), default=()
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"focal_length": 0.0}, "focal_length must be positive, got 0.0 m$"),
        ({"blur": -1.0}, "blur must not be negative, got -1.0$"),
        ({"loss": 0.0}, "loss must be positive, got 0.0"),
        ({"loss": 1.5}, r"loss must lie in \[0, 1\], got 1.5"),
        ({"stop": 1.0}, "stop must be above 1, got 1.0"),
        ({"loss": "high"}, "loss must be a number, got 'high'"),
        ({"elements": 21}, r"elements must be a whole number in \[1, 20\], got 21"),
        ({"elements": 2.5}, "elements must be a whole number, got 2.5"),
        ({"first": -1}, "first must be at least 0, got -1"),
        ({"kind": "flat"}, "kind must be one of thin, thick, got 'flat'"),
        ({"radii": (1.0, -2.0)}, "radii must be positive, got -2.0"),
        ({"methods": ("own", "other")}, "methods must be one of own, or code as module:function"),
    ],
)
def test_what_lies_outside_its_declaration_is_refused(changed, message):
    with pytest.raises(Refused, match=message):
        Lens(**{"focal_length": 0.05, **changed})


def test_what_lies_within_is_taken_as_it_is():
    lens = Lens(0.05, None, 1.0, 100.0, 20, 10**12, "thick", (0.1, 0.2), ("own", "mine:centroid"))
    assert lens.methods == ("own", "mine:centroid")


def test_a_declaration_has_unit_range_meaning_and_default():
    field = fields_of(Lens)["focal_length"]
    assert (field.kind, field.unit) == (float, Unit("m", "mm"))
    assert (field.range, field.meaning, field.required) == (POSITIVE, "of the lens", True)
    assert fields_of(Lens)["blur"].default is None


class Scanned(Parameters):
    """An object with files."""

    table: str = parameter(limit=FILE, default="")
    beside: str | None = parameter(limit=FILE, default=None)
    _files: tuple[FileState, ...] = field(init=False, repr=False, default=())


def test_objects_whose_file_has_changed_are_not_equal(tmp_path):
    """Files that changed in length or time, or that no longer exist; all else is equal."""
    file = tmp_path / "a.csv"
    assert Scanned(str(file)) == Scanned(str(file))
    seen = [Scanned(str(file))]
    for content, time in (("1", 10**9), ("1, 2", 10**9), ("3, 4", 2 * 10**9)):
        file.write_text(content)
        os.utime(file, ns=(time, time))
        assert Scanned(str(file)) == Scanned(str(file))
        seen.append(Scanned(str(file)))
    assert len(set(seen)) == 4
    assert len({repr(one) for one in seen}) == 1
    assert Scanned("") == Scanned()


def kinds(of):
    return {of, *(kind for sub in of.__subclasses__() for kind in kinds(sub))}


def test_every_class_that_names_files_says_how_they_are():
    for room in ("design", "sequence", "mission", "earth.imager"):
        import_module(f"startrack.{room}")
    for kind in filter(is_dataclass, kinds(Parameters)):
        files = [one for one in fields_of(kind).values() if one.range and one.range.file]
        assert bool(files) == ("_files" in kind.__dataclass_fields__), kind
