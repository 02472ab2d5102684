"""The process that runs cases: one JSON object a line in, `main` of the command, one out."""

import contextlib
import importlib
import json
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path


def peak() -> int:
    """Largest number of bytes that this process held since the last case."""
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


def _naive_parse(text: str, unit: str) -> float:
    from decimal import Decimal

    from startrack.core import units

    found = units.NUMBER.fullmatch(text)
    assert found
    return float(Decimal(found[1]) * (units._scale(found[2] or "", unit) or Decimal(0)))


def _waits(path: Path, *_: object, **__: object) -> bytes:
    with open(path, "rb") as file:
        return file.read(10**8)


def _nothing(*_: object, **__: object) -> str:
    return ""


def _unguarded(_: object) -> object:
    return contextlib.nullcontext()


def _same(**_: object) -> None:
    return None


def _raises(*_: object, **__: object) -> None:
    raise ZeroDivisionError("division by zero")


def _writes_nan(options: object, result: object, *lines: str) -> None:
    print(json.dumps({"value": math.nan}))


def _takes_memory(*_: object, **__: object) -> None:
    import numpy as np

    from startrack.core import memory

    with memory._data_limit(2**33):
        held = np.ones(2**28)  # 2 GiB
    raise ValueError(f"nothing is found in {held.nbytes} bytes")


def _hangs(*_: object, **__: object) -> None:
    time.sleep(3600)


# Faults put in on purpose: what is put in place of which names.
FAULTS: dict[str, dict[str, object]] = {
    "": {},
    "quantities are not limited": {"startrack.core.parse": _naive_parse},
    "any file is opened": {"startrack.io.toml_file.read_bytes": _waits},
    "long keys are read": {"startrack.io.toml_file._long_key": _nothing},
    "images of any kind are read": {
        "startrack.io.images.read_bytes": _waits,
        "startrack.io.images.regular_file": _nothing,
    },
    "damage of a store escapes": {"startrack.montecarlo.store:Store._damage": _unguarded},
    "trials of other files are mixed": {
        "startrack.montecarlo.store:Store.require_inputs": _nothing
    },
    "a trial divides by zero": {
        "startrack.trial.chain.drawn_outcomes": _raises,
        "startrack.trial.chain.run_trial": _raises,
    },
    "JSON with NaN": {"startrack.cli.requirements.print_result": _writes_nan},
    "memory beyond the limit": {"startrack.detection.detect": _takes_memory},
    "a command that hangs": {"startrack.cli.terminal.open_sky": _hangs},
    "sizes of numbers are not limited": {"startrack.core.moderate": _same},
}


def put_in(fault: str) -> None:
    """Replace the names of a fault."""
    for name, replacement in FAULTS[fault].items():
        path, _, attribute = name.rpartition(".")
        module, _, owner = path.partition(":")
        held = importlib.import_module(module)
        held = getattr(held, owner) if owner else held
        assert hasattr(held, attribute), name
        setattr(held, attribute, replacement)


def growth(designs: int, begun: int = 20) -> float:
    """MiB by which this process grows over a number of designs, after as many as `begun`."""
    from startrack.cli.main import main

    held = 0
    for number in range(designs + begun):
        if number == begun:
            held = resident()
        change = f"instrument.optics.focal_length = {30 + 0.05 * number!r} mm"
        arguments = ["montecarlo", "design.toml", "--trials", "2", "--workers", "1"]
        fidelity = ("frame", "window", "spots", "covariance")[number % 4]
        with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
            main([*arguments, "--fidelity", fidelity, "--set", change.replace(" = ", "=")])
    return (resident() - held) / 2**20


def resident() -> int:
    """Bytes that this process holds."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


# Sizes and steps that no file sets, for less time. Results depend on them: what a worker goes on
# with must come from one, too.
SIZES = {
    "mission.surrogate": ("PLACES", 768),
    "mission.placement": ("GRID", 0.6),
    "response.neighbours": ("GROWTH", 1.5),
}


def made_quick() -> Callable[[list[str]], int]:
    """`main` of the command with these sizes."""
    from startrack.cli.main import main

    for module, (name, size) in SIZES.items():
        held = importlib.import_module(f"startrack.{module}")
        assert hasattr(held, name), name
        setattr(held, name, size)
    return main


def serve() -> None:
    main = made_quick()
    put_in(sys.argv[1] if len(sys.argv) > 1 else "")
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        answers.write(json.dumps(answer(json.loads(line), main)) + "\n")
        answers.flush()


if __name__ == "__main__":
    if sys.argv[1:2] == ["growth"]:
        print(growth(int(sys.argv[2])))
    elif sys.argv[1:2] == ["run"]:
        sys.exit(made_quick()(sys.argv[2:]))
    else:
        serve()
