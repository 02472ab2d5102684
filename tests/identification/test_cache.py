"""The file of a pattern index: read where it is ours and whole, otherwise made anew."""

import os

import numpy as np
import pytest

from startrack.core import Stars
from startrack.identification import cache


@pytest.fixture
def stars():
    rng = np.random.default_rng(1)
    direction = rng.standard_normal((60, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return Stars(np.arange(60), direction, np.linspace(1, 5, 60), np.zeros(60))


@pytest.mark.parametrize(
    "change",
    ["none", "cut", "flipped", "anyone's", "group's", "another's", "open", "fifo", "folder"],
)
def test_a_damaged_or_foreign_index_is_made_anew(tmp_path, stars, monkeypatch, change):
    folder = tmp_path / "new"
    first = cache.cached_index(stars, 0.5, folder)
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
    built = []
    build = cache.build_index
    monkeypatch.setattr(cache, "build_index", lambda *key: built.append(key) or build(*key))
    again = cache.cached_index(stars, 0.5, folder)
    assert len(built) == (change != "none")
    for name, array in cache._arrays("", first).items():
        np.testing.assert_array_equal(cache._arrays("", again)[name], array)


def test_a_user_without_a_home_has_a_folder(monkeypatch):
    for name in ("STARTRACK_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def no_home():
        raise RuntimeError("no home")

    monkeypatch.setattr(cache.Path, "home", no_home)
    assert cache.cache_folder().name == f"startrack-{os.getuid()}"
