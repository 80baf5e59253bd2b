"""The closed form at rest through what is compiled, where it is: readings and their Jacobian.

Each method returns None where plain numpy has to do it: `closed_form` then does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wrenchbed.physics.time_derivatives import Value
from wrenchbed.robots.base import STEP, Robot
from wrenchbed.robots.compiled import statics

_DOUBLE = np.dtype(float)
_KEPT = 32
"""Parameter vectors whose constants are kept: a fit compares a few."""
_IDEAL = np.append(np.zeros(6), np.eye(3))
"""Bias and gains of a sensor whose reading is its load."""
_LOAD = slice(3, 8)
"""Constants that are mass, CoG and the sensor's own mass, by definition in `_statics.c`."""


@dataclass(frozen=True, eq=False)
class CompiledForm:
    """A robot and its sensor under gravity (3,) [m/s²], by constants that C functions take."""

    robot: Robot
    gravity: tuple[float, ...]
    _kept: dict[tuple[bytes, ...], bytes] = field(init=False, repr=False, default_factory=dict)

    def readings(
        self, q: Value, theta: np.ndarray, at: np.ndarray, sensed: bool
    ) -> np.ndarray | None:
        """`Model.predict`, or `Model.true_wrench` if not sensed, the pose by parameters ``at``."""
        name = self.robot.compiled
        if not statics.available(name) or not self._takes(q, theta, at):
            return None
        if theta.ndim == 1:
            return statics.readings(name, q, self._of_one(theta, at, sensed))
        every = self.constants(theta[:, 0], at[:, 0], sensed)
        return np.stack([statics.readings(name, q, each.tobytes()) for each in every])

    def gravity_seen(self, q: Value, at: np.ndarray) -> np.ndarray | None:
        """Force on a tool of 1 kg, as `Model.gravity_seen` gives it."""
        name = self.robot.compiled
        if not statics.available(name) or at.ndim > 1 or not self._takes(q, at, at):
            return None
        constants = self._of_one(at, at, sensed=False, unit=True)
        return statics.readings(name, q, constants)[:, :3]

    def jacobian(self, q: Value, theta: np.ndarray, columns: Sequence[int]) -> np.ndarray | None:
        """`Model.jacobian`: slopes by the constants; complex steps of the constants alone."""
        name = self.robot.compiled
        if not statics.available(name, slopes=True) or not self._takes(q, theta, theta):
            return None
        shifted = np.repeat(theta.astype(complex).reshape(-1, 1, theta.shape[-1]), len(columns), 1)
        shifted[:, np.arange(len(columns)), list(columns)] += 1j * STEP
        changes = self.constants(shifted, shifted, sensed=True).imag / STEP
        if theta.ndim == 1:
            slopes = statics.slopes(name, q, self._of_one(theta, theta, True), changes[0])
        else:
            every = self.constants(theta[:, 0], theta[:, 0], sensed=True)
            each = zip(every, changes, strict=True)
            slopes = np.stack([statics.slopes(name, q, p.tobytes(), d) for p, d in each])
        return np.moveaxis(slopes, -3, -1)

    def _of_one(self, theta: np.ndarray, at: np.ndarray, sensed: bool, unit: bool = False) -> bytes:
        """Constants of one vector, kept: of one pose they take longer than the wrench.

        Args:
            unit: of a tool of 1 kg, at the sensor's origin, and no other.
        """
        given = b"1" * sensed + b"0" * unit
        key = (theta.tobytes(), at.tobytes() if at is not theta else b"", given)
        constants = self._kept.get(key)
        if constants is None:
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            numbers = self.constants(theta, at, sensed)
            if unit:
                numbers[_LOAD] = (1.0, 0.0, 0.0, 0.0, 0.0)
            constants = self._kept[key] = numbers.tobytes()
        return constants

    def constants(self, theta: np.ndarray, at: np.ndarray, sensed: bool) -> np.ndarray:
        """Constants (…, C) in the order of `_statics.c` for parameters (…, P)."""
        own = len(self.robot.parameters)
        packed = self.robot.packed(at[..., :own], np.asarray(self.gravity))
        tool = self.robot.tool(theta[..., :own])
        sensor = theta[..., own:] if sensed else _IDEAL
        parts = (
            packed.gravity, tool.mass[..., None], tool.cog, tool.sensor_mass[..., None],
            packed.last.reshape(*packed.last.shape[:-2], 9), sensor[..., 6:], sensor[..., :6],
            packed.own,
        )  # fmt: skip
        rows = theta.shape[:-1]
        return np.concatenate([np.broadcast_to(x, (*rows, x.shape[-1])) for x in parts], axis=-1)

    def _takes(self, q: Value, theta: np.ndarray, at: np.ndarray) -> bool:
        """Whether joint values are real (N, J), parameters real (P,) or, for many robots, (R, 1,
        P)."""
        if not isinstance(q, np.ndarray) or q.ndim != 2 or q.shape[1] != len(self.robot.joints):
            return False
        many = self.robot.broadcasts and theta.ndim == 3 and theta.shape[1] == 1
        native = q.dtype == theta.dtype == at.dtype == _DOUBLE
        return native and theta.shape == at.shape and (theta.ndim == 1 or many)
