"""Text and tables as spreadsheets and other programs save them."""

import csv
import io

import numpy as np
import pytest

from startrack.core import Refused
from startrack.io.text import csv_table, decoded
from startrack.io.toml_file import read_table

VALUES = [(1, 57.25, -0.5), (2, 18.75, 1e-3), (3, 255.5, 12.0)]


def written(delimiter: str, comma: bool) -> str:
    """By the csv module of Python."""
    file = io.StringIO()
    writer = csv.writer(file, delimiter=delimiter)
    writer.writerow(["id", "Ra", "dec"])
    for number, *values in VALUES:
        texts = [repr(value).replace(".", "," if comma else ".") for value in values]
        writer.writerow([number, *texts])
    return file.getvalue()


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
def test_a_table_of_any_locale_has_its_numbers(tmp_path, coding, delimiter, comma):
    path = tmp_path / "a.csv"
    path.write_bytes(written(delimiter, comma).encode(coding))
    table = csv_table(path)
    assert table.colnames == ["id", "ra", "dec"]
    got = np.array([table[name] for name in table.colnames]).T
    np.testing.assert_allclose(got, VALUES)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a;b\n1,5;2.5\n", "decimal points or decimal commas, not both, got 2.5 and 1,5"),
        ("a;b\n1.234,5;2,5\n", "without groups of digits, got 1.234,5"),
        ("a,b\n1,5,2,5\n", "comma-separated rows"),
        ("a,b\n1\n", "comma-separated rows"),
        ("", "empty file"),
    ],
)
def test_numbers_that_can_be_read_two_ways_are_refused(tmp_path, text, words):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(Refused, match=words):
        csv_table(path)


@pytest.mark.parametrize("head", ["ra,x,x", "ra,X,x", 'ra,"x", x'])
def test_two_columns_of_one_name_are_refused(tmp_path, head):
    path = tmp_path / "stars.csv"
    path.write_text(f"{head}\n1,2,3\n")
    with pytest.raises(Refused, match="must have one column 'x', got 2"):
        csv_table(path)


def test_names_keep_their_commas(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('name;ra\n"one, two";1,5\nthree, four;2,5\n')
    table = csv_table(path)
    assert list(table["name"]) == ["one, two", "three, four"]
    assert list(table["ra"]) == [1.5, 2.5]


def test_letters_of_one_byte_are_read_and_zeros_are_not(tmp_path):
    assert decoded("µm".encode("latin-1"), tmp_path) == "µm"
    with pytest.raises(Refused, match="zero byte at 2"):
        decoded(b"ab\0cdefgh", tmp_path)


def test_a_design_file_of_windows_has_its_first_key(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("first = 1\n", encoding="utf-8-sig")
    assert read_table(path, "a file") == {"first": 1}
