"""Plan of a mission -> its flown parts on disk: a stopped run continues."""

import hashlib
import io
import json
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from startrack.core import Advance, file_digest, inputs_of, software
from startrack.io import Database, FileKind, to_table
from startrack.mission.engine import Flown, MissionPlan, fly_part, merged, parts_of
from startrack.mission.files import clock_of
from startrack.mission.parameters import Loaded, with_files
from startrack.mission.rendered import Checked, checked
from startrack.mission.surrogate import SurrogateCorrection

# "STRM" in the file's header. Files of format 0 had rows without a checksum.
STORE = FileKind("mission store", 0x5354524D, version=1)
CHECKS = -1  # number of the row with the results of the plan's trials


def key_of(loaded: Loaded) -> bytes:
    """Hash of all inputs of a mission's result; paths of files are not included.

    That is the mission, the designs of its heads, the content of all files that these name, and the
    version of startrack.
    """
    mission, cases = loaded.mission, [design.case for design in loaded.designs]
    law = mission.attitude
    bare = with_files(mission, lambda _: "file", lambda _: "design")
    content: list[Any] = [software(), *map(to_table, (bare, *cases))]
    content += [list(inputs_of(part).values()) for part in (mission, *cases)]
    if law.aem and (clock := clock_of(Path(law.aem))).is_file():
        content.append(file_digest(clock))
    text = json.dumps(content, sort_keys=True, default=str).encode()
    return hashlib.blake2b(text, digest_size=16).digest()


def flown_from(
    plan: MissionPlan, path: Path | None, advance: Advance = lambda _: None
) -> tuple[MissionPlan, tuple[Checked, ...], Flown]:
    """Check a plan by the trials that its mission asks for, and fly all of its steps.

    What is done is kept part by part, and not done again by the same mission. A store of another
    mission begins anew.

    path     of the store; None: nothing is kept
    advance  called with 1 after each trial, and with the number of steps after each part
    Returns  the plan, corrected by the trials; results of the checks; the steps. They are the same
             to the bit, however often the run was stopped
    Raises   ValueError if the file is not a store of missions, or damaged; OSError if another
             process uses it.
    """
    with closing(Database(path, STORE)) as database:
        key = key_of(plan.loaded)
        with database.transaction() as execute:
            execute("DELETE FROM rows WHERE key != ?", (key,))
        stored = dict(database.kept(key))
        plan, checks = _checked(plan, database, key, stored.get(CHECKS), advance)
        parts = []
        for first, count in parts_of(plan.loaded.mission.time.steps):
            if first in stored:
                parts.append(_read(stored[first]))
            else:
                parts.append(fly_part(plan, first, count))
                database.keep(key, first, _written(parts[-1]))
            advance(count)
    return plan, checks, merged(parts)


def _checked(
    plan: MissionPlan, database: Database, key: bytes, stored: bytes | None, advance: Advance
) -> tuple[MissionPlan, tuple[Checked, ...]]:
    if stored is None:
        plan, checks = checked(plan, advance)
        corrections = (plan.surrogates[check.heads[0]].correction for check in checks)
        kept = [
            {"check": asdict(check), "correction": vars(correction)}
            for check, correction in zip(checks, corrections, strict=True)
        ]
        text = json.dumps(kept, default=np.ndarray.tolist)
        database.keep(key, CHECKS, text.encode())
        return plan, checks
    surrogates, checks_ = list(plan.surrogates), []
    for entry in json.loads(stored):
        lists = {k: tuple(v) for k, v in entry["check"].items() if isinstance(v, list)}
        checks_.append(Checked(**(entry["check"] | lists)))
        names, *numbers = entry["correction"].values()
        correction = SurrogateCorrection(tuple(names), *map(np.array, numbers))
        for h in checks_[-1].heads:
            surrogates[h] = replace(surrogates[h], correction=correction)
        advance(checks_[-1].trials)
    return replace(plan, surrogates=tuple(surrogates)), tuple(checks_)


def _written(flown: Flown) -> bytes:
    """All arrays of a part; lists as arrays, the chances of the heads one after the other."""
    values = dict(vars(flown))
    values["worst"] = np.array(flown.worst, float).reshape(-1, 2)
    values["chances"] = np.concatenate([np.zeros(0), *flown.chances])
    values["ends"] = np.cumsum([len(chances) for chances in flown.chances])
    file = io.BytesIO()
    np.savez_compressed(file, **values)
    return file.getvalue()


def _read(data: bytes) -> Flown:
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        values = {name: file[name] for name in file.files}
    ends = values.pop("ends")
    values["step"] = float(values["step"])
    values["worst"] = [(float(a), float(b)) for a, b in values["worst"]]
    chances = np.split(values["chances"], ends[:-1])
    values["chances"] = tuple(part.tolist() for part in chances)
    return Flown(**values)
