"""`startrack serve` over a socket: replies, errors, and the pixels of `simulate`."""

import json
import socket
import threading
import time

import numpy as np
import pytest

from startrack.cli.main import main
from startrack.io import pointing


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


def connected(port):
    for _ in range(600):
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            time.sleep(0.1)
    raise AssertionError("nobody listens")


@pytest.fixture(scope="module")
def asking():
    """A function that sends a line and returns the reply and its pixels."""
    port = free_port()
    arguments = ["serve", "designs/noise_only.toml", "--port", str(port), "--seed", "7", "--once"]
    server = threading.Thread(target=main, args=(arguments,), daemon=True)
    server.start()
    with connected(port) as connection, connection.makefile("rwb") as stream:

        def ask(line):
            stream.write(line + b"\n")
            stream.flush()
            reply = json.loads(stream.readline())
            return reply, stream.read(reply.get("pixels", {}).get("bytes", 0))

        yield ask
    server.join(60)
    assert not server.is_alive()


def request(**values):
    return json.dumps(values).encode()


def test_frames_have_the_pixels_of_simulate(asking, tmp_path):
    angles = ["--ra", "83", "--dec", "-5", "--roll", "20"]
    drawn = ["--seed", "7", "--trial", "3", "--pixels", "raw", "--out", str(tmp_path)]
    assert main(["simulate", "designs/noise_only.toml", *angles, *drawn]) == 0
    [raw] = tmp_path.glob("*.raw")
    truth = pointing(83.0, -5.0, 20.0)
    reply, pixels = asking(
        request(attitude_xyzw=truth.as_quat().tolist(), frame=3, time_s=0.25, pixels=True)
    )
    assert pixels == raw.read_bytes()
    assert reply["pixels"] == {"rows": 512, "columns": 512, "dtype": "<u2", "bytes": 2**19}
    assert (reply["frame"], reply["time_s"], reply["status"]) == (3, 0.25, "solved")
    off = np.abs(np.dot(reply["attitude_xyzw"], truth.as_quat()))
    assert 2 * np.arccos(min(off, 1)) < np.radians(30 / 3600)
    following, nothing = asking(request(attitude_xyzw=truth.as_quat().tolist()))
    assert (following["frame"], nothing) == (4, b"")


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (b"junk", "a request must be one JSON object, got b'junk"),
        (b"[1]", "a request must be a JSON object"),
        (b"[" * 5000, "a request must be one JSON object"),
        (request(attitude=[0, 0, 0, 1]), "attitude is unknown; known are attitude_xyzw"),
        (request(frame=1), "attitude_xyzw must be four numbers"),
        (request(attitude_xyzw=[0, 0, 0, 0]), "attitude_xyzw must be four numbers"),
        (
            request(attitude_xyzw=[0, 0, 0, 1e-300]),
            "attitude_xyzw must be four numbers with a norm",
        ),
        (request(attitude_xyzw=[0, 0, 1e300, 0]), "attitude_xyzw must be four numbers with a norm"),
        (request(attitude_xyzw=[1, 2, 3]), "attitude_xyzw must be 4 finite numbers"),
        (b'{"attitude_xyzw": [0, 0, 0, NaN]}', "attitude_xyzw must be 4 finite numbers"),
        (b'{"attitude_xyzw": [0, 0, 1e400, 1]}', "attitude_xyzw must be 4 finite numbers"),
        (request(attitude_xyzw=[0, 0, 0, 10**400]), "attitude_xyzw must be 4 finite numbers"),
        (request(attitude_xyzw=[0, 0, 0, 1], frame=1.5), "frame must be a whole number"),
        (request(attitude_xyzw=[0, 0, 0, 1], frame=2**63), "number from 0 to 9223372036854775807"),
        (b'{"attitude_xyzw": [0, 0, 0, 1], "time_s": NaN}', "time_s must be a finite number"),
        (
            b'{"attitude_xyzw": [0, 0, 0, 1], "time_s": ' + b"[" * 900 + b"]" * 900 + b"}",
            "time_s must be a finite number",
        ),
        (request(attitude_xyzw=[0, 0, 0, 1], pixels=1), "pixels must be true or false"),
        (request(attitude_xyzw=[0, 0, 0, 1], rate_deg_s=[1]), "rate_deg_s must be 3 finite"),
    ],
)
def test_what_cannot_be_met_is_answered_and_the_next_request_too(asking, line, sentence):
    reply, _ = asking(line)
    assert sentence in reply["error"]
    assert asking(request(attitude_xyzw=[0, 0, 0, 1], frame=0))[0]["frame"] == 0


def test_a_port_that_is_taken_is_wrong_use(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        assert main(["serve", "designs/noise_only.toml", "--port", port]) == 2
    assert "in use" in capsys.readouterr().err
