"""Plan of a mission -> its flown parts on disk: a run that was stopped goes on where it was."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import startrack
from startrack.io import Database, FileKind, read_bytes, to_table
from startrack.mission.engine import Flown, Plan, fly_part, merged, parts_of
from startrack.mission.files import LARGEST
from startrack.mission.parameters import Loaded
from startrack.mission.rendered import Checked, checked
from startrack.mission.surrogate import Correction

STORE = FileKind(
    "mission store",
    0x5354524D,  # "STRM" in the file's header
    """
CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS parts (
    first INTEGER PRIMARY KEY, flown BLOB NOT NULL, checksum BLOB NOT NULL
);
""",
)


def key_of(loaded: Loaded) -> str:
    """What the result of a mission depends on, as a hash: not where its files lie.

    That is the mission, the designs of its heads and its files of orbit and attitude as they are
    now, and the version of startrack.
    """
    mission = loaded.mission
    orbit, law = mission.orbit, mission.attitude
    files = [
        read_bytes(Path(file), "a file of the mission", LARGEST)
        for file in (orbit.oem, law.aem)
        if file
    ]
    bare = replace(
        mission,
        orbit=replace(orbit, oem=orbit.oem and "oem"),
        attitude=replace(law, aem=law.aem and "aem"),
        heads=tuple(replace(head, design="design") for head in mission.heads),
    )
    content = [startrack.__version__, to_table(bare)]
    content += [to_table(design.case) for design in loaded.designs]
    text = json.dumps(content, sort_keys=True, default=str).encode()
    return hashlib.blake2b(b"\0".join([text, *files]), digest_size=16).hexdigest()


def flown_from(
    plan: Plan, path: Path | None, advance: Callable[[int], None] = lambda _: None
) -> tuple[Plan, tuple[Checked, ...], Flown]:
    """Check a plan by the trials that its mission asks for, and fly all of its steps.

    What is done is kept part by part, and not done again by the same mission. A store of another
    mission begins anew.

    path     of the store; None: nothing is kept
    advance  called with 1 after each trial, and with the number of steps after each part
    Returns  the plan, corrected by the trials; what they say of it; the steps. They are the same
             to the bit, however often the run was stopped
    Raises   ValueError where the file is no store of missions, or damaged; OSError where another
             process has it.
    """
    database = Database(path, STORE)
    try:
        key = key_of(plan.loaded)
        with database.transaction() as execute:
            if database.read("SELECT value FROM about WHERE name = 'key'") != [(key,)]:
                execute("DELETE FROM about")
                execute("DELETE FROM parts")
                execute("INSERT INTO about VALUES ('key', ?)", (key,))
        plan, checks = _checked(plan, database, advance)
        parts = []
        for first, count in parts_of(plan.loaded.mission.time.steps):
            rows = database.read("SELECT flown, checksum FROM parts WHERE first = ?", first)
            if rows:
                parts.append(_read(path, *rows[0]))
            else:
                parts.append(fly_part(plan, first, count))
                data = _written(parts[-1])
                with database.transaction() as execute:
                    execute("INSERT INTO parts VALUES (?, ?, ?)", (first, data, _sum(data)))
            advance(count)
    finally:
        database.close()
    return plan, checks, merged(parts)


def _checked(
    plan: Plan, database: Database, advance: Callable[[int], None]
) -> tuple[Plan, tuple[Checked, ...]]:
    rows = database.read("SELECT value FROM about WHERE name = 'checks'")
    if not rows:
        plan, checks = checked(plan, advance)
        kept = [
            {
                "check": asdict(check),
                "correction": _plain(plan.surrogates[check.heads[0]].correction),
            }
            for check in checks
        ]
        with database.transaction() as execute:
            execute("INSERT INTO about VALUES ('checks', ?)", (json.dumps(kept),))
        return plan, checks
    surrogates, checks_ = list(plan.surrogates), []
    for entry in json.loads(rows[0][0]):
        check: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in entry["check"].items()
        }
        checks_.append(Checked(**check))
        names, *numbers = (entry["correction"][field.name] for field in fields(Correction))
        correction = Correction(tuple(names), *map(np.array, numbers))
        for h in checks_[-1].heads:
            surrogates[h] = replace(surrogates[h], correction=correction)
        advance(checks_[-1].trials)
    return replace(plan, surrogates=tuple(surrogates)), tuple(checks_)


def _plain(correction: Correction | None) -> dict[str, Any]:
    assert correction is not None
    values = {field.name: getattr(correction, field.name) for field in fields(correction)}
    return {k: v.tolist() if isinstance(v, np.ndarray) else list(v) for k, v in values.items()}


def _sum(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=8).digest()


def _written(flown: Flown) -> bytes:
    """All arrays of a part; lists as arrays, the chances of the heads one after the other."""
    values = {field.name: getattr(flown, field.name) for field in fields(flown)}
    values["worst"] = np.array(flown.worst, float).reshape(-1, 2)
    values["chances"] = np.concatenate([np.zeros(0), *flown.chances])
    values["ends"] = np.cumsum([len(chances) for chances in flown.chances])
    file = io.BytesIO()
    np.savez_compressed(file, **values)
    return file.getvalue()


def _read(path: Path | None, data: bytes, known: bytes) -> Flown:
    if _sum(data) != known:
        raise ValueError(f"{path} is damaged: a part of the mission is not as it was written")
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        values = {name: file[name] for name in file.files}
    ends = values.pop("ends")
    values["step"] = float(values["step"])
    values["worst"] = [(float(a), float(b)) for a, b in values["worst"]]
    values["chances"] = tuple(
        chances.tolist() for chances in np.split(values["chances"], ends[:-1])
    )
    return Flown(**values)
