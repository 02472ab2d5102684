"""Only one process at a time writes to a folder of results."""

import os
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from startrack.core import Frame
from startrack.io import FrameFiles, claimed_folder, save_figure, save_text
from startrack.io.saving import NAME, note_owner, owner, whole


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
        [sys.executable, "-c", HOLD, str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
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


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("true")])
def test_notes_and_claims_neither_wait_nor_follow(tmp_path, make):
    """Existing files of their names stay, whoever created them."""
    (tmp_path / "true").write_text("words")
    make(tmp_path / "store-process")
    note_owner(tmp_path / "store")
    assert owner(tmp_path / "store") == ""
    make(tmp_path / NAME)
    with pytest.raises((OSError, ValueError), match=NAME), claimed_folder(tmp_path):
        pass
    assert (tmp_path / "true").read_text() == "words"


def test_a_file_takes_the_place_of_files_only(tmp_path):
    """A link stays and its file is replaced; a FIFO and a terminal get the bytes."""
    true, link, fifo = (tmp_path / name for name in ("true.txt", "link.txt", "fifo.txt"))
    link.symlink_to(true)
    save_text(link, "first")
    save_text(link, "second")
    assert link.is_symlink()
    assert true.read_text() == "second"
    os.mkfifo(fifo)
    reader = subprocess.Popen(["cat", str(fifo)], stdout=subprocess.PIPE, text=True)
    save_text(fifo, "words")
    assert reader.communicate(timeout=60)[0] == "words"
    assert fifo.is_fifo()
    held, terminal = os.openpty()
    save_text(Path(os.ttyname(terminal)), "more words")
    assert os.read(held, 100) == b"more words"
    for number in (held, terminal):
        os.close(number)
    save_text(Path("/dev/null"), "words")
    assert Path("/dev/null").is_char_device()
    files = FrameFiles(tmp_path, "link", "raw", datetime(2026, 1, 1, tzinfo=UTC))
    (tmp_path / "link-2x1-uint8.raw").symlink_to(true)
    files.add(Frame(np.array([[65, 66]], np.uint8)), 0.0, Rotation.identity())
    files.close()
    assert (tmp_path / "link-2x1-uint8.raw").is_symlink()
    assert true.read_text() == "AB"
    with pytest.raises(OSError, match="must be a file, a new name or a stream, but is a folder"):
        save_text(tmp_path, "words")
    for name in ("a", "b"):
        (tmp_path / name).symlink_to(tmp_path / ("b" if name == "a" else "a"))
    with pytest.raises(OSError, match="Too many levels of symbolic links"):
        save_text(tmp_path / "a", "words")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a",
        "b",
        "fifo.txt",
        "link-2x1-uint8.raw",
        "link.csv",
        "link.txt",
        "true.txt",
    ]


def save_by_numpy(path):
    with whole(path) as draft:
        np.zeros(10_000).tofile(draft)


@pytest.mark.parametrize("save", [save_by_numpy, lambda path: save_text(path, 10_000 * "x")])
def test_a_file_that_cannot_be_written_completely_is_named(tmp_path, save):
    """A limit of the size of files stands for a full disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError, match=r"frame\.raw must be written completely"):
            save(tmp_path / "frame.raw")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(tmp_path.iterdir()) == []


def test_drafts_have_new_names_and_follow_no_links(tmp_path, monkeypatch):
    """A link with the name of the draft, created by somebody else, is not followed."""
    path, victim = tmp_path / "frame.fits", tmp_path / "victim"
    victim.write_text("precious")
    names = set()
    for _ in range(5):
        with whole(path) as draft:
            names.add(draft.name)
            assert draft.suffix == ".fits"
            draft.write_text("new")
    assert len(names) == 5
    monkeypatch.setattr("secrets.token_hex", lambda _: "known")
    with whole(path) as draft:
        foreseen = draft
    foreseen.symlink_to(victim)
    with pytest.raises(FileExistsError), whole(path):
        pytest.fail("opened what stands there")
    assert victim.read_text() == "precious"


def test_a_new_file_has_the_rights_that_the_umask_leaves(tmp_path):
    before = os.umask(0o027)
    try:
        save_text(tmp_path / "a.txt", "text")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_what_a_process_has_open_goes_on_where_it_is(tmp_path):
    """Like standard output that goes to a file: it is not begun again."""
    with (tmp_path / "out").open("w+b", buffering=0) as file:
        file.write(b"before ")
        save_text(Path(f"/proc/self/fd/{file.fileno()}"), "words")
        file.write(b" after")
    assert (tmp_path / "out").read_bytes() == b"before words after"
