"""The trials of a campaign as files that other programs read; angles in radian."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from startrack.io import save_csv, whole


def export(path: Path, outcomes: NDArray[np.void]) -> None:
    """Write CSV or Parquet, as the name ends.

    Raises  ValueError for another ending; ImportError for Parquet without pyarrow.
    """
    if path.suffix == ".csv":
        save_csv(path, outcomes.dtype.names or (), (row.item() for row in outcomes))
    elif path.suffix == ".parquet":
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError:
            raise ImportError("Parquet needs pyarrow: python -m pip install pyarrow") from None
        names = outcomes.dtype.names or ()
        columns = {name: np.ascontiguousarray(outcomes[name]) for name in names}
        with whole(path) as draft:
            pyarrow.parquet.write_table(pyarrow.table(columns), draft)
    else:
        raise ValueError(f"the table's name must end in .csv or .parquet, got {path.name}")
