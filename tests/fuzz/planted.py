"""Faults put into the package on purpose -> whether the cases find them."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz.arena import Case, Verdict
from tests.fuzz.campaign import Enough, run_cases
from tests.fuzz.grammar import (
    Kind,
    campaign_case,
    catalog_case,
    design_case,
    image_case,
    replaced_case,
    scene_case,
    special_case,
    store_case,
    text_case,
)

MOST = 400  # cases in which a fault must show
# Where a fault of `worker.FAULTS` shows, so that it is found soon; and what it may be called then.
SHOWN: dict[str, tuple[Kind, str]] = {
    "quantities are not limited": (design_case, "traceback"),
    "any file is opened": (special_case, "hang"),
    "long keys are read": (text_case, "hang memory traceback"),
    "images of any kind are read": (special_case, "hang"),
    "damage of a store escapes": (store_case, "traceback"),
    "trials of other files are mixed": (replaced_case, "silent_difference"),
    "a trial divides by zero": (design_case, "traceback"),
    "JSON with NaN": (campaign_case, "silent_nan"),
    "memory beyond the limit": (image_case, "memory"),
    "a command that hangs": (catalog_case, "hang"),
    "sizes of numbers are not limited": (scene_case, "traceback silent_nan memory"),
}


def is_found(fault: str, seed: int, compiled: Path | None = None) -> bool:
    """Whether so many cases of the kind in which a fault shows find it, by one of its names.

    compiled  as of `Arena`
    """
    kind, names = SHOWN[fault]
    found: list[str] = []

    def report(_: Case, verdict: Verdict) -> None:
        if verdict.fault in names.split():
            found.append(verdict.fault)
            raise Enough

    run_cases(
        MOST,
        seed,
        report,
        seconds=3.0 if "long" in fault else 10.0,
        kinds=(kind,),
        fault=fault,
        primed=False,
        compiled=compiled,
    )
    return bool(found)
