"""The skies that the tests of identification make."""

from tests.identification.conftest import design, spots_at, towards

__all__ = ["design", "spots_at", "towards"]
