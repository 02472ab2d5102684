"""A store that is being filled -> its progress and statistic, from time to time."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from startrack.core import arcsec
from startrack.montecarlo.precision import Precision, half_width
from startrack.montecarlo.store import Store

SECONDS = 1.0  # least time between two updates
FRACTION = 0.01  # of the time that updates may take


class Watch:
    """Counts trials as they end, shows the statistic with its interval, and keeps a log.

    The log has one JSON object a line: seconds since the start, trials, trials_per_s, statistic,
    value, low, high (arcsec, or a fraction), confidence, relative_half_width, remaining_s. Numbers
    that are not yet known are null.
    """

    def __init__(
        self,
        store: Store,
        precision: Precision,
        most: int,
        show: Callable[[int, str], None],
        log: Path | None = None,
    ):
        """Begin to watch.

        precision  of which statistic; remaining_s is the time to reach it
        most       trials
        show       called with the number of trials that just ended, and a sentence or nothing
        log        file to append to, made where it is missing
        """
        self._store, self._precision, self._most, self._show = store, precision, most, show
        self._held = sum(len(block) for block in store.done())
        self._began = self._next = time.monotonic()
        if log:
            log.parent.mkdir(parents=True, exist_ok=True)
        self._log = log.open("a", encoding="utf-8") if log else None

    def __call__(self, trials: int) -> None:
        """Count trials that ended; those that failed are not in the store."""
        now = time.monotonic()
        if now < self._next:
            self._show(trials, "")
            return
        values = self.values()
        if self._log:
            self._log.write(json.dumps(values, allow_nan=False) + "\n")
            self._log.flush()
        self._show(trials, _sentence(values))
        self._next = now + max(SECONDS, (time.monotonic() - now) / FRACTION)

    def values(self) -> dict[str, Any]:
        """Progress and statistic now; None for what is not known."""
        seconds = time.monotonic() - self._began
        outcomes = self._store.outcomes()
        done = len(outcomes)
        rate = (done - self._held) / seconds if seconds > 0 else math.inf
        interval = self._precision.interval(outcomes)
        width = half_width(interval)
        unit = 1.0 if self._precision.statistic == "availability" else arcsec
        needed = done * (width / self._precision.relative) ** 2
        left = max(min(needed, self._most) - done, 0.0)
        values = {
            "seconds": seconds,
            "trials": done,
            "trials_per_s": rate,
            "statistic": self._precision.statistic,
            "value": interval.value / unit,
            "low": interval.low / unit,
            "high": interval.high / unit,
            "confidence": self._precision.confidence,
            "relative_half_width": width,
            "remaining_s": left / rate if rate else math.inf,
        }
        return {
            name: None if isinstance(one, float) and not math.isfinite(one) else one
            for name, one in values.items()
        }

    def close(self) -> None:
        """Log the end, and close."""
        if self._log:
            self._log.write(json.dumps(self.values(), allow_nan=False) + "\n")
            self._log.close()
            self._log = None

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _sentence(values: dict[str, Any]) -> str:
    known = {name: "?" if one is None else one for name, one in values.items()}
    numbers = [
        f"{known[name]:.3f}" if known[name] != "?" else "?" for name in ("value", "low", "high")
    ]
    unit = "" if values["statistic"] == "availability" else " arcsec"
    rate = f"{known['trials_per_s']:.0f}/s, " if known["trials_per_s"] != "?" else ""
    return f"{rate}{known['statistic']} {numbers[0]} [{numbers[1]}, {numbers[2]}]{unit}"
