"""Frames, their times and attitudes -> FITS, PNG, SER, raw or video files, and their table."""

import struct
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from startrack.core import Camera, Frame, Stars, one_of
from startrack.io.images import date_text, write_fits
from startrack.io.recordings import SER_HEADER, SER_MAGIC
from startrack.io.saving import save_csv, whole
from startrack.io.wcs import celestial

FORMATS = ("fits", "png", "ser", "raw", "mkv")
NOMINAL = 10.0  # 1 / second, of a video; the table has the times
YEAR_1 = datetime(1, 1, 1, tzinfo=UTC)
MICROSECOND = timedelta(microseconds=1)


class FrameFiles:
    """Frames of a sequence that are written one after the other, and a table of them.

    fits, png   a file for each frame: NAME-00001.fits, with WCS, times and true attitude;
                NAME-00001.png of 16 bits
    ser, raw    one file of all frames: NAME.ser, with times; NAME-COLUMNSxROWS-TYPE.raw
    mkv         one video of all frames, NAME.mkv: FFV1, lossless, grey, of 8 or 16 bits
    The table NAME.csv has a row for each frame: file, number in it, time, date, attitude.

    folder  of the files
    name    how their names begin
    format  one of FORMATS
    start   UTC of the time 0
    """

    def __init__(self, folder: Path, name: str, format: str, start: datetime):
        one_of(FORMATS, format=format)
        self._folder, self._name, self._format, self._start = folder, name, format, start
        self._rows, self._dates = list[list[Any]](), list[datetime]()
        self._kind: tuple[tuple[int, ...], np.dtype[Any]] | None = None  # of the frames of one file
        self._path = folder / f"{name}.{format}"
        self._open = ExitStack()
        self._stream: BinaryIO | None = None

    def add(
        self,
        frame: Frame,
        time: float,
        icrs_to_camera: Rotation,
        camera: Camera | None = None,
        stars: Stars | None = None,
        history: str = "",
    ) -> None:
        """Write the next frame.

        time            second, of the middle of its exposure
        icrs_to_camera  true attitude then
        camera, stars   for the WCS and the true stars of a FITS file; None: without
        Raises          ValueError if the format does not hold such pixels.
        """
        middle = self._start + timedelta(seconds=time)
        exposure = frame.exposure if np.isfinite(frame.exposure) else 0.0
        begun = middle - timedelta(seconds=exposure / 2)
        number = len(self._rows)
        path = self._folder / f"{self._name}-{number + 1:05d}.{self._format}"
        if self._format == "fits":
            write_fits(path, frame, camera, icrs_to_camera, stars, history, begun)
        elif self._format == "png":
            with whole(path) as draft:
                # Little compression: it would take ten times as long and save a tenth.
                image = _whole_numbers(frame.image, "png")
                cv2.imwrite(str(draft), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        else:
            self._append(_whole_numbers(frame.image, self._format))
            path = self._path
        self._dates.append(begun)
        place = number if self._format in ("ser", "raw", "mkv") else 0
        self._rows.append(
            [
                path.name,
                place,
                repr(float(time)),
                date_text(begun),
                repr(float(exposure)),
                *(repr(float(component)) for component in icrs_to_camera.as_quat(canonical=True)),
                *(f"{angle:.9f}" for angle in celestial(icrs_to_camera)),
            ]
        )

    def _append(self, image: NDArray[Any]) -> None:
        if self._kind is None:
            self._kind = (image.shape, image.dtype)
            if self._format == "raw":
                rows, columns = image.shape
                self._path = self._folder / f"{self._name}-{columns}x{rows}-{image.dtype}.raw"
            draft = self._open.enter_context(whole(self._path))
            if self._format == "mkv":
                self._video = _video(draft, image)
                self._open.callback(self._video.release)
            else:
                self._stream = self._open.enter_context(draft.open("wb"))
                self._stream.write(bytes(SER_HEADER.size if self._format == "ser" else 0))
        if self._kind != (image.shape, image.dtype):
            raise ValueError(f"all frames of {self._path} must have one size and type of pixel")
        if self._stream is None:
            self._video.write(image)
        else:
            self._stream.write(image.astype(image.dtype.newbyteorder("<"), copy=False).tobytes())

    def close(self) -> list[Path]:
        """End the files and write the table; returns the files."""
        if self._stream is not None and self._kind is not None and self._format == "ser":
            self._end_ser(self._stream, *self._kind)
        self._open.close()
        save_csv(
            self._folder / f"{self._name}.csv",
            ["file", "number", "time_s", "date_obs", "exposure_s"]
            + [f"icrs_to_camera_{axis}" for axis in "xyzw"]
            + ["ra_deg", "dec_deg", "roll_deg"],
            self._rows,
        )
        names = dict.fromkeys(row[0] for row in self._rows)
        return [*(self._folder / name for name in names), self._folder / f"{self._name}.csv"]

    def _end_ser(self, file: BinaryIO, shape: tuple[int, ...], kind: np.dtype[Any]) -> None:
        ticks = [(date - YEAR_1) // MICROSECOND * 10 for date in self._dates]
        file.write(struct.pack(f"<{len(ticks)}q", *ticks))
        file.seek(0)
        numbers = (0, 0, 0, *shape[::-1], 8 * kind.itemsize, len(ticks))
        texts = b"", b"startrack", b""
        file.write(SER_HEADER.pack(SER_MAGIC, *numbers, *texts, ticks[0], ticks[0]))

    def drop(self) -> None:
        """Remove incomplete files."""
        self._open.__exit__(GeneratorExit, GeneratorExit(), None)


def _video(path: Path, image: NDArray[Any]) -> cv2.VideoWriter:
    """A video of images like this one."""
    rows, columns = image.shape
    depth = cv2.CV_8U if image.dtype == np.uint8 else cv2.CV_16U
    form = [cv2.VIDEOWRITER_PROP_DEPTH, depth, cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    code = cv2.VideoWriter.fourcc(*"FFV1")
    video = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, NOMINAL, (columns, rows), form)
    if not video.isOpened():
        raise ValueError("mkv needs an OpenCV with FFmpeg, which this one is without")
    return video


def _whole_numbers(image: NDArray[Any], format: str) -> NDArray[Any]:
    """The image in 8 or 16 bits without a sign."""
    if image.dtype in (np.uint8, np.uint16):
        return image
    integer = image.size > 0 and np.issubdtype(image.dtype, np.integer)
    if integer and image.min() >= 0 and image.max() < 2**16:
        return image.astype(np.uint16)
    raise ValueError(
        f"a frame must have whole numbers from 0 to 65535 to be written as {format}, got "
        f"{image.dtype} from {image.min()} to {image.max()}; fits takes any"
    )
