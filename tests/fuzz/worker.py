"""The process that runs cases: one JSON object a line in, `main` of the command, one out."""

import json
import os
import sys
import time
from pathlib import Path


def peak() -> int:
    """Bytes that this process held at most since the last case."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])


def answer(case: dict, main) -> dict:
    os.chdir(case["folder"])
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    held, began = peak(), time.monotonic()
    saved = [os.dup(1), os.dup(2)]
    for number, name in ((1, "out.txt"), (2, "err.txt")):
        target = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(target, number)
        os.close(target)
    escaped = ""
    try:
        status = main(case["arguments"])
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
    except BaseException as error:
        status, escaped = 70, f"{type(error).__name__}: {error}"
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        for number, kept in zip((1, 2), saved, strict=True):
            os.dup2(kept, number)
            os.close(kept)
    return {
        "status": status,
        "escaped": escaped,
        "seconds": time.monotonic() - began,
        "bytes": peak() - held,
    }


def serve() -> None:
    from startrack.cli.main import main

    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        answers.write(json.dumps(answer(json.loads(line), main)) + "\n")
        answers.flush()


if __name__ == "__main__":
    serve()
