"""The JSON Schema of design files beside the loader, by another program (jsonschema)."""

import copy
import json
import random
import tomllib
from contextlib import nullcontext

import jsonschema
import pytest
import tomli_w

from startrack.core import fields_of
from startrack.design import design_keys, design_schema, load_design
from startrack.design.case import Case
from startrack.io import from_table, shipped, to_table

SCHEMA = design_schema()
CHECK = jsonschema.Draft7Validator(SCHEMA)
DESIGNS = sorted(
    [path for folder in ("designs", "trackers") for path in shipped(folder).glob("*.toml")]
)
BASE = tomllib.loads(shipped("designs/noise_only.toml").read_text())


def test_it_is_a_schema_and_the_shipped_one():
    jsonschema.Draft7Validator.check_schema(SCHEMA)
    assert json.loads(shipped("designs/design.schema.json").read_text()) == SCHEMA


@pytest.mark.parametrize("path", DESIGNS, ids=lambda path: path.stem)
def test_shipped_designs_are_valid(path):
    assert [error.message for error in CHECK.iter_errors(tomllib.loads(path.read_text()))] == []
    whole = to_table(load_design(path).case)  # every key, with its default
    assert [error.message for error in CHECK.iter_errors(whole)] == []


def leaves(table, place=()):
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, (*place, key))
        elif not (isinstance(value, list) and value and isinstance(value[0], dict)):
            yield (*place, key), value


KINDS = ("unknown", "kind", "huge", "below", "missing", "choice", "no unit")


def mistakes(about):
    """Invalid values for a field, by the kind of mistake; None: there is none."""
    found = {"unknown": 0, "kind": [{}], "huge": 10**40}
    if about.range and not about.range.startswith("at most"):
        found["below"] = f"-1 {about.unit}" if about.unit else -(10**6)
    if about.default == "required":
        found["missing"] = None
    if about.kind.startswith("one of"):
        found["choice"] = "no name"
    if about.unit:
        found["no unit"] = 1.0
    return found


def mutated(rng, kind):
    """The example with one mistake of each kind."""
    table, keys = copy.deepcopy(BASE), {key.name: key for key in design_keys()}
    able = [place for place, _ in leaves(table) if kind in mistakes(keys[".".join(place)])]
    *tables, name = rng.choice(able)
    inner = table
    for key in tables:
        inner = inner[key]
    value = mistakes(keys[".".join([*tables, name])])[kind]
    inner.pop(name)
    if value is not None:
        inner[f"{name}_x" if kind == "unknown" else name] = value
    return table


@pytest.mark.parametrize("kind", KINDS)
def test_mistakes_are_refused_by_schema_and_loader_alike(kind, tmp_path):
    rng = random.Random(f"20261122 {kind}")
    for _ in range(15):
        table, path = mutated(rng, kind), tmp_path / "design.toml"
        path.write_text(tomli_w.dumps(table))
        assert not CHECK.is_valid(table), path.read_text()
        with pytest.raises(ValueError):
            load_design(path)


@pytest.mark.parametrize(
    ("place", "name", "inside", "outside"),
    [
        ("optics", "f_number", 0.3, 0.29),
        ("optics", "psf_tolerance", 1.0, 1.01),
        ("detector", "bits", 24, 25),
        ("detector", "exposure", "1 ms", "0 ms"),
        ("detector", "nonlinearity", -0.49, -0.5),
    ],
)
def test_the_ends_of_a_range_are_those_of_the_loader(place, name, inside, outside):
    limits = fields_of(type(getattr(load_design(DESIGNS[0]).case.instrument, place)))[name].range
    design = {key: copy.deepcopy(BASE[key]) for key in BASE if key != "campaign"}
    for value, allowed in ((inside, True), (outside, False)):
        design["instrument"][place][name] = value
        number = float(str(value).split()[0])
        assert limits.holds(number) is allowed
        with nullcontext() if allowed else pytest.raises(ValueError, match=name):
            from_table(Case, design)


def test_a_file_over_another_need_not_have_everything():
    assert CHECK.is_valid({"base": "other.toml", "instrument": {"optics": {"f_number": 2.0}}})
    assert not CHECK.is_valid({"instrument": {"optics": {"f_number": 2.0}}})
