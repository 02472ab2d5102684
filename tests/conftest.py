"""What the tests share: outside data, and a small design that runs in milliseconds."""

import json
import os
from pathlib import Path

import pytest

ORACLE = Path(__file__).parent / "oracle"
collect_ignore = ["oracle"]  # scripts that need what the tests do not


@pytest.fixture(scope="session", autouse=True)
def _no_cache_but_ours(tmp_path_factory):
    """Indexes that the tests build stay out of the user's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STARTRACK_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def outside() -> Path:
    """The folder of data from outside, which is not part of the project."""
    folder = os.environ.get("STARTRACK_DATA")
    if not folder:
        pytest.skip("STARTRACK_DATA does not name the folder of outside data")
    return Path(folder)


@pytest.fixture(scope="session")
def oracle():
    """Reads a file of answers from outside."""
    return lambda name: json.loads((ORACLE / name).read_text())
