"""Simulated sequences -> the error indices of the standard, over members and times."""

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np

from startrack.budget.budget import Line, Sample
from startrack.core import Refused
from startrack.design import Case
from startrack.metrics import indices
from startrack.sequence import Sequence, fly_sequences

# A star tracker's output is knowledge; of a platform that points by it the same are APE, MPE, RPE
# and PDE (ECSS-E-ST-60-10C, 3.2).
INDICES: dict[str, str] = {
    "AKE": "absolute knowledge error: the error itself",
    "MKE": "mean knowledge error over each window",
    "RKE": "relative knowledge error: the error less its window's mean",
    "KDE": "knowledge drift error: a window's mean less that of the one before",
}


def indices_of(
    case: Case,
    sequence: Sequence,
    members: int,
    seed: int,
    window: float,
    executor: Executor,
    progress: Callable[[int], None] | None = None,
) -> dict[str, Line[Sample]]:
    """The indices of the attitudes of single frames, over sequences of random attitudes.

    window   second
    Returns  AKE, MKE, RKE and KDE (see `INDICES`), each a line whose sample has a member for each
             sequence
    Raises   ValueError where the window does not fit twice, or no sequence was solved in enough
             frames. Frames without an attitude are left out of all sequences, so that the windows
             of all members are the same.
    """
    table = fly_sequences(case, sequence, members, seed, executor, progress)
    frames = len(table) // members
    error = np.stack([table[f"error_{axis}"] for axis in "xyz"], axis=-1).reshape(
        members, frames, 3
    )
    error[table["false"].reshape(members, frames)] = np.nan
    time = table["time"].reshape(members, frames)[0]
    seen = np.all(np.isfinite(error), axis=(0, 2))
    run = _longest(seen)
    if run.stop - run.start < 2:
        raise Refused(f"a sequence must be solved in frames in a row, got {int(seen.sum())} frames")
    step = float(np.diff(time).mean())
    each = [indices(one, step, window) for one in error[:, run]]
    if not len(each[0].drift):
        raise Refused(
            f"window must fit twice into the {run.stop - run.start} frames in a row that all "
            f"sequences were solved in, {step:g} s apart, got {window:g} s"
        )
    return {
        name: Line(name, None, Sample(np.stack([getattr(one, part) for one in each])))
        for name, part in zip(INDICES, ("absolute", "mean", "relative", "drift"), strict=True)
    }


def _longest(good: np.ndarray) -> slice:
    """The longest run of True."""
    edge = np.diff(np.concatenate([[0], good.astype(int), [0]]))
    starts, ends = np.flatnonzero(edge > 0), np.flatnonzero(edge < 0)
    if not len(starts):
        return slice(0, 0)
    k = int(np.argmax(ends - starts))
    return slice(int(starts[k]), int(ends[k]))
