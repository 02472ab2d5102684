"""The simulated sky of the tests of detection."""

from tests.detection.conftest import sky

__all__ = ["sky"]
