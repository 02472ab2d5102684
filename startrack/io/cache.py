"""Function and its arguments -> its result, from a file if a former command has computed it."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from startrack.core import (
    Parameters,
    described,
    inputs_of,
    interpreting,
    private_folder,
    shown,
    software,
    trusted,
)

PACKAGE = __package__.partition(".")[0]
LONG = 0.3  # CPU second, from which on a result is kept; by hand, a hundred times that of a file
KEPT = 100  # files, of up to some megabytes each; chosen by hand
NAME = "result"  # begins the names of their files
P = ParamSpec("P")
T = TypeVar("T")


def cache_folder() -> Path:
    """Folder of kept results: STARTRACK_CACHE, else startrack in the user's cache folder."""
    chosen = os.environ.get("STARTRACK_CACHE")
    if chosen:
        return Path(chosen)
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "startrack"
    except RuntimeError:  # a user without a home, as in some containers
        user = os.getuid() if hasattr(os, "getuid") else 0
        return Path(tempfile.gettempdir()) / f"startrack-{user}"


def recalled(function: Callable[P, T]) -> Callable[P, T]:
    """The function, whose results of more than 0.3 s are kept from one command to the next.

    A result may depend on the positional arguments alone, on the files and the user code that they
    name, on the sources and tables of startrack, and on the packages that compute. Named arguments
    report progress, or follow from the others.

    function  its positional arguments are parameter objects, numbers and texts; its result consists
              of arrays, numbers and texts in tuples, lists, dictionaries, dataclasses and
              enumerations of startrack
    Raises    TypeError for another argument, or another result.
    """

    @wraps(function)
    def from_file_or_made(*args: P.args, **named: P.kwargs) -> T:
        if interpreting():  # its last digits differ from those of compiled code
            return function(*args, **named)
        place = f"{function.__module__}.{function.__qualname__}"
        key = f"{place} {_versions()} {[_written(arg) for arg in args]}"
        return from_cache(NAME, key, lambda: function(*args, **named), KEPT, LONG)

    return from_file_or_made


def _written(arg: Any) -> str:
    if isinstance(arg, Parameters):
        return f"{described(arg)} {inputs_of(arg)}"
    if not isinstance(arg, bool | int | float | str | None):
        raise TypeError(f"a kept result must depend on parameters and numbers, got {shown(arg)}")
    return repr(arg)


@cache
def _versions() -> str:
    """Versions of all that computes; including versions that only change the rounding."""
    import cv2
    import numba
    import scipy

    versions = (package.__version__ for package in (cv2, numba, np, scipy))
    return " ".join([software(), sys.version, *versions, platform.machine()])


def from_cache(
    kind: str,
    key: str,
    make: Callable[[], T],
    count: int,
    least: float = 0.0,
    folder: Path | None = None,
) -> T:
    """A value from a file if available; otherwise it is computed and kept.

    A file is named by a hash of its key. It is written atomically. The value is made again if the
    file cannot be read, is damaged, or could have been written by another user. If the folder is
    not writable, nothing is kept.

    kind    begins the names of the files
    key     of the value
    count   files of this kind that are kept, those used last
    least   CPU second that making takes, below which the value is not kept
    folder  is made where it does not exist; None: `cache_folder()`
    Returns the same, whether it comes from a file or not
    """
    folder = cache_folder() if folder is None else folder
    name = hashlib.sha256(key.encode()).hexdigest()
    path = folder / f"{kind}-{name[:32]}.npz"
    # A file that another user could have written is not read.
    if path.is_file() and trusted(folder) and trusted(path):
        # Reading a damaged file may raise any error.
        with suppress(Exception):
            return _read(path, name)
    began = time.process_time()
    value = make()
    if time.process_time() - began < least:
        return value
    arrays = packed(value)
    # The value is valid without its file: a full disk or a read-only folder is no failure.
    with suppress(OSError):
        _write(path, name, arrays)
        _prune(folder, kind, count)
    return unpacked(arrays)


def _read(path: Path, name: str) -> Any:
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        if str(file["key"]) != name:
            raise OSError(f"{path} is the file of another key")
        # The file has a CRC-32 of each array, which is compared when the array is read.
        value = unpacked(file)
    with suppress(OSError):
        os.utime(path)  # it was used
    return value


def _write(path: Path, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    if not private_folder(path.parent):
        raise OSError(f"{path.parent} is of another user, or others can write to it")
    # In the same folder, so that the last step is a renaming, which is atomic.
    with NamedTemporaryFile(dir=path.parent, prefix=path.stem, delete=False) as file:
        temporary = Path(file.name)
        try:
            np.savez(file, key=np.array(name), **arrays)  # type: ignore[arg-type]
        except BaseException:
            temporary.unlink()
            raise
    temporary.replace(path)


def _prune(folder: Path, kind: str, count: int) -> None:
    """Keep the files of a kind that were used last."""
    used = {path: path.stat().st_mtime for path in folder.glob(f"{kind}-*.npz")}
    for path in sorted(used, key=lambda path: used[path])[:-count]:
        path.unlink(missing_ok=True)


def packed(value: Any) -> dict[str, NDArray[Any]]:
    """The arrays of a value by number, and what is made of them as JSON, under "of".

    Raises  TypeError for a value that cannot be written.
    """
    arrays = list[NDArray[Any]]()
    text = json.dumps(_structure(value, arrays))
    return {"of": np.array(text), **{str(number): array for number, array in enumerate(arrays)}}


def _structure(value: Any, arrays: list[NDArray[Any]]) -> Any:
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is list:
        return [_structure(part, arrays) for part in value]
    if isinstance(value, np.ndarray | np.generic):
        if value.dtype.hasobject:
            raise TypeError(f"a kept result must consist of numbers and texts, got {value.dtype}")
        # Row by row or column by column and writable, as a file gives it.
        arrays.append(np.array(value, order="A"))
        return {"array": len(arrays) - 1, "scalar": isinstance(value, np.generic)}
    if kind is tuple:
        return {"tuple": _structure([*value], arrays)}
    if kind is dict:
        return {
            "keys": _structure([*value], arrays),
            "values": _structure([*value.values()], arrays),
        }
    name = f"{kind.__module__}:{kind.__qualname__}"
    if kind.__module__.partition(".")[0] == PACKAGE:
        if isinstance(value, Enum):
            return {"class": name, "name": value.name}
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return {"class": name, "of": _structure([*value], arrays)}
        if is_dataclass(value) and all(field.init for field in fields(value)):
            parts = {field.name: getattr(value, field.name) for field in fields(value)}
            return {"class": name, "of": _structure(parts, arrays)}
    raise TypeError(f"a kept result must consist of arrays and values of startrack, got {name}")


def unpacked(arrays: Mapping[str, NDArray[Any]]) -> Any:
    """Inverse of `packed`."""
    return _value(json.loads(str(arrays["of"])), arrays)


def _value(written: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    if isinstance(written, list):
        return [_value(part, arrays) for part in written]
    if not isinstance(written, dict):
        return written
    if "array" in written:
        array = arrays[str(written["array"])]
        return array[()] if written["scalar"] else array
    if "tuple" in written:
        return tuple(_value(written["tuple"], arrays))
    if "keys" in written:
        return dict(
            zip(*(_value(written[part], arrays) for part in ("keys", "values")), strict=True)
        )
    module, _, name = written["class"].partition(":")
    if module.partition(".")[0] != PACKAGE:
        raise ValueError(f"a kept result must consist of classes of {PACKAGE}, got {module}")
    kind: Any = import_module(module)
    for part in name.split("."):
        kind = getattr(kind, part)
    if "name" in written:
        return kind[written["name"]]
    parts = _value(written["of"], arrays)
    return kind(**parts) if isinstance(parts, dict) else kind(*parts)
