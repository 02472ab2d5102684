"""The keys of a scene file of an Earth camera, as a list and as a JSON Schema."""

from functools import cache
from typing import Any

from startrack.design import DRAFT, OF_FILES, Key, keys_of, plain_schema, table_schema
from startrack.earth.imager import CHANNELS, Channel, cameras
from startrack.earth.retrieval.study import EarthDesign

CAMERA = "camera"
# spectra that a file of a spectral library may give
SPECTRA = "reflectance", "volumetric", "geometric"
SHARED = "keys for all channels; a key in the file of a channel overrides them"


@cache
def scene_keys() -> tuple[Key, ...]:
    """All keys of a scene file and of its study, in the order of their tables.

    Where `camera` is a text, it names a camera of the catalogue or a TOML file.
    """
    return (*OF_FILES, *keys_of(EarthDesign))


def scene_schema() -> dict[str, Any]:
    """A JSON Schema (draft 7) of scene files.

    It has types, ranges, choices and the names of all keys. `load_earth_design` checks units, rules
    between several keys, and which keys are required.
    """
    keys = {key.name: key for key in scene_keys()}
    schema = table_schema(EarthDesign, "", keys)
    own = schema["properties"][CAMERA]
    shared = table_schema(Channel, CHANNELS, keys)
    own["properties"]["shared"] = {"description": SHARED, **shared}
    by_name = {"type": "object", "additionalProperties": shared}
    channels = own["properties"]["channels"]
    own["properties"]["channels"] = {"anyOf": [channels, by_name]}
    schema["properties"] |= {key.name: plain_schema(key) for key in OF_FILES}
    named = {"type": "string", "description": f"{', '.join(cameras())}, or a TOML file"}
    schema["properties"][CAMERA] = {"description": keys[CAMERA].meaning, "anyOf": [named, own]}
    _with_files(schema["properties"]["land"])
    return {
        "$schema": DRAFT,
        "title": "startrack scene",
        "description": "A camera over the Earth, the purpose of its images, and a study of it.",
        **schema,
    }


def _with_files(schema: dict[str, Any]) -> None:
    """Allow files for the spectra of the land."""
    for name, inner in schema.get("properties", {}).items():
        table = inner.get("items", inner)
        if name in SPECTRA and "properties" in table:
            table["properties"] |= {
                "file": {"type": "string", "description": "table of a spectrum"},
                "unit": {"enum": ["nm", "um"]},
                "factor": {"type": "number"},
            }
        else:
            _with_files(table)
