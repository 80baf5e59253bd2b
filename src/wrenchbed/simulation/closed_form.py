"""The closed form: a robot and its sensor as formulas, with exact Jacobians, to fit with.

Its counterpart is `mujoco_wrench`: the same robot in MuJoCo. Tests compare the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import Recording
from wrenchbed.errors import NotFoundError, PlanError, RecordingError
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.rigid_load_regressor import Motion, load
from wrenchbed.physics.rotations import rotation_vector
from wrenchbed.physics.taylor_jets import STEP, Jet, Value, value
from wrenchbed.physics.wrench import CHANNELS, UNITS, weight
from wrenchbed.robots.base import INERTIA_AXES, Robot, complex_steps
from wrenchbed.robots.compiled import statics
from wrenchbed.robots.oriented import ROBOT as ORIENTED

_DOUBLE = np.dtype(float)
_KEPT = 32
"""Parameter vectors whose constants for C are cached: a fit compares a few."""
_IDEAL = np.append(np.zeros(6), np.eye(3))
"""Bias and gains of a sensor whose reading is its load."""
_AT_ONCE = 8000
"""Poses times parameters per evaluation of derivatives: what a processor's cache holds."""
_LOAD = slice(3, 8)
"""Positions of mass, CoG and the sensor's own mass among the C constants, see `_statics.c`."""
_PAST_LIMIT = 0.01
"""Share of a joint's range that an encoder may read beyond a limit: a servo swings over."""


def _sensor_parameters() -> ParameterSet:
    bias = [
        Parameter(f"sensor.bias.{c}", 0.0, u, 1.0 if u == "N" else 0.05, -1e4, 1e4, "zero offset")
        for c, u in zip(CHANNELS, UNITS, strict=True)
    ]
    gain = [
        Parameter(
            f"sensor.matrix.{a}{b}", float(a == b), "1", 0.01, -10.0, 10.0,
            f"reading of force {a} per true force {b}",
        )
        for a in "xyz"
        for b in "xyz"
    ]  # fmt: skip
    return ParameterSet((*bias, *gain))


SENSOR = _sensor_parameters()
"""Parameters of the sensor itself: bias (6) and the gain matrix of its forces (3 × 3)."""


@dataclass(frozen=True, eq=False)
class CompiledForm:
    """Readings of a robot and its sensor under gravity (3,) [m/s²], by compiled C functions.

    Methods return None where the C functions do not apply: `Model` then evaluates with numpy.
    """

    robot: Robot
    gravity: tuple[float, ...]
    _kept: dict[tuple[bytes, bool, bool], bytes] = field(
        init=False, repr=False, default_factory=dict
    )

    def readings(self, q: Value, theta: np.ndarray, sensed: bool) -> np.ndarray | None:
        """Readings (N, 6) [N, N·m] at joint values q (N, J) and parameters (P,); if not ``sensed``,
        the loads before gains and bias. None where the C functions do not apply."""
        name = self.robot.compiled
        if not statics.available(name) or not self._takes(q, theta):
            return None
        return statics.readings(name, q, self._of_one(theta, sensed))

    def gravity_seen(self, q: Value, theta: np.ndarray) -> np.ndarray | None:
        """Gravity in sensor axes (N, 3) [m/s²] at joint values (N, J); None if C does not apply."""
        name = self.robot.compiled
        if not statics.available(name) or not self._takes(q, theta):
            return None
        constants = self._of_one(theta, sensed=False, unit=True)
        return statics.readings(name, q, constants)[:, :3]

    def jacobian(self, q: Value, theta: np.ndarray, columns: Sequence[int]) -> np.ndarray | None:
        """Derivatives (N, 6, K) of readings by parameters (indices) ``columns``; None where the C
        functions do not apply."""
        name = self.robot.compiled
        if not statics.available(name, slopes=True) or not self._takes(q, theta):
            return None
        shifted = np.repeat(theta.astype(complex).reshape(1, 1, -1), len(columns), 1)
        shifted[:, np.arange(len(columns)), list(columns)] += 1j * STEP
        changes = self.constants(shifted, sensed=True).imag / STEP
        slopes = statics.slopes(name, q, self._of_one(theta, sensed=True), changes[0])
        return np.moveaxis(slopes, -3, -1)

    def _of_one(self, theta: np.ndarray, sensed: bool, unit: bool = False) -> bytes:
        """Bytes of the C constants of one parameter vector (P,), cached; with gains and bias if
        ``sensed``; if ``unit``, for a tool of 1 kg at the sensor's origin."""
        key = theta.tobytes(), sensed, unit
        constants = self._kept.get(key)
        if constants is None:
            if len(self._kept) >= _KEPT:
                self._kept.clear()
            numbers = self.constants(theta, sensed)
            if unit:
                numbers[_LOAD] = (1.0, 0.0, 0.0, 0.0, 0.0)
            constants = self._kept[key] = numbers.tobytes()
        return constants

    def constants(self, theta: np.ndarray, sensed: bool) -> np.ndarray:
        """Constants (…, C) that the C functions take, of parameters (…, P); with the sensor's gains
        and bias if ``sensed``."""
        parameter_count = len(self.robot.parameters)
        packed = self.robot.packed(theta[..., :parameter_count], np.asarray(self.gravity))
        tool = self.robot.tool(theta[..., :parameter_count])
        sensor = theta[..., parameter_count:] if sensed else _IDEAL
        parts = (
            packed.gravity, tool.mass[..., None], tool.cog, tool.sensor_mass[..., None],
            packed.last.reshape(*packed.last.shape[:-2], 9), sensor[..., 6:], sensor[..., :6],
            packed.own,
        )  # fmt: skip
        rows = theta.shape[:-1]
        return np.concatenate([np.broadcast_to(x, (*rows, x.shape[-1])) for x in parts], axis=-1)

    def _takes(self, q: Value, theta: np.ndarray) -> bool:
        """Whether joint values (N, J) and parameters (P,) are plain float64, which C can take."""
        if not isinstance(q, np.ndarray) or q.ndim != 2 or q.shape[1] != len(self.robot.joints):
            return False
        return q.dtype == theta.dtype == _DOUBLE and theta.ndim == 1


@dataclass(frozen=True)
class Model:
    """A robot with its sensor as formulas, under gravity (3,) [m/s²] in world axes."""

    robot: Robot
    gravity: tuple[float, ...]
    parameters: ParameterSet = field(init=False)
    _compiled: CompiledForm = field(init=False, compare=False, repr=False)
    _carrier: dict[bytes, tuple[Jet, Motion]] = field(
        init=False, compare=False, repr=False, default_factory=dict
    )
    """The last joint values in motion, and what they gave, by the parameters that it depends on."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", self.robot.parameters + SENSOR)
        object.__setattr__(self, "_compiled", CompiledForm(self.robot, self.gravity))

    @classmethod
    def of(cls, robot: Robot, metadata: Metadata | None = None) -> "Model":
        """The model of a robot under the gravity of a recording's metadata, else its default."""
        stated = metadata.gravity if metadata is not None else None
        return cls(robot, tuple(robot.gravity if stated is None else stated))

    def configured(self, metadata: Metadata) -> np.ndarray:
        """Parameters (P,) as a recording's metadata states them, else nominal."""
        names, theta = self.parameters, self.parameters.nominal
        n = len(self.robot.parameters)
        tool, sensor = metadata.tool, metadata.sensor
        if tool.mass is not None or tool.cog is not None:
            before = self.robot.tool(theta[:n])
            mass = float(before.mass) if tool.mass is None else tool.mass
            cog = [float(c) for c in before.cog] if tool.cog is None else list(tool.cog)
            theta[:n] = self.robot.theta_of_tool(theta[:n], mass, cog)
        stated: dict[str, float] = {}
        if sensor.pose_flange is not None and "mount.position.x" in names.names:
            stated |= _mounted(sensor.pose_flange)
        if tool.inertia is not None:
            stated |= {
                f"tool.inertia.{a}": v for a, v in zip(INERTIA_AXES, tool.inertia, strict=True)
            }
        if sensor.mass is not None:
            stated["sensor.mass"] = sensor.mass
        return names.vector(stated, start=theta)

    def true_wrench(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Load on the sensor (…, N, 6) [N, N·m] at joint values (N, J), without gains and bias."""
        compiled = self._compiled.readings(q, theta, sensed=False)
        return self.plain_wrench(q, theta) if compiled is None else compiled

    def plain_wrench(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Load (…, N, 6) [N, N·m] on the sensor by numpy alone, against which C code is tested."""
        return self._load(self._seen(q, theta), theta)

    def _seen(self, q: Value, theta: np.ndarray) -> np.ndarray | Motion:
        """Gravity in sensor axes (…, N, 3) [m/s²]; if q is a `Jet`, the sensor's `Motion`."""
        place, gravity = theta[..., : len(self.robot.parameters)], np.asarray(self.gravity)
        if isinstance(q, Jet):
            return self.robot.at_sensor(self._carried(q, place), place)
        return self.robot.gravity_seen(q, place, gravity)

    def _carried(self, q: Jet, theta: np.ndarray) -> Motion:
        """Motion of what carries the sensor; of one vector theta (P,) the last one is kept."""
        place, gravity = theta[..., : len(self.robot.parameters)], np.asarray(self.gravity)
        if theta.ndim > 1 or np.iscomplexobj(theta):
            return self.robot.carrier_motion(q, place, gravity)
        key = place[self._bearing].tobytes()
        if key not in self._carrier or self._carrier[key][0] is not q:
            rows = range(0, len(q.v), _AT_ONCE)
            parts = [self.robot.carrier_motion(q[a : a + _AT_ONCE], place, gravity) for a in rows]
            whole = Motion(*(np.concatenate(x, axis=-1) for x in zip(*parts, strict=True)))
            self._carrier.clear()
            self._carrier[key] = q, whole
        return self._carrier[key][1]

    @cached_property
    def _bearing(self) -> np.ndarray:
        """Indices of the parameters that move what carries the sensor."""
        robot, names = self.robot, self.robot.parameters.names
        still = robot.load | robot.mount
        return np.array([k for k, name in enumerate(names) if name not in still], dtype=int)

    def _stages(self, columns: Sequence[int], *, moving: bool) -> list[np.ndarray]:
        """Positions in ``columns`` of the parameters that the sensor's pose depends on, of those
        that the load depends on besides, and of the sensor's own. The mount needs no kinematics
        where the sensor is ``moving``."""
        names = self.parameters.names
        after = self.robot.load | self.robot.mount if moving else self.robot.load
        own = len(self.robot.parameters)
        stage = [2 if c >= own else 1 if names[c] in after else 0 for c in columns]
        return [np.flatnonzero(np.equal(stage, k)) for k in range(3)]

    def _load(self, seen: np.ndarray | Motion, theta: np.ndarray) -> np.ndarray:
        tool = self.robot.tool(theta[..., : len(self.robot.parameters)])
        return load(seen, tool.inertial) if isinstance(seen, Motion) else weight(seen, tool)

    def gravity_seen(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Gravity in sensor axes (N, 3) [m/s²] at joint values (N, J), of parameters (P,)."""
        compiled = self._compiled.gravity_seen(q, theta)
        if compiled is not None:
            return compiled
        return np.asarray(self._seen(q, theta))

    def read(self, load: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Reading (…, N, 6) of a load (…, N, 6) by gains and bias in theta (P,) or (…, 1, P)."""
        bias, gain = np.split(theta[..., len(self.robot.parameters) :], [6], axis=-1)
        turn = gain.reshape(*gain.shape[:-1], 3, 3)
        force = load[..., :3] @ np.swapaxes(turn if theta.ndim == 1 else turn[..., 0, :, :], -1, -2)
        torque = np.broadcast_to(load[..., 3:], force.shape)
        return np.concatenate([force, torque], axis=-1) + bias

    def predict(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Reading (N, 6) [N, N·m] with parameters theta (P,), at rest or, for a `Jet`, in motion;
        ``q``: joint values (N, J), or sensor orientations for a robot without a model."""
        compiled = self._compiled.readings(q, theta, sensed=True)
        return self.read(self.plain_wrench(q, theta), theta) if compiled is None else compiled

    def jacobian(self, q: Value, theta: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Derivatives (N, 6, K) of readings by the parameters at indices ``columns``, exact to
        rounding, by complex steps (Squire & Trapp 1998, doi 10.1137/S003614459631241X); q (N, J) or
        a `Jet`, theta (P,)."""
        compiled = self._compiled.jacobian(q, theta, columns)
        if compiled is not None:
            return compiled
        slopes = np.empty((len(columns), len(value(q)), 6))
        carried = self._carried(q, theta) if isinstance(q, Jet) else None
        for stage, group in enumerate(self._stages(columns, moving=carried is not None)):
            shifted = complex_steps(theta, [columns[k] for k in group.tolist()])
            step, end = max(1, _AT_ONCE // max(1, len(group))), slopes.shape[1] * (len(group) > 0)
            for part in (slice(a, a + step) for a in range(0, end, step)):
                if stage == 0 or carried is None:
                    seen = self._seen(q[part], shifted if stage == 0 else theta)
                else:
                    some = Motion(*(x[..., part] for x in carried))
                    seen = self.robot.at_sensor(some, shifted if stage == 1 else theta)
                load = self._load(seen, shifted if stage < 2 else theta)
                slopes[group, part] = self.read(load, shifted).imag / STEP
        return np.moveaxis(slopes, 0, -1)


def _mounted(pose: Sequence[float]) -> dict[str, float]:
    turn = rotation_vector(np.asarray(pose[3:]))
    values = {f"mount.rotation.{a}": float(v) for a, v in zip("xyz", turn, strict=True)}
    return values | {f"mount.position.{a}": float(v) for a, v in zip("xyz", pose[:3], strict=True)}


def robot_of(recording: Recording) -> Robot:
    """The robot that a recording names, or `Oriented` for a recording that has orientations only; a
    `RecordingError` if there is no such robot, or it cannot take the joint values."""
    name, joints = recording.metadata.robot, len(recording.joints)
    if not joints:
        return ORIENTED
    try:
        robot: Robot = registry.load("robots", name)
    except NotFoundError as error:
        raise RecordingError(
            f"{recording.name}: metadata robot = {name!r}: there is no robot {name!r} here and no "
            f"orientation qw qx qy qz: {error}"
        ) from error
    if joints != len(robot.joints):
        raise RecordingError(
            f"{recording.name}: has {joints} joints, {robot.name} has {len(robot.joints)}: "
            f"metadata robot = {name!r} is wrong"
        )
    try:
        where = f"{recording.name}: robot {name!r}"
        parts = (_within_limits(robot, q) for q in recording.parts_of_q())
        robot.check(parts, robot.parameters.nominal, where)
    except PlanError as error:
        raise RecordingError(
            f"{error}: state joints in rad and m, and in metadata robot = {name!r} the robot that "
            "was recorded"
        ) from error
    return robot


def _within_limits(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Joint values (N, J), clipped where at most `_PAST_LIMIT` beyond joint limits; else as
    given."""
    lower = np.array([joint.lower for joint in robot.joints])
    upper = np.array([joint.upper for joint in robot.joints])
    inside = np.clip(q, lower, upper)
    return np.where(np.abs(q - inside) <= _PAST_LIMIT * (upper - lower), inside, q)
