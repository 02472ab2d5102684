"""Many frames of one camera enter; their Matches leave, in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from startrack.camera import Camera
from startrack.identification.identify import identify
from startrack.identification.index import PatternIndex
from startrack.identification.parameters import Identification
from startrack.values import Matches, Spots, Stars


def identify_all(
    frames: Iterable[Spots],
    camera: Camera,
    stars: Stars,
    index: PatternIndex,
    settings: Identification,
) -> Iterator[Matches]:
    """Identify frame after frame, each with nothing known of its attitude.

    A generator: thousands of frames need the memory of one. The frames are independent, so that
    an executor may share them out among processes; see `identify` for the arguments.
    """
    for spots in frames:
        yield identify(spots, camera, stars, index, settings)
