"""`startrack serve`: a camera in a control loop, over a socket of this machine."""

from __future__ import annotations

import argparse
import json
import math
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from io import BufferedRWPair
from typing import TYPE_CHECKING, Any

from startrack.cli import options as shared
from startrack.cli.options import DESIGN, Exit, Option, Options, wanted, whole

if wanted(__name__):
    import numpy as np
    from scipy.spatial.transform import Rotation

    from startrack.cli import terminal
    from startrack.cli.stopping import one_line
    from startrack.core import Status, arcsec, deg
    from startrack.io import finite
    from startrack.sequence import CameraLoop

if TYPE_CHECKING:
    from startrack.sequence import SeenFrame

HOST = "127.0.0.1"
LONGEST = 65536  # byte, longest request
SHORTEST = 1e-6  # least norm of a quaternion; its inverse is the largest. By hand
KEYS = ("attitude_xyzw", "rate_deg_s", "frame", "time_s", "pixels")
LIMITS = 0.5, 0.99  # quantiles of the printed times

declare = Options(
    "Listens on a port of 127.0.0.1. A client sends one JSON object a line: attitude_xyzw, the "
    "quaternion icrs_to_camera in the middle of the exposure, scalar last; and optionally "
    "rate_deg_s, the rate of the camera about its axes (default: that of the design); frame, the "
    "number of the frame (default: the next); time_s, which is returned unchanged; pixels, "
    "whether the image follows. The reply is one JSON object a line: frame, time_s, status, "
    "attitude_xyzw and sigma_arcsec as stated by the tracker, spots, stars, and with pixels "
    "an object with their rows, columns, dtype and bytes; that number of bytes follows the line. "
    "The reply to an invalid request is an object with the key error. One client is served at a "
    "time.",
    *DESIGN,
    shared.SEED,
    Option("--port N", "port; 0: a free port, which is printed", whole(0, 65535), 0),
    Option("--once", "end when the first client leaves"),
)


def command(options: argparse.Namespace) -> int:
    """Answer one client after the other until a signal ends the command."""
    case = terminal.read_design(options.design or terminal.example(), options.set).case
    with shared.as_wrong_use():
        loop = CameraLoop(case, options.seed)
    with terminal.stage("first frames"):  # the first frames compute inputs that a design needs once
        for rate in (None, np.zeros(3)):
            loop.see(Rotation.identity(), rate, 0)
    with shared.as_wrong_use(OSError):
        listener = socket.create_server((HOST, options.port))
    seconds = list[float]()
    loop = CameraLoop(case, options.seed)  # begins with frame 0
    with closing(listener), terminal.waiting():
        port = listener.getsockname()[1]
        detector = case.instrument.detector
        text = (
            f"serving frames of {detector.columns} x {detector.rows} pixels on {HOST}:{port}, "
            f"seed {options.seed}; design period {loop.period:.3g} s; Ctrl-C ends it"
        )
        about = {"host": HOST, "port": port, "period_s": loop.period, "seed": options.seed}
        terminal.print_result(options, about, text)
        try:
            while True:
                connection, _ = listener.accept()
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with _lost(), connection, connection.makefile("rwb") as stream:
                    for reply, pixels in _replies(loop, stream, seconds):
                        stream.write(json.dumps(finite(reply)).encode() + b"\n" + pixels)
                        stream.flush()
                if options.once:
                    return Exit.DONE
        finally:
            if seconds:
                terminal.print_result(options, *_times(seconds, loop.period))


@contextmanager
def _lost() -> Iterator[None]:
    """A client that leaves during a reply ends only its own connection."""
    try:
        yield
    except ConnectionError as error:
        terminal.print_message(f"the client is gone: {one_line(error)}")


def _replies(
    loop: CameraLoop, stream: BufferedRWPair, seconds: list[float]
) -> Iterator[tuple[dict[str, Any], bytes]]:
    """The reply to each request, and the pixels that follow; each reply adds its time in
    seconds."""
    while line := stream.readline(LONGEST + 1):
        began = time.perf_counter()
        if len(line) > LONGEST:
            yield {"error": f"a request must be at most {LONGEST} bytes long"}, b""
            return
        try:
            request = _request(line)
            seen = loop.see(
                Rotation.from_quat(request["attitude_xyzw"]),
                None if (rate := request.get("rate_deg_s")) is None else np.array(rate) * deg,
                request.get("frame"),
            )
        except ValueError as error:
            yield {"error": one_line(error)}, b""
            continue
        reply, pixels = _reply(seen, request)
        yield reply, pixels
        seconds.append(time.perf_counter() - began)


def _request(line: bytes) -> dict[str, Any]:
    """A checked request. Raises ValueError with the key, the rule and the value."""
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise ValueError(f"a request must be one JSON object, got {line[:80]!r}") from None
    if not isinstance(request, dict):
        raise ValueError(f"a request must be a JSON object, got {line[:80]!r}")
    if unknown := sorted(set(request) - set(KEYS)):
        raise ValueError(f"{unknown[0]} is unknown; known are {', '.join(KEYS)}")
    quaternion = _numbers(request, "attitude_xyzw", 4)
    if quaternion is None or not SHORTEST <= math.hypot(*quaternion) <= 1 / SHORTEST:
        raise ValueError(
            f"attitude_xyzw must be four numbers with a norm from {SHORTEST:g} to {1 / SHORTEST:g},"
            f" got {quaternion}"
        )
    _numbers(request, "rate_deg_s", 3)
    number = request.get("frame")
    largest = shared.LARGEST_SEED
    if number is not None and (type(number) is not int or not 0 <= number <= largest):
        raise ValueError(f"frame must be a whole number from 0 to {largest}, got {number!r}"[:200])
    date = request.get("time_s")
    if date is not None and not _is_finite(date):
        raise ValueError(f"time_s must be a finite number, got {date!r}"[:200])
    if not isinstance(request.get("pixels", False), bool):
        raise ValueError(f"pixels must be true or false, got {request['pixels']!r}"[:200])
    return request


def _numbers(request: dict[str, Any], key: str, count: int) -> list[float] | None:
    """Finite numbers of a request; None without the key."""
    value = request.get(key)
    if value is None:
        return None
    if not (isinstance(value, list) and len(value) == count and all(map(_is_finite, value))):
        raise ValueError(f"{key} must be {count} finite numbers, got {value!r}"[:200])
    return value


def _is_finite(value: Any) -> bool:
    """Whether a JSON value fits into a float: integers of JSON have no limit."""
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


def _reply(seen: SeenFrame, request: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """The tracker's result for a frame; the bytes of its pixels, if requested."""
    estimate = seen.estimate
    solved = estimate.status is Status.SOLVED
    reply: dict[str, Any] = {
        "frame": seen.number,
        "time_s": request.get("time_s"),
        "status": str(estimate.status),
        "attitude_xyzw": terminal.quaternion(estimate.icrs_to_camera) if solved else None,
        "sigma_arcsec": (
            (np.sqrt(np.diag(estimate.covariance)) / arcsec).tolist() if solved else None
        ),
        "spots": seen.spots,
        "stars": estimate.stars,
    }
    if not request.get("pixels"):
        return reply, b""
    image = np.ascontiguousarray(seen.frame.image)
    little = image.astype(image.dtype.newbyteorder("<"), copy=False)
    rows, columns = image.shape
    about = {"rows": rows, "columns": columns, "dtype": little.dtype.str, "bytes": little.nbytes}
    return reply | {"pixels": about}, little.tobytes()


def _times(seconds: list[float], period: float) -> tuple[dict[str, Any], str]:
    """Times from request to reply: for JSON, and in words."""
    median, slow = np.quantile(seconds, LIMITS)
    within = float(np.mean(np.array(seconds) <= period))
    values = {
        "frames": len(seconds),
        "median_s": float(median),
        "p99_s": float(slow),
        "period_s": period,
        "within_period": within,
    }
    return values, (
        f"{len(seconds)} frames; from request to reply {1e3 * median:.1f} ms in the median, "
        f"{1e3 * slow:.1f} ms in 99 %; {100 * within:.2f} % within the period of "
        f"{1e3 * period:.4g} ms"
    )
