"""Results kept between commands: the same from a file, computed again if an input changes."""

import os
from dataclasses import replace

import numpy as np
import pytest

from startrack.budget import Term
from startrack.catalog import Selection
from startrack.core import Stars, interpreted, interpreting
from startrack.io import cache, recalled
from startrack.metrics import Interval

MADE = []  # arguments of the calls that computed


@recalled
def long_sum(selection: Selection, times: int, progress=None) -> tuple[Interval, float]:
    """A sum that counts as a long computation."""
    MADE.append((selection, times))
    return Interval(1.0, 0.5, times), float(times)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("STARTRACK_CACHE", str(tmp_path / "new"))
    monkeypatch.setattr(cache, "LONG", 0.0)
    monkeypatch.setattr(cache, "interpreting", interpreting)
    MADE.clear()


def everything():
    """A value of each kind that a file can hold."""
    rng = np.random.default_rng(1)
    stars = Stars(np.arange(4), rng.random((4, 3)), rng.random(4), np.full(4, np.nan))
    return {
        "stars": stars,
        Term.NOISE: (1, 2.5, True, None, "text", float("inf")),
        "interval": [Interval(0.1, 0.2, 0.3)],
        "numbers": (
            np.float32(0.1),
            np.int64(2**62),
            rng.random((3, 4)).T,
            rng.random((4, 6))[:, ::2],
        ),
        "texts": np.array(["a", "bc"]),
        "nothing": (),
    }


def test_every_kind_of_value_is_read_as_it_was_written(tmp_path):
    value = everything()
    made = cache.from_cache("all", "key", everything, 9, folder=tmp_path)
    read = cache.from_cache("all", "key", pytest.fail, 9, folder=tmp_path)
    assert [*map(type, value)] == [*map(type, read)]
    for other in (made, read):
        np.testing.assert_equal(vars(other["stars"]), vars(value["stars"]))
        for name in (Term.NOISE, "interval", "nothing"):
            assert other[name] == value[name]
        for part, whole in zip(other["numbers"], value["numbers"], strict=True):
            assert type(part) is type(whole)
            assert part.dtype == whole.dtype
            np.testing.assert_array_equal(part, whole)
    # Kernels and sums take arrays as they lie in memory, which must not depend on the file.
    for part, again in zip(made["numbers"][2:], read["numbers"][2:], strict=True):
        assert part.strides == again.strides


@pytest.mark.parametrize("value", [{1, 2}, np.array([None]), lambda: 0, {"inner": object()}])
def test_what_a_file_cannot_hold_is_refused(tmp_path, value):
    with pytest.raises(TypeError, match="a kept result must consist of"):
        cache.from_cache("bad", "key", lambda: value, 9, folder=tmp_path)


def test_a_result_is_computed_once_for_each_input(tmp_path):
    sky = Selection()
    first = long_sum(sky, 2, progress=print)
    assert long_sum(Selection(), 2) == first
    assert len(MADE) == 1
    others = [replace(sky, limit_g=6.0), replace(sky, epoch=2027.0), replace(sky, parallax=True)]
    for other in others:
        long_sum(other, 2)
    long_sum(sky, 3)
    assert len(MADE) == 5
    file = tmp_path / "stars.csv"
    file.write_text("ra,dec,magnitude_g\n1,2,3\n")
    of_file = Selection(str(file))
    assert long_sum(of_file, 2) == long_sum(of_file, 2)
    assert len(MADE) == 6
    file.write_text("ra,dec,magnitude_g\n1,2,4\n")  # of the same length
    long_sum(of_file, 2)
    assert len(MADE) == 7


def test_other_sources_or_packages_compute_anew(monkeypatch):
    long_sum(Selection(), 2)
    monkeypatch.setattr(cache, "_versions", lambda: "of tomorrow")
    long_sum(Selection(), 2)
    assert len(MADE) == 2


def test_what_python_code_of_kernels_computes_is_not_kept():
    with interpreted(lambda: True):
        long_sum(Selection(), 2)
    long_sum(Selection(), 2)
    assert len(MADE) == 2


def test_what_is_quick_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "LONG", 60.0)
    long_sum(Selection(), 2)
    long_sum(Selection(), 2)
    assert len(MADE) == 2
    assert not (tmp_path / "new").exists()


def test_an_argument_whose_value_is_no_text_is_refused():
    with pytest.raises(TypeError, match="must depend on parameters and numbers"):
        long_sum(np.zeros(3), 2)


def test_files_used_last_are_kept(tmp_path):
    for number in range(3):
        cache.from_cache("some", str(number), lambda: 1, 9, folder=tmp_path)
    for number, file in enumerate(sorted(tmp_path.iterdir(), key=os.path.getmtime)):
        os.utime(file, (number, number))
    cache.from_cache("some", "0", pytest.fail, 9, folder=tmp_path)  # which uses it
    cache.from_cache("some", "new", lambda: 1, 2, folder=tmp_path)
    assert len([*tmp_path.iterdir()]) == 2
    cache.from_cache("some", "0", pytest.fail, 9, folder=tmp_path)


@pytest.mark.parametrize(
    "change",
    ["none", "cut", "flipped", "anyone's", "group's", "another's", "open", "fifo", "folder"],
)
def test_a_damaged_or_foreign_file_is_made_anew(tmp_path, change):
    folder, array = tmp_path / "new", np.arange(600.0)
    cache.from_cache("some", "key", lambda: array, 9, folder=folder)
    (file,) = folder.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    data = file.read_bytes()
    if change == "cut":
        file.write_bytes(data[: len(data) // 2])
    elif change == "flipped":
        middle = len(data) // 2
        file.write_bytes(data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :])
    elif change == "anyone's":
        file.chmod(0o666)
    elif change == "group's":
        file.chmod(0o660)
    elif change == "open":
        folder.chmod(0o777)
    elif change in ("fifo", "folder"):
        file.unlink()
        (os.mkfifo if change == "fifo" else os.mkdir)(file)
    elif change == "another's":
        if os.geteuid():
            pytest.skip("only root can give a file away")
        os.chown(file, 65534, 65534)
    made = []
    again = cache.from_cache("some", "key", lambda: made.append(1) or array, 9, folder=folder)
    assert len(made) == (change != "none")
    np.testing.assert_array_equal(again, array)


def test_a_file_names_no_class_of_another_package():
    arrays = cache.packed(Interval(0.1, 0.2, 0.3))
    written = str(arrays["of"])
    for name in ("os:system", "subprocess:Popen"):
        kind = f"{Interval.__module__}:{Interval.__qualname__}"
        with pytest.raises(ValueError, match="must consist of classes of startrack"):
            cache.unpacked(arrays | {"of": np.array(written.replace(kind, name))})


def test_a_user_without_a_home_has_a_folder(monkeypatch):
    for name in ("STARTRACK_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def no_home():
        raise RuntimeError("no home")

    monkeypatch.setattr(cache.Path, "home", no_home)
    assert cache.cache_folder().name == f"startrack-{os.getuid()}"
