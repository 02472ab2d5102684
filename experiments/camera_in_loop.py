"""Does `startrack serve` deliver frames at the rate of a camera, equal to those of `simulate`?

    python experiments/camera_in_loop.py [--minutes M] [--same N] [--json FILE] [--quick]

A client in this process requests frames of a megapixel at 10 Hz from a server in another process,
at the attitudes of a slow slew. After each reply it waits for the next period.

serve_p99_over_period  99th percentile of the time from request to last pixel, over the period
serve_within           fraction of the frames that arrived within their period
serve_frames           number of frames
serve_same             1 where frames have the same bytes as those of `startrack simulate` with the
                       same seed and attitude
"""

from __future__ import annotations

import one_thread  # noqa: F401  # isort: skip

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedRWPair
from pathlib import Path
from typing import Any

import command
import numpy as np
from scipy.spatial.transform import Rotation

import startrack
from startrack import deg
from startrack.io import pointing

PERIOD = 0.1  # second
CAMERA = """\
base = "designs/noise_only.toml"
[instrument.detector]
columns = 1024
rows = 1024
frame_rate = "10 Hz"
pixel_rate = "20 Mpix / s"
"""
AXIS, RATE = np.array([0.3, 1.0, 0.0]), 0.05 * deg  # of the slew, a second


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--minutes", type=float, default=10.0, help="duration of the frames, minute (default: 10)"
    )
    parser.add_argument(
        "--same", type=int, default=3, help="number of frames to compare with `simulate`"
    )
    options = command.read(parser, minutes=0.02, same=1)
    with tempfile.TemporaryDirectory() as folder:
        design = Path(folder) / "megapixel.toml"
        design.write_text(CAMERA, encoding="utf-8")
        with served(design) as stream:
            same = [is_same(stream, design, number) for number in range(options.same)]
            seconds = timed(stream, round(60 * options.minutes / PERIOD))
    figures = {
        "serve_p99_over_period": float(np.quantile(seconds, 0.99)) / PERIOD,
        "serve_within": float(np.mean(np.array(seconds) <= PERIOD)),
        "serve_median_s": float(np.median(seconds)),
        "serve_frames": len(seconds),
        "serve_same": int(all(same)),
    }
    print(json.dumps(figures, indent=1))
    command.save(options, figures)


@contextmanager
def served(design: Path) -> Iterator[BufferedRWPair]:
    """A connection to a server of a design."""
    words = [*startrack_command("serve"), str(design), "--seed", "5", "--once", "--json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment()) as server:
        assert server.stdout
        port = json.loads(server.stdout.readline())["port"]
        with (
            socket.create_connection(("127.0.0.1", port)) as connection,
            connection.makefile("rwb") as stream,
        ):
            yield stream
        print(server.stdout.readline().strip())


def asked(stream: BufferedRWPair, **request: Any) -> tuple[dict[str, Any], bytes]:
    """The reply to a request, and the pixels."""
    stream.write(json.dumps({**request, "pixels": True}).encode() + b"\n")
    stream.flush()
    reply = json.loads(stream.readline())
    return reply, stream.read(reply["pixels"]["bytes"])


def is_same(stream: BufferedRWPair, design: Path, number: int) -> bool:
    """Whether a frame has the bytes of `startrack simulate`."""
    ra, dec, roll = 83.0 + 40 * number, -5.0 + 20 * number, 10.0 * number
    quaternion = pointing(ra, dec, roll).as_quat().tolist()
    _, pixels = asked(stream, attitude_xyzw=quaternion, frame=number)
    with tempfile.TemporaryDirectory() as folder:
        angles = ["--ra", str(ra), "--dec", str(dec), "--roll", str(roll)]
        drawn = ["--seed", "5", "--trial", str(number), "--pixels", "raw", "--out", folder]
        words = [*startrack_command("simulate"), str(design), *angles, *drawn]
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, env=environment())
        [raw] = Path(folder).glob("*.raw")
        return raw.read_bytes() == pixels


def timed(stream: BufferedRWPair, frames: int) -> list[float]:
    """Seconds of each frame of a slew, with one request in each period."""
    seconds, start = [], pointing(83.0, -5.0, 0.0)
    rate = (RATE * AXIS / np.linalg.norm(AXIS) / deg).tolist()
    due = time.perf_counter()
    for number in range(frames):
        turn = -RATE * number * PERIOD * AXIS / np.linalg.norm(AXIS)
        quaternion = (Rotation.from_rotvec(turn) * start).as_quat().tolist()
        began = time.perf_counter()
        asked(stream, attitude_xyzw=quaternion, rate_deg_s=rate, time_s=number * PERIOD)
        seconds.append(time.perf_counter() - began)
        due = max(due + PERIOD, time.perf_counter())
        time.sleep(max(due - time.perf_counter(), 0.0))
    return seconds


def startrack_command(name: str) -> list[str]:
    """The first words of a command."""
    return [sys.executable, "-m", "startrack.cli", name]


def environment() -> dict[str, str]:
    """The environment of a process that imports the same package as this one."""
    return os.environ | {"PYTHONPATH": str(Path(startrack.__file__).parents[1])}


if __name__ == "__main__":
    command.run(main)
