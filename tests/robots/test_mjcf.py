"""Rotations in an MJCF: those of the library of rotations, bit by bit."""

import numpy as np

from wrenchbed.physics.rotations import euler, quaternion, rot_x
from wrenchbed.robots.medrue.robot import MedRUE
from wrenchbed.robots.mjcf import bare, place


def test_bodies_get_the_quaternion_of_their_rotation() -> None:
    spec, rng = bare(MedRUE().mjcf), np.random.default_rng(0)
    turns = [euler(*angles) for angles in rng.uniform(-4.0, 4.0, (200, 3))]
    for turn in [*turns, np.eye(3), rot_x(3.1), euler(3.1, 0.1, 0.0), euler(0.0, 3.1, 0.1)]:
        place(spec, "base", [0.0, 0.0, 0.0], turn)
        assert np.array_equal(spec.body("base").quat, quaternion(turn))
