"""The pattern index of a catalogue and a field of view, from a file if one exists."""

import hashlib
from pathlib import Path

import numpy as np

from startrack.core import Camera, Kept, Stars
from startrack.identification.index import PatternIndex, build_index, indexed_field
from startrack.io import cache_folder, from_cache

FORMAT = 8  # raise it with every change of the content or the making of an index
# Number of kept files, each of about 10 MB; a photograph needs up to 26. Chosen by hand: disk space
# against rebuilding.
KEPT = 60
HELD = 34  # indexes of 10 MB kept in memory: enough for `identify_blind` and images up to 2 : 1


def cached_index(stars: Stars, field_of_view: float, folder: Path) -> PatternIndex:
    """The index of `build_index`, kept in a folder from one run to the next (`from_cache`).

    A file is named by a hash of everything that the index depends on. The 60 files used last are
    kept.

    stars          the tracker's catalogue
    field_of_view  radian, of the smaller side of the image
    folder         folder of the files; it is made if it does not exist
    """
    return from_cache(
        "index",
        _key(stars, field_of_view),
        lambda: build_index(stars, field_of_view),
        KEPT,
        folder=folder,
    )


class PatternIndexes:
    """The pattern indexes of one catalogue, by field of view; the 34 used last stay in memory.

    stars   the tracker's catalogue
    folder  folder in which indexes are kept from one run to the next; None: `cache_folder()`
    """

    def __init__(self, stars: Stars, folder: Path | None = None):
        self.stars = stars
        self._folder = cache_folder() if folder is None else folder
        self._indexes = Kept[PatternIndex](HELD)

    def __call__(self, camera: Camera) -> PatternIndex:
        """The index for a camera; cameras of nearly the same field share one."""
        field = indexed_field(camera)
        return self._indexes.get(field, lambda: cached_index(self.stars, field, self._folder))


def _key(stars: Stars, field_of_view: float) -> str:
    digest = hashlib.sha256(f"{FORMAT} {len(stars)} {field_of_view!r}".encode())
    for array in (stars.direction, stars.magnitude_g, stars.colour):
        digest.update(np.ascontiguousarray(array, "<f8").tobytes())
    return digest.hexdigest()
