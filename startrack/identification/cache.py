"""The pattern index of a catalogue and a field of view, from a file if one exists."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray

from startrack.core import Camera, Kept, Stars, private_folder, trusted
from startrack.identification.grids import SkyGrid, VerificationStars
from startrack.identification.index import CodeTable, PatternIndex, build_index, indexed_field

FORMAT = 7  # raise it with every change of the content or the making of an index
# Files of some 10 MB; a photograph needs up to 26. Chosen by hand: disk against rebuilding.
KEPT = 60
HELD = 34  # indexes of 10 MB in memory: all of `identify_blind`, for images up to 2 : 1


class _Parts(NamedTuple):
    table: CodeTable
    bright: VerificationStars
    faint: SkyGrid


def cache_folder() -> Path:
    """Folder of the indexes: STARTRACK_CACHE, else startrack in the user's cache folder."""
    chosen = os.environ.get("STARTRACK_CACHE")
    if chosen:
        return Path(chosen)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "startrack"
    except RuntimeError:  # a user without a home, as in some containers
        user = os.getuid() if hasattr(os, "getuid") else 0
        return Path(tempfile.gettempdir()) / f"startrack-{user}"


def cached_index(stars: Stars, field_of_view: float, folder: Path) -> PatternIndex:
    """The index of `build_index`, kept in a folder from one run to the next.

    A file is named by a hash of everything that the index depends on. It is written atomically. It
    is built again if it cannot be read, is damaged, or could have been written by another user. The
    60 files used last are kept; if the folder is not writable, nothing is kept.

    stars          the tracker's catalogue
    field_of_view  radian, of the smaller side of the image
    folder         is made where it does not exist
    """
    key = _key(stars, field_of_view)
    path = folder / f"index-{key[:32]}.npz"
    # A file that another user could have written is not read.
    readable = path.is_file() and trusted(folder) and trusted(path)
    index = _read(path, key) if readable else None
    if index is None:
        index = build_index(stars, field_of_view)
        # The index is valid without its file: a full disk or a read-only folder is no failure.
        with contextlib.suppress(OSError):
            _write(path, key, index)
            _prune(folder)
    return index


class PatternIndexes:
    """The pattern indexes of one catalogue, by field of view; the 34 used last stay in memory.

    stars   the tracker's catalogue
    folder  where they are kept from one run to the next; None: `cache_folder()`
    """

    def __init__(self, stars: Stars, folder: Path | None = None):
        self.stars = stars
        self._folder = cache_folder() if folder is None else folder
        self._indexes = Kept[PatternIndex](HELD)

    def __call__(self, camera: Camera) -> PatternIndex:
        """The index for a camera; cameras of nearly the same field share one."""
        field = indexed_field(camera)
        return self._indexes.get(field, lambda: cached_index(self.stars, field, self._folder))


def _prune(folder: Path) -> None:
    """Keep the KEPT indexes that were used last."""
    used = {path: path.stat().st_mtime for path in folder.glob("index-*.npz")}
    for path in sorted(used, key=lambda path: used[path])[:-KEPT]:
        path.unlink(missing_ok=True)


def _key(stars: Stars, field_of_view: float) -> str:
    digest = hashlib.sha256(f"{FORMAT} {len(stars)} {field_of_view!r}".encode())
    for array in (stars.direction, stars.magnitude_g, stars.colour):
        digest.update(np.ascontiguousarray(array, "<f8").tobytes())
    return digest.hexdigest()


def _write(path: Path, key: str, index: PatternIndex) -> None:
    if not private_folder(path.parent):
        raise OSError(f"{path.parent} is of another user, or others can write to it")
    arrays = {
        "key": np.array(key),
        "scalars": np.array([index.stars, index.field_of_view]),
        **_arrays("", index),
    }
    # In the same folder, so that the last step is a renaming, which is atomic.
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


def _arrays(prefix: str, value: Any) -> dict[str, NDArray[Any]]:
    """The arrays and numbers of nested named tuples, by their path."""
    if isinstance(value, PatternIndex):
        value = _Parts(value.table, value.bright, value.faint)
    if not hasattr(value, "_asdict"):
        return {prefix: np.asarray(value)}
    parts = value._asdict().items()
    return {k: v for name, part in parts for k, v in _arrays(f"{prefix}.{name}", part).items()}


def _build(prefix: str, kind: Any, file: Mapping[str, NDArray[Any]]) -> Any:
    """Inverse of `_arrays`."""
    if not hasattr(kind, "_fields"):
        value = file[prefix]
        return value.item() if value.ndim == 0 else value
    kinds = get_type_hints(kind)
    return kind(*(_build(f"{prefix}.{name}", kinds[name], file) for name in kind._fields))


def _read(path: Path, key: str) -> PatternIndex | None:
    """The index of a file, None where there is none or it is damaged."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            if str(file["key"]) != key:
                return None
            count, field_of_view = file["scalars"].tolist()
            # The file has a CRC-32 of each array, which is compared when the array is read.
            index = PatternIndex(int(count), field_of_view, *_build("", _Parts, file))
        with contextlib.suppress(OSError):
            os.utime(path)  # it was used
        return index
    except Exception:  # zipfile, zlib and numpy each raise their own
        return None
