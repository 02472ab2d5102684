"""Which software and which machine made the numbers."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version

import startrack

PACKAGES = ("numpy", "scipy", "numba", "astropy", "opencv-contrib-python-headless")


def origin() -> dict[str, str]:
    """Versions and machine, as text."""
    return {
        "startrack": startrack.__version__,
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "system": platform.platform(),
        "machine": platform.machine(),
        "processor": platform.processor(),
        "cores": str(os.cpu_count()),
    }
