"""Name of shipped data -> its path on this computer."""

from __future__ import annotations

from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
# In an installed wheel, and in a checkout of the repository.
FOLDERS = (PACKAGE / "_catalogs", PACKAGE.parent / "catalogs")


def shipped(name: str) -> Path:
    """Where a shipped data file or folder lies.

    >>> shipped("stars/bright.fits").name
    'bright.fits'

    name     path inside `catalogs`, with forward slashes
    Returns  its path on this computer
    Raises   FileNotFoundError where this installation does not have it.
    """
    for folder in FOLDERS:
        if (folder / name).exists():
            return folder / name
    looked = " or ".join(str(folder) for folder in FOLDERS)
    raise FileNotFoundError(f"shipped data must be in {looked}, and {name!r} is in neither")
