"""Guide stars and triangles <-> the bytes of a file; its C header and reader."""

import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from startrack.core import Floats, Ints, printed, ra_dec
from startrack.io import read_bytes, save_csv, save_text, whole

MAGIC, VERSION = b"STARGUID", 1
UNIT = 2.0**-30  # step of coordinates and angles: 0.19 mas
# Format of the file, little-endian and without gaps; docs/onboard.md has the same table.
WORDS = ("triangles", "limit", "epoch", "field_of_view", "resolution", "smallest", "largest")
HEADER = np.dtype(
    [
        ("magic", "S8"),
        *((name, "<u4") for name in ("version", "size", "crc32")),
        ("stars", "<u2"),
        *((name, "u1") for name in ("cells_x", "cells_y")),
        *((name, "<u4") for name in WORDS),
        ("per_field", "<u2"),
        ("reserved", "V10"),
    ]
)
STAR = np.dtype([("direction", "<i4", (3,)), ("magnitude", "<u2"), ("flags", "<u2")])
CHECKED = HEADER.fields["stars"][1]  # type: ignore[index]  # byte from which on crc32 is taken
DOUBLE, VARIABLE, STILL = 1, 2, 4  # flags of a star
SOURCES = ("startrack_guide.h", "startrack_guide.c")
NAME = "startrack_guide"


@printed
@dataclass(frozen=True, eq=False)
class Guide:
    """Guide stars in rising order of z, and their triangles, as in a file.

    direction      (n, 3) unit vectors, ICRS, from the barycentre, in steps of 2^-30
    magnitude      (n,) in the band of the instrument, in steps of 0.001
    flags          (n,) sum of DOUBLE, VARIABLE and STILL
    identifier     (n,) identifier in the catalogue; not in the file: 0 after reading
    triangle       (k, 3) stars A, B, C of each triangle, A and B farthest apart; sorted by cells
    start          (cells_x cells_y + 1,) index of the first triangle of each cell
    cells          number of cells along x from 0 to 1/2, and along y on either side of the base
    epoch          Julian year of the directions
    field_of_view  radian
    limit          magnitude of the faintest admitted star
    resolution     radian; closer stars are merged
    base           radian, smallest and largest of the longest side of a triangle
    per_field      guide stars per field after thinning
    """

    direction: Floats
    magnitude: Floats
    flags: Ints
    identifier: Ints
    triangle: Ints
    start: Ints
    cells: tuple[int, int]
    epoch: float
    field_of_view: float
    limit: float
    resolution: float
    base: tuple[float, float]
    per_field: int

    def __len__(self) -> int:
        return len(self.direction)

    def __bytes__(self) -> bytes:
        stars = np.zeros(len(self), STAR)
        stars["direction"] = np.round(self.direction / UNIT)
        stars["magnitude"] = np.round(1000 * self.magnitude) + 2**15
        stars["flags"] = self.flags
        body = stars.tobytes() + self.start.astype("<u4").tobytes()
        body += self.triangle.astype("<u2").tobytes()
        head = np.zeros((), HEADER)
        angles = self.field_of_view, self.resolution, *self.base
        head["magic"], head["version"], head["size"] = MAGIC, VERSION, HEADER.itemsize + len(body)
        head["stars"], head["per_field"] = len(self), self.per_field
        head["cells_x"], head["cells_y"] = self.cells
        head["limit"], head["epoch"] = round(1000 * (self.limit + 100)), round(1e6 * self.epoch)
        for name, value in zip(WORDS[3:], angles, strict=True):
            head[name] = int(np.rint(value / UNIT))
        head["triangles"] = len(self.triangle)
        head["crc32"] = zlib.crc32(head.tobytes()[CHECKED:] + body)
        return head.tobytes() + body

    def nearest(self, direction: Floats) -> int:
        """The star nearest to a direction (3,)."""
        return int(np.argmin(np.square(self.direction - direction).sum(axis=1)))

    def cone(self, direction: Floats, radius: float) -> Ints:
        """The stars within a radius (radian) of a direction (3,), in rising order."""
        chord = 2 * np.sin(min(radius, np.pi) / 2)
        return np.flatnonzero(np.square(self.direction - direction).sum(axis=1) <= chord**2)

    def patterns(self, seen: Floats, error: float) -> set[tuple[tuple[int, ...], tuple[int, ...]]]:
        """Triangles similar to the triangle of three directions, in any axes.

        All triangles are compared one by one, without the cells: a reference for implementations of
        a reader.

        seen     (3, 3) unit vectors
        error    1, largest difference of codes and of logarithms of the longest side
        Returns  pairs of the stars A, B, C and of the indices of their directions
        """
        code, base = self._codes
        side = [_separation(seen[k], seen[(k + 1) % 3]) for k in range(3)]
        longest = max(side)
        alike = np.abs(np.log(longest / base)) <= error
        pairs = set[tuple[tuple[int, ...], tuple[int, ...]]]()
        for k in range(3):
            if side[k] < longest * (1 - error):
                continue
            order = (k, (k + 1) % 3, (k + 2) % 3)
            x, y = triangle_codes(*(seen[i][None] for i in order))[0]
            for names, at, wanted in (
                (order, (x, y), x <= 0.5 + error),
                ((order[1], order[0], order[2]), (1 - x, -y), x >= 0.5 - error),
            ):
                near = np.square(code - at).sum(axis=1) <= error**2
                rows = np.flatnonzero(near & alike & wanted)
                pairs |= {(tuple(map(int, self.triangle[row])), names) for row in rows}
        return pairs

    @cached_property
    def _codes(self) -> tuple[Floats, Floats]:
        stars = [self.direction[self.triangle[:, k]] for k in range(3)]
        return triangle_codes(*stars), _separation(stars[0], stars[1])


def triangle_codes(a: Floats, b: Floats, c: Floats) -> Floats:
    """Codes (n, 2) of triangles of directions (n, 3), with A and B farthest apart."""
    middle, base = a + b, b - a
    across = np.cross(middle, base)
    length, width = (np.square(star).sum(axis=1) for star in (base, middle))
    depth = (c * middle).sum(axis=1) * length
    x = 0.5 + 0.5 * (c * base).sum(axis=1) * width / depth
    return np.column_stack([x, 0.5 * (c * across).sum(axis=1) * np.sqrt(width) / depth])


def _separation(a: Floats, b: Floats) -> Floats:
    chord: Floats = np.linalg.norm(a - b, axis=-1)
    return 2 * np.arcsin(np.minimum(chord / 2, 1))


def write_guide(folder: Path, guide: Guide) -> list[Path]:
    """Write a guide for flight software.

    startrack_guide.bin     bytes of the guide
    startrack_guide_data.h  the same bytes as an array of C
    startrack_guide.csv     number, identifier, place, magnitude and flags of each star
    startrack_guide.h, .c   reader in C99; it needs the C library alone
    Returns                 paths of the files
    """
    data = bytes(guide)
    with whole(folder / f"{NAME}.bin") as draft:
        draft.write_bytes(data)
    save_text(folder / f"{NAME}_data.h", _array(data))
    ra, dec = ([f"{angle:.7f}" for angle in angles] for angles in ra_dec(guide.direction).T)
    magnitude = [f"{number:.3f}" for number in guide.magnitude]
    names, flags = guide.identifier.tolist(), guide.flags.tolist()
    rows = zip(range(len(guide)), names, ra, dec, magnitude, flags, strict=True)
    head = ["star", "identifier", "ra_deg", "dec_deg", "magnitude", "flags"]
    save_csv(folder / f"{NAME}.csv", head, rows)
    for name in SOURCES:
        save_text(folder / name, (Path(__file__).parent / name).read_text(encoding="utf-8"))
    return [folder / f"{NAME}{end}" for end in (".bin", "_data.h", ".csv", ".h", ".c")]


def _array(data: bytes) -> str:
    rows = [", ".join(map(str, data[k : k + 24])) for k in range(0, len(data), 24)]
    lines = ",\n".join(rows)
    return f"""/* The bytes of startrack_guide.bin, for startrack_guide_open. */
#ifndef STARTRACK_GUIDE_DATA_H
#define STARTRACK_GUIDE_DATA_H

static const unsigned char startrack_guide_data[{len(data)}] = {{
{lines}
}};

#endif
"""


def read_guide(path: Path) -> Guide:
    """Read startrack_guide.bin.

    Raises  FileNotFoundError without the file; ValueError if it is incomplete, damaged or
            another kind of file.
    """
    data = read_bytes(path, "a file of guide stars")
    if len(data) < HEADER.itemsize or data[:8] != MAGIC:
        raise ValueError(f"{path} must begin with {MAGIC.decode()}, got {data[:8]!r}")
    head = np.frombuffer(data, HEADER, 1)[0]
    if head["version"] != VERSION:
        raise ValueError(f"{path} must be of version {VERSION}, got {head['version']}")
    if head["size"] != len(data):
        raise ValueError(f"{path} must have {head['size']} bytes, got {len(data)}")
    if zlib.crc32(data[CHECKED:]) != head["crc32"]:
        raise ValueError(f"{path} must have the checksum {head['crc32']:#010x} of its header")
    cells = int(head["cells_x"]), int(head["cells_y"])
    at = HEADER.itemsize
    count, cut = int(head["stars"]), cells[0] * cells[1] + 1
    expected = at + count * STAR.itemsize + 4 * cut + 6 * int(head["triangles"])
    if expected != len(data):
        raise ValueError(f"{path} must have {expected} bytes for its counts, got {len(data)}")
    stars = np.frombuffer(data, STAR, count, at)
    at += stars.nbytes
    start = np.frombuffer(data, "<u4", cut, at)
    triangle = np.frombuffer(data, "<u2", 3 * int(head["triangles"]), at + start.nbytes)
    field, resolution, smallest, largest = (float(head[name]) * UNIT for name in WORDS[3:])
    return Guide(
        direction=stars["direction"] * UNIT,
        magnitude=(stars["magnitude"].astype(float) - 2**15) / 1000,
        flags=stars["flags"].astype(np.int64),
        identifier=np.zeros(count, np.int64),
        triangle=triangle.reshape(-1, 3).astype(np.int64),
        start=start.astype(np.int64),
        cells=cells,
        epoch=float(head["epoch"]) / 1e6,
        field_of_view=field,
        limit=float(head["limit"]) / 1000 - 100,
        resolution=resolution,
        base=(smallest, largest),
        per_field=int(head["per_field"]),
    )
