"""Line, Scan: detectors of lines (one line, staggered lines, TDI)."""

from dataclasses import dataclass
from typing import Annotated

from startrack.core import FINITE, NON_NEGATIVE, Parameters, Range, Refused, whole

KINDS = ("line", "staggered", "tdi", "lines")


@dataclass(frozen=True)
class Line(Parameters):
    """A line of pixels: its position, delay and gain."""

    row: Annotated[float, FINITE, "pixel of the camera"]
    shift: Annotated[float, FINITE, "pixel of the camera, of its first column"] = 0.0
    delay: Annotated[float, FINITE,
        "exposures, of its exposure behind that of a line without delay"] = 0.0  # fmt: skip
    gain: Annotated[float, FINITE, "factor on what the pixels of the line collect"] = 1.0
    phase: Annotated[int, Range(0, 15),
        "number of the interleaved lines of the image to which it adds"] = 0  # fmt: skip


def tdi(stages: int, row: float = 0.0, downward: bool = True) -> tuple[Line, ...]:
    """Time delay and integration (TDI): charge moves from stage to stage with the image.

    row       pixel, of the first stage
    downward  whether the charge moves to larger rows
    """
    whole(1, 2**16, stages=stages)
    step = 1 if downward else -1
    return tuple(Line(row + step * n, delay=float(n)) for n in range(stages))


def staggered(distance: float, row: float = 0.0) -> tuple[Line, ...]:
    """Two lines, half a pixel apart along and `distance` pixel across.

    The delay of the second fits an image that moves by one pixel an exposure to larger rows.
    """
    return Line(row), Line(row + distance, 0.5, distance, phase=1)


@dataclass(frozen=True)
class Scan(Parameters):
    """A detector of lines, whose image grows while the camera turns.

    In its design, `columns` are the pixels of a line, `rows` the lines of the image, `exposure` is
    that of one line. Rows count from the middle of the camera; time zero is the middle of the
    image.
    """

    kind: Annotated[str, Range(choices=KINDS),
        '"line", "staggered", "tdi", or "lines" for any others, given in `lines`'
    ] = "line"  # fmt: skip
    stages: Annotated[int, Range(1, 2**12), "of a TDI"] = 1
    distance: Annotated[float, NON_NEGATIVE, "pixel between staggered lines"] = 4.0
    upward: Annotated[bool, "whether the charge of a TDI moves to smaller rows"] = False
    lines: Annotated[tuple[Line, ...], 'lines of the kind "lines"'] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.lines) != (self.kind == "lines"):
            raise Refused(f"lines must be given for the kind 'lines' alone, got {self.kind!r}")
        if self.stages > 1 and self.kind != "tdi":
            raise Refused(f"stages must be 1 for the kind {self.kind!r}, got {self.stages}")

    @property
    def all_lines(self) -> tuple[Line, ...]:
        """The lines; their rows are pixel from the middle of the field."""
        if self.kind == "line":
            return (Line(0.0),)
        if self.kind == "staggered":
            return staggered(self.distance, -self.distance / 2)
        if self.kind == "tdi":
            half = (self.stages - 1) / 2
            return tdi(self.stages, half if self.upward else -half, not self.upward)
        return self.lines

    @property
    def phases(self) -> int:
        """Columns of the image for each pixel of a line."""
        return 1 + max(line.phase for line in self.all_lines)

    @property
    def middle(self) -> tuple[float, float]:
        """Mean row and mean delay of all lines, weighted with their gain."""
        lines = self.all_lines
        gain = sum(line.gain for line in lines)
        row = sum(line.gain * line.row for line in lines)
        return row / gain, sum(line.gain * line.delay for line in lines) / gain
