"""What the drives of a simulated robot truly are: friction, rotor and constant of each joint."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from wrenchbed.errors import ParameterError, did_you_mean
from wrenchbed.robots.base import SimulatedRobot

PREFIX = "drive."
"""Names of drives' parameters and faults begin with it."""
_COULOMB: Mapping[str, tuple[float, ...]] = {"ur5": (6.0, 6.5, 4.5, 1.4, 1.2, 1.0)}
"""Friction of direction alone [N·m]; estimates: one third of a UR10e's (recordings of Innopolis
University, doi 10.3389/frobt.2020.571574) to one half."""
_VISCOUS: Mapping[str, tuple[float, ...]] = {"ur5": (8.0, 8.5, 6.5, 1.5, 1.4, 1.2)}
"""Friction per speed [N·m·s/rad]; estimates, as those of `_COULOMB`."""
_CONSTANT: Mapping[str, tuple[float, ...]] = {
    "ur5": (12.6, 12.6, 12.6, 9.3, 9.3, 9.3),
    "medrue": (50.0, 0.5, 0.5, 0.5, 0.5, 0.5),
}
"""Torque per current, gear included [N·m/A; N/A]. UR5: estimate, as its emulator has. MedRUE:
rated 200 N and 2 N·m over 4 A, estimates as the emulated drives have."""
_USUAL_CONSTANT = 10.0
"""Torque per current of an arm that the table lacks [N·m/A]; estimate, between a UR10e's joints."""
_SHARE, _LEAST = 0.04, 0.5
"""Coulomb friction of an arm that nobody states: share of the torque that holds its weight, and no
less than that [N·m or N]; estimates."""
_PER_SPEED = 1.0
"""Viscous over Coulomb friction of such an arm [s/rad or s/m]; estimate."""


@dataclass(frozen=True, eq=False)
class DriveParameters:
    """Drive parameters of all joints (J,); torques in N·m, of slides in N.

    Attributes:
        coulomb: friction that depends on the direction alone.
        viscous: friction per speed.
        offset: constant torque.
        inertia: of the motor at the joint [kg·m² or kg].
        constant: torque per current, gear included [N·m/A or N/A].
    """

    coulomb: np.ndarray
    viscous: np.ndarray
    offset: np.ndarray
    inertia: np.ndarray
    constant: np.ndarray

    @classmethod
    def nominal(
        cls, robot: SimulatedRobot, rotor: np.ndarray, holding: np.ndarray
    ) -> "DriveParameters":
        """Parameters of a robot's drives unless they are given.

        Args:
            robot: friction stands in its MJCF, in the tables here, or follows from ``holding``.
            rotor: the MJCF's inertias (J,).
            holding: largest torques that hold its weight (J,).
        """
        model = robot.spec(robot.parameters.nominal).compile()
        dofs = [int(model.joint(joint.name).dofadr[0]) for joint in robot.joints]
        coulomb, viscous = model.dof_frictionloss[dofs], model.dof_damping[dofs]
        if robot.name in _COULOMB:
            coulomb, viscous = np.array(_COULOMB[robot.name]), np.array(_VISCOUS[robot.name])
        else:
            likely = np.maximum(_SHARE * holding, _LEAST)
            coulomb = np.where(coulomb > 0.0, coulomb, likely)
            viscous = np.where(viscous > 0.0, viscous, _PER_SPEED * likely)
        usual = (_USUAL_CONSTANT,) * len(dofs)
        constant = np.array(_CONSTANT.get(robot.name, usual))
        return cls(coulomb, viscous, np.zeros(len(dofs)), rotor, constant)

    def changed(self, given: Mapping[str, float]) -> "DriveParameters":
        """Parameters with new values by name, ``drive.coulomb.2``: joints count from 1.

        Raises:
            ParameterError: there is no such name, or the value is impossible.
        """
        result = {f.name: np.array(getattr(self, f.name), dtype=float) for f in fields(self)}
        known = [f"{PREFIX}{kind}.{j + 1}" for kind in result for j in range(len(self.coulomb))]
        for name, value in given.items():
            if name not in known:
                raise ParameterError(f"there is no parameter {name!r}{did_you_mean(name, known)}")
            _, kind, joint = name.split(".")
            low = 0.0 if kind in ("coulomb", "viscous", "inertia") else -np.inf
            if not np.isfinite(value) or value < low or (kind == "constant" and value == 0.0):
                raise ParameterError(f"{name} = {value!r} is impossible for a drive")
            result[kind][int(joint) - 1] = value
        return replace(self, **result)


def apart(given: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, Any]]:
    """Values split into parameters of the drives, and all others."""
    drives = {k: v for k, v in given.items() if k.startswith(PREFIX)}
    return drives, {k: v for k, v in given.items() if k not in drives}


def faults_apart(effects: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Texts of faults of the drives, and of all other effects."""
    return (
        tuple(text for text in effects if text.startswith(PREFIX)),
        tuple(text for text in effects if not text.startswith(PREFIX)),
    )
