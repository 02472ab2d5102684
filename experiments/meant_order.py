"""Plug-in of pytest that shuffles all tests: python -m pytest -p meant_order, seed in ORDER."""

import os
import random
from typing import Any


def pytest_collection_modifyitems(items: list[Any]) -> None:
    """Shuffle tests, in the same order in each worker of a run."""
    random.Random(os.environ.get("ORDER", "1")).shuffle(items)
