"""Hard cases of every room, one list for the tests and for `experiments/hard_cases.py`."""

from hard import (
    attitude,
    catalog,
    detection,
    detector,
    earth,
    error,
    identification,
    motion,
    optics,
    scene,
)
from hard.case import CASES, Hard

ROOMS = (
    *(catalog, scene, earth, optics, motion, detector, detection, identification, attitude),
    error,
)

__all__ = ["CASES", "ROOMS", "Hard"]
