"""Write each key that a file may hold, a page for each kind of file, and JSON Schemas.

    python docs/list_keys.py

Keys, units, ranges, defaults and meanings are those that the classes declare.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from startrack.design import Key, design_keys, design_schema, keys_of
from startrack.earth.retrieval import scene_keys, scene_schema
from startrack.io import save_json, shipped
from startrack.mission import Mission
from startrack.moving import moving_keys
from startrack.sequence import Sequence

PAGE = Path(__file__).with_name("reference.md")
MISSION = Path(__file__).with_name("mission-keys.md")
SCENE = Path(__file__).with_name("scene-keys.md")
PROFILE = Path(__file__).with_name("profile-keys.md")
SEARCH = Path(__file__).with_name("search-keys.md")
SCHEMA = shipped("designs") / "design.schema.json"
SCENE_SCHEMA = shipped("scenes") / "scene.schema.json"
HEAD = """\
# Keys of a design file
Every key that a design file may hold, table by table; `startrack keys instrument.optics` prints \
those of one table. A value with a unit is a text, such as `focal_length = "35 mm"`: in the unit \
given here or in any that converts to it; a number without a unit may be a percentage \
(`"35 %"`). Tables in double brackets may stand several times. "Taken by" \
names the fidelities of trials, and the error budget, that compute with a key; those in brackets \
run the design but leave the key out, those that are not named refuse it \
(`experiments/key_fidelities.py` finds it so). The \
[conventions](conventions.md) say which way axes and angles go, the [models](models.md) what is \
computed. `python docs/list_keys.py` writes this page.
"""
MISSION_HEAD = """\
# Keys of a mission file
Every key that a mission file may hold, table by table, as `startrack mission` [reads](mission.md) \
them; `startrack keys --mission orbit` prints those of one table. A value with a unit is a text, \
such as `altitude = "600 km"`. `python docs/list_keys.py` writes this page.
"""
SCENE_HEAD = """\
# Keys of a scene file
Every key that a scene file of an Earth camera may hold, table by table; `startrack keys --scene \
land` prints those of one table. `camera` may also be a text, the name of a camera of the \
[catalogue](../catalogs/cameras/README.md) or of a TOML file, and a reflectance may be in a file \
of a spectral library: `{ file = "grass.csv", unit = "um", factor = 0.01 }`. `[retrieval]` and \
`[campaign]` are for a study of the camera alone. A value with a unit is a text, such as \
`altitude = "572 km"`. `python docs/list_keys.py` writes this page.
"""
PROFILE_HEAD = """\
# Keys of a profile
Every key that a profile of `startrack sequence` may hold, table by table: how the platform turns, \
and what the filter knows; `startrack keys --profile gyro` prints those of one table. A value with \
a unit is a text, such as `period = "0.2 s"`. `catalogs/sequences` has examples. \
`python docs/list_keys.py` writes this page.
"""
SEARCH_HEAD = """\
# Keys of a search for moving objects
Every key that a [search for moving objects](search-moving-objects.md) may hold, table by table; \
`startrack keys --search moving_object` prints those of one table. A value with a unit is a text, \
such as `rate = "1 deg / d"`. `python docs/list_keys.py` writes this page.
"""
TABLES = ("table", "tables")


def page() -> str:
    """The text of docs/reference.md."""
    return _page(HEAD, design_keys(), "taken by")


def mission_page() -> str:
    """The text of docs/mission-keys.md."""
    return _page(MISSION_HEAD, keys_of(Mission), "")


def scene_page() -> str:
    """The text of docs/scene-keys.md."""
    return _page(SCENE_HEAD, scene_keys(), "")


def profile_page() -> str:
    """The text of docs/profile-keys.md."""
    return _page(PROFILE_HEAD, keys_of(Sequence), "")


def search_page() -> str:
    """The text of docs/search-keys.md."""
    return _page(SEARCH_HEAD, moving_keys(), "")


def _page(head: str, keys: Iterable[Key], taken: str) -> str:
    about = {key.name: key for key in keys}
    tables = dict[str, list[Key]]()
    for key in about.values():
        if key.kind not in TABLES:
            tables.setdefault(key.name.rpartition(".")[0], []).append(key)
    return "\n".join([head, *(_section(name, about, keys, taken) for name, keys in tables.items())])


def _section(table: str, about: dict[str, Key], keys: list[Key], taken: str) -> str:
    heading = "Top of the file"
    meaning = ""
    if table:
        one = about[table]
        heading = f"`[[{table}]]`" if one.kind == "tables" else f"`[{table}]`"
        meaning = f"{_cell(one.meaning[:1].upper() + one.meaning[1:]).rstrip('.')}.\n"
    taken = taken if any(key.taken_by for key in keys) else ""
    rows = [
        f"| `{key.name.rpartition('.')[2]}` | {key.kind} | {key.unit} | {key.range} | "
        f"{_default(key)} | {f'{key.taken_by} | ' if taken else ''}{_cell(key.meaning)} |\n"
        for key in keys
    ]
    names = ["key", "type", "unit", "range", "default", *([taken] if taken else []), "meaning"]
    head = f"| {' | '.join(names)} |\n{'|---' * len(names)}|\n"
    return f"## {heading}\n{meaning}\n{head}{''.join(rows)}"


def _default(key: Key) -> str:
    return key.default if key.default in ("required", "none", "") else f"`{key.default}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    MISSION.write_text(mission_page(), encoding="utf-8")
    SCENE.write_text(scene_page(), encoding="utf-8")
    PROFILE.write_text(profile_page(), encoding="utf-8")
    SEARCH.write_text(search_page(), encoding="utf-8")
    save_json(SCHEMA, design_schema())
    save_json(SCENE_SCHEMA, scene_schema())
    print(f"wrote {PAGE}, {MISSION}, {SCENE}, {PROFILE}, {SEARCH}, {SCHEMA} and {SCENE_SCHEMA}")
