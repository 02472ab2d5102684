"""Tables of results -> pandas, xarray and astropy, with the units of their columns; or text."""

import re
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from startrack.core import Rows, optional_package

# Units by the names of columns, of all tables of results; other columns have none.
UNITS = (
    (r"(error|sigma|filtered)_.+|across(_.+)?|about(_.+)?|single(_.+)?", "rad"),
    (r"rate", "rad / s"),
    (r"time|reacquisition(_.+)?", "s"),
    (r"losses_per_hour(_.+)?", "1 / h"),
    (r"magnitude", "mag"),
)


def unit_of_column(name: str) -> str:
    """The unit of a column of results; empty without a unit."""
    return next((unit for names, unit in UNITS if re.fullmatch(names, name)), "")


def aligned(rows: Sequence[Sequence[str]], words: Collection[int] | None = None) -> list[str]:
    """Rows of equally many texts as lines with columns of one width, two blanks between them.

    words  indices of the columns that begin at the left, others end at the right; None: all
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.ljust(width) if words is None or i in words else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def table_of(results: Any) -> Rows:
    """The structured array of results: itself, or that which they have as `table`.

    Raises  TypeError if they have no table.
    """
    table = getattr(results, "table", results)
    if not isinstance(table, np.ndarray) or not table.dtype.names:
        raise TypeError(
            "results must be a structured array, as from run_trials, or have one as `table`, as a "
            f"Budget and a Summary, got {type(results).__name__}"
        )
    return np.atleast_1d(table)


def to_pandas(results: Any) -> Any:
    """Results as a pandas DataFrame; the units of its columns are in `attrs["units"]`.

    results  structured array, as from `run_trials` and `sequence.run`, or a Budget or a Summary
    Raises   ImportError without pandas; TypeError for other results.
    """
    columns, units = _columns(results)
    pandas = optional_package("pandas", "to_pandas needs pandas: python -m pip install pandas")
    frame = pandas.DataFrame(columns)
    frame.attrs["units"] = units
    return frame


def to_xarray(results: Any, dimension: str = "row") -> Any:
    """Results as an xarray Dataset of one dimension; each variable has its unit as an attribute.

    results    as for `to_pandas`
    dimension  name of the rows, such as "trial"; where a column has this name, it labels them
    Raises     ImportError without xarray; TypeError for other results.
    """
    columns, units = _columns(results)
    xarray = optional_package("xarray", "to_xarray needs xarray: python -m pip install xarray")
    variables = {
        name: (dimension, column, {"units": units[name]} if name in units else {})
        for name, column in columns.items()
    }
    return xarray.Dataset(variables)


def to_qtable(results: Any) -> Any:
    """Results as an astropy QTable, whose columns with a unit are quantities.

    results  as for `to_pandas`
    Raises   TypeError for other results.
    """
    from astropy.table import QTable
    from astropy.units import Unit

    columns, units = _columns(results)
    return QTable(columns, units={name: Unit(unit) for name, unit in units.items()})


def _columns(results: Any) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """The columns of results by name, and the units of those that have one."""
    table = table_of(results)
    columns = {name: np.ascontiguousarray(table[name]) for name in table.dtype.names or ()}
    return columns, {name: unit for name in columns if (unit := unit_of_column(name))}
