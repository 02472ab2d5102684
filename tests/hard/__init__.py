"""Hard cases for every room, one list for the tests and for `experiments/hard_cases.py`."""

from tests.hard import (
    attitude,
    catalog,
    detection,
    detector,
    earth,
    identification,
    metrics,
    motion,
    optics,
    scene,
)
from tests.hard.case import CASES, Hard

ROOMS = (
    *(catalog, scene, earth, optics, motion, detector, detection, identification, attitude),
    metrics,
)

__all__ = ["CASES", "ROOMS", "Hard"]
