"""Rows and tables of results: JSON, text, Markdown and cells say the same."""

import json
import math

from startrack.core import arcsec
from startrack.metrics import (
    ARCSEC,
    PERCENT,
    Column,
    Interval,
    Row,
    Table,
    bracketed,
    end_text,
    markdown,
    to_cells,
    to_json,
    to_lines,
)

ROWS = [
    Row("across_rms_arcsec", Interval(2 * arcsec, arcsec, math.inf), "across", ARCSEC, note="rms"),
    Row("availability", Interval(0.5, 0.25, 0.75), "availability", PERCENT, ".1f"),
    Row("trials", 7, "trials", form="d"),
    Row("status", "solved"),
    Row("", math.nan, "not in JSON"),
]
SHAPES = Table(
    [
        Column("", "name", lambda shape: shape[0]),
        Column("angle_arcsec", "angle", lambda shape: shape[1], ARCSEC, ".2f"),
        Column("sides", "", lambda shape: shape[2]),
    ],
    [("line", 3 * arcsec, 1), ("square", Interval(arcsec, 0.0, 2 * arcsec), 4)],
)


def test_rows_of_json_have_their_units_and_bounds():
    fields = to_json(ROWS)
    assert list(fields) == [
        "across_rms_arcsec",
        "across_rms_arcsec_95",
        "availability",
        "availability_95",
        "trials",
        "status",
    ]
    assert fields["across_rms_arcsec"] == 2
    assert fields["across_rms_arcsec_95"] == [1, math.inf]
    assert fields["availability_95"] == [0.25, 0.75]
    assert json.dumps(fields["trials"]) == "7"


def test_an_infinite_end_is_open_in_every_form():
    interval = Interval(2 * arcsec, arcsec, math.inf)
    assert bracketed(interval, ".3f", arcsec) == "2.000 [1.000, open]"
    assert (end_text(math.inf, ".4g"), end_text(math.nan, ".1f")) == ("open", "unknown")


def test_lines_have_label_value_unit_bounds_and_note():
    assert to_lines(ROWS) == [
        "across          2.000 arcsec [1.000, open] rms",
        "availability     50.0 % [25.0, 75.0]",
        "trials              7",
        "not in JSON   unknown",
    ]


def test_cells_are_those_of_intervals():
    assert to_cells(ROWS) == [
        ["across, rms", "2", "1", "open", "arcsec"],
        ["availability", "50", "25", "75", "%"],
    ]


def test_a_table_is_written_in_each_form():
    assert SHAPES.json() == [
        {"angle_arcsec": 3.0, "sides": 1},
        {"angle_arcsec": 1.0, "angle_arcsec_95": [0.0, 2.0], "sides": 4},
    ]
    assert SHAPES.text() == [
        "name       angle (arcsec)",
        "line                 3.00",
        "square  1.00 [0.00, 2.00]",
    ]
    assert SHAPES.markdown() == [
        "| name | angle (arcsec) |",
        "|---|---|",
        "| line | 3.00 |",
        "| square | 1.00 [0.00, 2.00] |",
    ]


def test_an_empty_cell_of_markdown_is_one_blank():
    assert markdown(["", "a"], [["b", ""]]) == ["| | a |", "|---|---|", "| b | |"]
