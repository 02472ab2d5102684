"""Rotations of matrices against scipy's own."""

import numpy as np
from scipy.spatial.transform import Rotation

from startrack.core.rotations import rotation_of


def turns():
    """Half turns about all axes, where one component is largest and others vanish, and random
    turns."""
    halves = Rotation.from_rotvec(np.pi * np.eye(3))
    whole = Rotation.identity(1)
    return Rotation.concatenate([halves, whole, Rotation.random(40, rng=np.random.default_rng(14))])


def test_a_rotation_is_its_matrix_s():
    for turn in turns():
        assert (rotation_of(turn.as_matrix()) * turn.inv()).magnitude() < 1e-14


def test_many_are_each_its_own():
    many = rotation_of(turns().as_matrix())
    assert len(many) == 44
    assert (many * turns().inv()).magnitude().max() < 1e-14
