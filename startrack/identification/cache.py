"""Stars and a field of view enter; their pattern index leaves, from a file where there is one."""

from __future__ import annotations

import hashlib
import os
import zipfile
from pathlib import Path
from tempfile import NamedTemporaryFile

import numpy as np

from startrack.identification.index import (
    CodeTable,
    PatternIndex,
    build_index,
)
from startrack.identification.sky import SkyGrid, Voters
from startrack.values import Stars

FORMAT = 3  # grows with every change of what an index holds or how it is built


def cached_index(stars: Stars, field_of_view: float, folder: Path) -> PatternIndex:
    """The index of `build_index`, kept in a folder from one run to the next.

    A file is named by a key of all that the index depends on. It appears whole or not at all,
    and is built again where it cannot be read or does not hold what its key promises.

    stars          the tracker's catalogue
    field_of_view  radian, of the smaller side of the image
    folder         is made where it does not exist
    """
    key = _key(stars, field_of_view)
    path = folder / f"index-{key[:32]}.npz"
    index = _read(path, key)
    if index is None:
        index = build_index(stars, field_of_view)
        _write(path, key, index)
    return index


def _key(stars: Stars, field_of_view: float) -> str:
    digest = hashlib.sha256(f"{FORMAT} {len(stars)} {field_of_view!r}".encode())
    for array in (stars.direction, stars.magnitude_g, stars.colour):
        digest.update(np.ascontiguousarray(array, "<f8").tobytes())
    return digest.hexdigest()


def _write(path: Path, key: str, index: PatternIndex) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {
        "key": np.array(key),
        "checksum": np.array(_checksum(index)),
        "scalars": np.array([index.stars, index.field_of_view]),
        "magnitude": index.bright.magnitude,
        "blur": index.bright.blur,
    }
    for name, part in (("table", index.table), ("bright", index.bright.sky), ("faint", index.faint)):
        arrays |= {f"{name}.{field}": np.asarray(value) for field, value in part._asdict().items()}
    # The same folder, so that the last step is a renaming, which happens at once.
    with NamedTemporaryFile(dir=path.parent, prefix=path.stem, delete=False) as file:
        temporary = Path(file.name)
        try:
            np.savez(file, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        except BaseException:
            temporary.unlink()
            raise
    temporary.replace(path)


def _read(path: Path, key: str) -> PatternIndex | None:
    """The index of a file, None where there is none or it is not whole."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            if str(file["key"]) != key:
                return None
            table, bright, faint = (
                {
                    field: value.item() if value.ndim == 0 else value
                    for field, value in ((f, file[f"{name}.{f}"]) for f in kind._fields)
                }
                for name, kind in (("table", CodeTable), ("bright", SkyGrid), ("faint", SkyGrid))
            )
            count, field_of_view = file["scalars"].tolist()
            index = PatternIndex(
                int(count),
                field_of_view,
                CodeTable(**table),
                Voters(SkyGrid(**bright), file["magnitude"], file["blur"]),
                SkyGrid(**faint),
            )
            return index if str(file["checksum"]) == _checksum(index) else None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def _checksum(index: PatternIndex) -> str:
    """Quick to compute; against damage, not against malice."""
    digest = hashlib.blake2b(digest_size=16)
    for part in (*index.table, *index.bright.sky, *index.bright[1:], *index.faint):
        digest.update(np.ascontiguousarray(part).tobytes())
    return digest.hexdigest()
