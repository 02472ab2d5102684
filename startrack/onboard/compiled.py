"""The reader in C, compiled on this machine and called with the bytes of a file."""

import ctypes
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import Floats, Ints

STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror")
GOOD = 0
REASONS = {1: "no file of guide stars", 2: "cut", 3: "damaged", 4: "of contradicting numbers"}
MOST = 4096  # largest number of triangles of a look-up


class _Struct(ctypes.Structure):
    """startrack_guide of startrack_guide.h."""

    _fields_ = [
        ("bytes", ctypes.c_void_p),
        *((name, ctypes.c_uint32) for name in ("stars", "triangles", "cells_x", "cells_y")),
        *(
            (name, ctypes.c_double)
            for name in ("epoch", "field", "limit", "resolution", "smallest", "largest")
        ),
    ]


def c_compiler() -> str | None:
    """The C compiler of this machine; None if there is none."""
    return next((path for path in map(shutil.which, ("cc", "gcc", "clang")) if path), None)


class CompiledGuide:
    """Operations of flight software on the bytes of startrack_guide.bin, by the C reader.

    data    the bytes
    Raises  ValueError without a C compiler, and where the reader refuses the bytes.
    """

    def __init__(self, data: bytes):
        self._c = _library()
        self._data = data  # the C reader refers to these bytes
        self._guide = _Struct()
        status = self._c.startrack_guide_open(
            ctypes.byref(self._guide), data, ctypes.c_size_t(len(data))
        )
        if status != GOOD:
            raise ValueError(
                f"the bytes must be a file of guide stars, got bytes {REASONS[status]}"
            )

    def star(self, number: int) -> tuple[Floats, float, int]:
        """Direction (3,), magnitude and flags of a star."""
        direction, magnitude, flags = np.empty(3), ctypes.c_double(), ctypes.c_uint()
        self._c.startrack_guide_star(
            ctypes.byref(self._guide),
            ctypes.c_uint32(number),
            _pointer(direction),
            ctypes.byref(magnitude),
            ctypes.byref(flags),
        )
        return direction, magnitude.value, flags.value

    def nearest(self, direction: Floats) -> int:
        """As `Guide.nearest`."""
        place = ctypes.byref(self._guide), _given(direction), None
        return int(self._c.startrack_guide_nearest(*place))

    def cone(self, direction: Floats, radius: float) -> Ints:
        """As `Guide.cone`."""
        stars = np.empty(self._guide.stars, np.uint32)
        count = self._c.startrack_guide_cone(
            ctypes.byref(self._guide),
            _given(direction),
            ctypes.c_double(radius),
            _pointer(stars),
            ctypes.c_uint32(len(stars)),
        )
        return stars[:count].astype(np.int64)

    def patterns(self, seen: Floats, error: float) -> set[tuple[tuple[int, ...], tuple[int, ...]]]:
        """As `Guide.patterns`, by means of the cells."""
        triangles, order = np.empty((MOST, 3), np.uint32), np.empty((MOST, 3), np.int32)
        count = self._c.startrack_guide_patterns(
            ctypes.byref(self._guide),
            _given(seen),
            ctypes.c_double(error),
            _pointer(triangles),
            _pointer(order),
            ctypes.c_uint32(MOST),
        )
        if count > MOST:
            raise ValueError(f"error must lead to at most {MOST} triangles, got {count}")
        pairs = zip(triangles[:count].tolist(), order[:count].tolist(), strict=True)
        return {(tuple(stars), tuple(names)) for stars, names in pairs}

    def identify(self, seen: Floats, sigma: float, chance: float = 1e-5) -> tuple[Ints, Floats]:
        """The star of each direction (n,), -1 for no star, and the matrix (3, 3) icrs_to_camera.

        seen    (n, 3) unit vectors, camera axes, brightest first
        sigma   radian, standard deviation of the directions along each axis
        chance  accepted bound of the probability of a match by chance
        """
        star, turn = np.full(len(seen), -1, np.int32), np.zeros((3, 3))
        count = self._c.startrack_guide_identify(
            ctypes.byref(self._guide),
            _given(seen),
            ctypes.c_int(len(seen)),
            ctypes.c_double(sigma),
            ctypes.c_double(chance),
            _pointer(star),
            _pointer(turn),
        )
        if count == 0:
            star[:] = -1
        return star.astype(np.int64), turn


def _given(array: Floats) -> ctypes.c_void_p:
    return _pointer(np.ascontiguousarray(array, np.float64))  # the pointer keeps the array


def _pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    """The reader as a library, compiled with the strictest warnings."""
    compiler = c_compiler()
    if compiler is None:
        raise ValueError("a C compiler such as gcc must be installed for startrack_guide.c")
    with TemporaryDirectory() as folder:
        path = Path(folder) / "guide.so"
        source = Path(__file__).with_name("startrack_guide.c")
        command = [compiler, *STRICT, "-shared", "-fPIC", str(source), "-lm", "-o", str(path)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise ValueError(f"startrack_guide.c must compile, got: {done.stderr.strip()[:300]}")
        return ctypes.CDLL(str(path))
