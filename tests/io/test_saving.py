"""A folder of results is written to by one process at a time."""

import subprocess
import sys

import matplotlib.pyplot as plt
import pytest

from startrack.io import claimed_folder, save_figure


@pytest.mark.parametrize("name", ["no\udcfftext", r"$\frac{", "a $b$", "star\x07"])
def test_any_name_of_a_file_may_stand_in_a_title(tmp_path, name):
    figure, axes = plt.subplots(figsize=(2, 2))
    axes.set_title(name)
    axes.set_xscale("log")
    figure.suptitle(name)
    save_figure(tmp_path / "any.png", figure)
    plt.close(figure)
    assert (tmp_path / "any.png").stat().st_size > 1000


HOLD = """
import sys
from pathlib import Path
from startrack.io import claimed_folder
from startrack.io.saving import whole
with claimed_folder(Path(sys.argv[1])), whole(Path(sys.argv[1]) / "frame.fits") as draft:
    draft.write_text("half")
    print("held", flush=True)
    sys.stdin.read()
"""


def test_the_second_process_is_told_of_the_first(tmp_path):
    folder = tmp_path / "out"
    first = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    try:
        assert first.stdout.readline() == "held\n"
        words = rf"out is in use by another process, {first.pid} on .* since 20\d\d-"
        with pytest.raises(OSError, match=words), claimed_folder(folder):
            pass
    finally:
        first.kill()
        first.communicate()
    assert len(list(folder.glob(".frame.*.fits"))) == 1
    with claimed_folder(folder):  # the note and the draft of the killed process stand for nothing
        (folder / "result").write_text("x")
    assert [path.name for path in folder.iterdir()] == ["result"]


def test_a_folder_that_nothing_was_written_to_is_not_left_behind(tmp_path):
    with claimed_folder(tmp_path / "out"):
        pass
    assert not (tmp_path / "out").exists()
