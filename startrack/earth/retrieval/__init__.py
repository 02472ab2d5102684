"""Retrievals of Earth cameras."""
