"""Tables of sequences -> accuracy, losses of track and reacquisitions, with intervals."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import special

from startrack.core import Flags, Floats, Rows, arcsec, printed
from startrack.metrics import (
    FALSE_ANGLE,
    Interval,
    fraction_interval,
    interval_table,
    interval_text,
    rms_interval,
)
from startrack.sequence.run import Mode


@printed
@dataclass(frozen=True)
class Tracking:
    """Statistics of many sequences; the intervals hold with 95 % confidence.

    Frames are those of the camera of the design; further heads act through the filter.

    known            fraction of frames after which the filter is within half a degree of the truth
    across, about    radian, rms of the filter's error after these frames if they measured an
                     attitude, per axis across and about the boresight
    single           radian, rms per axis across the boresight of such frames alone
    coasted          radian, rms of the filter's error across while it coasts, of any size
    beyond           fraction of frames after which the filter states an attitude that is half a
                     degree off or more
    worst            radian, largest error of the filter, of all frames and axes together; NaN
                     without an attitude
    losses_per_hour  rate at which a known attitude is dropped or contradicted, per hour; NaN for
                     sequences of one frame, which have no duration, and without a known attitude
    reacquisition    second, mean time from a loss to the next attitude of the frames; losses that
                     last to the end of their sequence are left out
    sequences        number of sequences; the intervals of errors and fractions assume independent
                     sequences, not independent frames
    alignment        radian, rms error per axis of the alignments of further heads, as the filter
                     knows them after the last frame of each sequence; NaN without such heads, or
                     without an attitude
    """

    across: Interval
    about: Interval
    single: Interval
    coasted: Interval
    beyond: Interval
    worst: float
    known: Interval
    losses_per_hour: Interval
    reacquisition: Interval
    sequences: int
    alignment: Interval

    @property
    def table(self) -> Rows:
        """One row: each field, and the ends of its interval as NAME_low and NAME_high."""
        return interval_table(self)

    @property
    def _rows(self) -> list[tuple[str, str]]:
        sizes = (
            ("filter across", self.across, arcsec, "arcsec"),
            ("filter about", self.about, arcsec, "arcsec"),
            ("frames alone, across", self.single, arcsec, "arcsec"),
            ("while it coasts, across", self.coasted, arcsec, "arcsec"),
            ("attitude known", self.known, 0.01, "%"),
            ("losses of track", self.losses_per_hour, 1.0, "per hour"),
            ("from loss to attitude", self.reacquisition, 1.0, "s"),
            ("alignment of further heads", self.alignment, arcsec, "arcsec"),
        )
        rows = [
            (name, interval_text(size, unit, text))
            for name, size, unit, text in sizes
            if not np.isnan(size.value)
        ]
        rows.append(("worst", f"{self.worst / arcsec:.3g} arcsec"))
        return [*rows, ("sequences", str(self.sequences)), ("intervals", "95 %")]


def summarise_sequences(table: Rows) -> Tracking:
    """Statistics of a table as `run` and `fly_sequences` make it."""
    table, further = table[table["head"] == 0], table[table["head"] > 0]
    apart = [table[table["sequence"] == number] for number in np.unique(table["sequence"])]
    last = [further[further["sequence"] == number] for number in np.unique(further["sequence"])]
    last = [rows[rows["time"] == rows["time"].max()] for rows in last]
    hours = sum(float(_span(sequence)) for sequence in apart) / 3600
    lost = [_losses(sequence) for sequence in apart]
    waits = np.array([wait for sequence in lost for wait in sequence])
    known = _fraction(apart, _known)
    return Tracking(
        across=rms_interval(_means(apart, _measured, "filtered_x", "filtered_y")),
        about=rms_interval(_means(apart, _measured, "filtered_z")),
        single=rms_interval(_means(apart, _measured, "error_x", "error_y")),
        coasted=rms_interval(_means(apart, _coasted, "filtered_x", "filtered_y")),
        beyond=_fraction(apart, lambda rows: _error(rows) > FALSE_ANGLE),
        worst=float(np.fmax.reduce(_error(table))),
        known=known,
        losses_per_hour=_rate(len(waits), hours if known.value > 0 else 0.0),
        reacquisition=_mean(waits[np.isfinite(waits)]),
        sequences=len(apart),
        alignment=rms_interval(_means(last, None, *(f"alignment_{axis}" for axis in "xyz"))),
    )


def _measured(sequence: Rows) -> Flags:
    seen = np.isin(sequence["mode"], (Mode.ACQUIRED, Mode.TRACKED))
    return np.asarray(seen & _known(sequence) & ~sequence["false"])


def _coasted(sequence: Rows) -> Flags:
    return np.asarray(sequence["mode"] == Mode.COASTED)


def _error(table: Rows) -> Floats:
    """(frames,) radian, of the filter about all axes; NaN without an attitude."""
    return np.asarray(np.sqrt(sum(table[f"filtered_{axis}"] ** 2 for axis in "xyz")))


def _means(apart: list[Rows], choice: Callable[[Rows], Flags] | None, *names: str) -> Floats:
    """Mean square over the chosen frames (None: all) of each sequence that has such frames."""
    squares = []
    for sequence in apart:
        square = np.mean([sequence[name] ** 2 for name in names], axis=0)
        good = np.isfinite(square)
        if choice:
            good &= choice(sequence)
        if good.any():
            squares.append(float(square[good].mean()))
    return np.array(squares)


def _span(sequence: Rows) -> float:
    """Second: duration of a sequence; its last frame counts as long as the others."""
    time = sequence["time"]
    return float((time[-1] - time[0]) * len(time) / max(len(time) - 1, 1))


def _losses(sequence: Rows) -> list[float]:
    """For each loss of a known attitude, the time to the next attitude; infinite if none
    follows."""
    waits, mode, time = [], sequence["mode"], sequence["time"]
    for k in range(1, len(mode)):
        if mode[k - 1] == Mode.SEARCHING or mode[k] in (Mode.TRACKED, Mode.COASTED):
            continue
        # The loss counts from the last frame that agreed with its prediction.
        seen = np.flatnonzero(np.isin(mode[:k], (Mode.ACQUIRED, Mode.TRACKED)))[-1]
        acquired = np.flatnonzero(mode[k:] == Mode.ACQUIRED)
        waits.append(float(time[k + acquired[0]] - time[seen]) if len(acquired) else np.inf)
    return waits


def _fraction(apart: list[Rows], choice: Callable[[Rows], Flags]) -> Interval:
    """Mean fraction of the chosen frames.

    If all sequences have the same fraction, the bounds are those of other sequences: as many as
    the number of sequences without any leaves possible, with all or none of their frames.
    """
    parts = np.array([float(choice(sequence).mean()) for sequence in apart])
    if np.ptp(parts) > 0:
        mean = _mean(parts)
        return Interval(mean.value, max(mean.low, 0.0), min(mean.high, 1.0))
    same, alike = float(parts[0]), fraction_interval(len(parts), len(parts)).low
    return Interval(same, same * alike, 1 - (1 - same) * alike)


def _known(sequence: Rows) -> Flags:
    return np.asarray(_error(sequence) <= FALSE_ANGLE)  # NaN without an attitude


def _mean(values: Floats) -> Interval:
    """Mean with Student's interval; unbounded for fewer than two values."""
    if len(values) < 2:
        value = float(values[0]) if len(values) else float("nan")
        return Interval(value, -np.inf, np.inf)
    half = special.stdtrit(len(values) - 1, 0.975) * values.std(ddof=1) / len(values) ** 0.5
    mean = float(values.mean())
    return Interval(mean, mean - float(half), mean + float(half))


def _rate(count: int, hours: float) -> Interval:
    """Rate of a Poisson process with its exact interval (Garwood 1936); unbounded at no time."""
    if not hours > 0:
        return Interval(float("nan"), 0.0, np.inf)
    low = special.gammaincinv(count, 0.025) if count else 0.0
    high = special.gammaincinv(count + 1, 0.975)
    return Interval(count / hours, float(low) / hours, float(high) / hours)
