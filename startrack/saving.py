"""Files that are written whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A path to write to, which takes the place of `path` when all went well.

    The folder is made where it is missing. An error leaves what was there before.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays last, because writers of pictures tell the format by it.
    draft = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def save_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with whole(path) as draft:
        draft.write_text(text, encoding="utf-8")


def save_json(path: Path, value: Any) -> None:
    """Write a JSON file whole."""
    save_text(path, json.dumps(value, indent=1) + "\n")
