"""The design of an experiment: poses or a motion, the path between them, and stated numbers.

Typical tolerances and steps in this module are estimates.
"""

import re
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from wrenchbed import registry
from wrenchbed.benchmark.fault import UsualFit, as_stated
from wrenchbed.benchmark.lookalikes import motion_loads
from wrenchbed.benchmark.lookalikes.motion_loads import SensorMotion, Weights
from wrenchbed.calibration.calibrate import IdentifiedLoad, identify_from_gravity
from wrenchbed.data.holds import gather
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.plan import Plan
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.base import INERTIA_AXES, Robot

STEPS = 4
"""Points on the move to each pose; the last one is the pose itself."""
_ENOUGH = 10
"""Degrees of freedom above which the scatter of rows is a noise: known to 22 % (1/√20)."""
_MOVE_S, _RATE_HZ = 3.0, 100.0
"""Time of a move between planned poses [s] and rate of the rows there [Hz], about those of the
simulated driver."""
_SMOOTH = (11, 4)
"""Rows and degree of the polynomials that remove encoder noise from a recorded motion."""
_STRIDE = 8
"""In motion, joint torques are computed at every eighth sample and interpolated."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """The nominal robot at T instants [s] of a path that passes every pose: joint values (T, J),
    wrench (T, 6) [N, N·m], specific force in sensor axes (T, 3) [m/s²], torque that the joints
    carry (T, J) [N·m or N], empty without joints, and the instant of each hold or sample, ``at``
    (N,)."""

    t: np.ndarray
    q: np.ndarray
    wrench: np.ndarray
    specific_force: np.ndarray
    torque: np.ndarray
    at: np.ndarray


def path_of_holds(design: "ExperimentDesign") -> JointPath:
    """Path of straight joint-space moves from hold to hold of a design at rest."""
    robot, theta, gravity, t = design.robot, design.theta, design.gravity, design.t
    q = target = design.q
    fraction = np.arange(1, STEPS + 1) / STEPS
    before = np.concatenate([q[:1], q[:-1]])
    if not robot.joints:
        target = q * np.where((before * q).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    points = before[:, None] + fraction[None, :, None] * (target - before)[:, None]
    points = points.reshape(-1, q.shape[1])
    if not robot.joints:
        points = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    with np.errstate(invalid="ignore", divide="ignore"):
        motion = motion_loads.at_rest(robot, theta, points, gravity)
    at = np.arange(STEPS - 1, len(points), STEPS)
    unreachable = ~np.isfinite(motion.rotation).all(axis=(1, 2))
    if unreachable.any():  # the straight move leaves the workspace: the robot waits at the start
        last = np.maximum.accumulate(np.where(unreachable, -1, np.arange(len(points))))
        points = points[np.maximum(last, at[0])]
        motion = motion_loads.at_rest(robot, theta, points, gravity)
    since = np.concatenate([t[:1] - 1.0, t[:-1]])
    times = (since[:, None] + fraction * (t - since)[:, None]).ravel()
    torque = motion_loads.weights(robot, theta, points, gravity).torque
    wrench = motion_loads.load_wrench(motion, design.load)
    return JointPath(times, points, wrench, motion.specific_force, torque, at)


@dataclass(frozen=True, eq=False)
class ExperimentDesign:
    """Poses, times and stated numbers of a recording, which all cases drawn at it share.

    ``q`` are joint values of the holds (H, J) or of the samples (N, J) [rad or m]; orientations w,
    x, y, z (H, 4) for a robot without joints; ``t`` mean times of holds or samples [s], ``samples``
    rows of each hold, 1 in motion, ``rate`` rows per second [Hz], ``noise_std`` of one row (6,) [N,
    N·m], ``temperature`` per hold or sample [°C]. A tool that the metadata do not state is
    identified from the wrenches ``measured`` (N, 6).
    """

    robot: Robot
    mode: str
    q: np.ndarray
    t: np.ndarray
    samples: int
    rate: float
    metadata: Metadata
    noise_std: np.ndarray
    temperature: np.ndarray | None = None
    measured: np.ndarray | None = None

    @classmethod
    def of(cls, recording: Recording) -> "ExperimentDesign":
        """The design of a recording: its poses, times and stated numbers, not its wrenches."""
        meta = recording.metadata
        name = meta.robot if recording.joints else "oriented"
        robot = registry.load("robots", name)
        t, q = recording.t.astype(float), recording.q.astype(float)
        warm = recording.columns.get("temperature")
        step = float(np.median(np.diff(t))) if len(t) > 1 else 0.01
        rate = float(meta.rate_hz or 1.0 / step)
        if meta.mode == "dynamic":
            noise = _noise(meta, robot, None)
            if len(q) > _SMOOTH[0]:
                q = savgol_filter(q, *_SMOOTH, axis=0)
            return cls(robot, "dynamic", q, t, 1, rate, meta, noise, warm, recording.wrench)
        held = gather(recording, np.ones(len(t), dtype=bool))
        q, known = held.q, held.row_covariance if held.dof > _ENOUGH else None
        if not recording.joints:
            q = q / np.linalg.norm(q, axis=1, keepdims=True)
        noise = _noise(meta, robot, None if known is None else np.sqrt(np.diag(known)))
        warm = None if warm is None else np.add.reduceat(warm, held.rows) / held.count
        samples = int(np.median(held.count))
        return cls(robot, "static", q, held.t, samples, rate, meta, noise, warm, held.wrench)

    @classmethod
    def of_plan(cls, plan: Plan, robot: Robot, samples: int = 50) -> "ExperimentDesign":
        """Design of a plan not yet recorded: tool, noise and times nominal, ``samples`` a pose."""
        rate = float(plan.rate_hz or _RATE_HZ)
        tool = robot.tool(robot.parameters.nominal)
        meta = as_stated(robot, plan.mode, "lookalike", rate, tool)
        noise = _noise(meta, robot, None)
        if plan.mode == "dynamic":
            t = np.arange(len(plan)) / rate
            return cls(robot, "dynamic", plan.q, t, 1, rate, meta, noise)
        dwell = np.maximum(plan.dwell, samples / rate) + _MOVE_S
        t = np.cumsum(dwell) - 0.5 * samples / rate
        return cls(robot, "static", plan.q, t, samples, rate, meta, noise)

    def __len__(self) -> int:
        return len(self.t)

    @property
    def moving(self) -> bool:
        """Whether the design is one motion (``q`` are samples), not poses at rest."""
        return self.mode == "dynamic"

    @property
    def distal_links(self) -> list[str]:
        """Names of the links that end in passive joints of five-bar linkages (closed chains)."""
        return [n for n in self.robot.parameters.names if re.fullmatch(r"L\d[24]", n)]

    @cached_property
    def gravity(self) -> np.ndarray:
        """Gravity in world axes (3,) [m/s²]."""
        return np.array(self.metadata.gravity or self.robot.gravity, dtype=float)

    @cached_property
    def theta(self) -> np.ndarray:
        """The robot's parameters (P,) as the metadata states them."""
        robot, tool, sensor = self.robot, self.metadata.tool, self.metadata.sensor
        theta = robot.parameters.nominal.astype(float)
        stated: dict[str, float] = {}
        if tool.inertia is not None:
            six = zip(INERTIA_AXES, tool.inertia, strict=True)
            stated |= {f"tool.inertia.{a}": moment for a, moment in six}
        if sensor.mass is not None:
            stated["sensor.mass"] = sensor.mass
        if sensor.pose_flange is not None and "mount.position.x" in robot.parameters.names:
            turn = Rotation.from_quat(sensor.pose_flange[3:], scalar_first=True).as_rotvec()
            for k, a in enumerate("xyz"):
                stated[f"mount.position.{a}"] = sensor.pose_flange[k]
                stated[f"mount.rotation.{a}"] = float(turn[k])
        theta = robot.parameters.vector(stated, start=theta)
        if tool.mass is not None and tool.cog is not None:
            return robot.theta_of_tool(theta, tool.mass, list(tool.cog))
        carried: Tool | IdentifiedLoad = robot.tool(theta)
        if self.measured is not None:  # the tool that the wrenches show
            g = robot.gravity_seen(self.q, theta, self.gravity)
            seen = identify_from_gravity(g, self.measured, 1.0 / np.square(self.noise_std))
            carried = seen if seen.mass > 0.0 else carried
        mass = float(carried.mass) if tool.mass is None else tool.mass
        cog = [float(c) for c in (carried.cog if tool.cog is None else tool.cog)]
        return robot.theta_of_tool(theta, mass, cog)

    @cached_property
    def load(self) -> Tool:
        """Tool on the sensor, as the metadata state it."""
        return self.robot.tool(self.theta)

    @cached_property
    def motion(self) -> SensorMotion:
        """Pose and motion of the nominal robot's sensor, at each hold or sample."""
        return self.moved(np.zeros(()), self.theta)

    def moved(self, dq: np.ndarray, theta: np.ndarray) -> SensorMotion:
        """Motion of the sensor at joint values q + dq (N, J) with parameters (P,) or (N, P)."""
        q = self.q + dq
        if self.moving:
            return motion_loads.in_motion(self.robot, theta, self.t, q, self.gravity)
        return motion_loads.at_rest(self.robot, theta, q, self.gravity)

    @cached_property
    def nominal(self) -> np.ndarray:
        """The wrench (N, 6) [N, N·m] of the robot as stated."""
        return motion_loads.load_wrench(self.motion, self.load)

    @cached_property
    def full_scale(self) -> np.ndarray:
        """The sensor's range per channel (6,) [N, N·m]."""
        name = self.metadata.sensor.model or self.robot.sensor
        name = name if registry.is_known("sensors", name) else self.robot.sensor
        return np.asarray(registry.load("sensors", name).calibration().range, dtype=float)

    @cached_property
    def swing(self) -> np.ndarray:
        """Largest magnitude of the nominal wrench per channel (6,), at least 3 row noises."""
        return np.maximum(np.abs(self.nominal).max(axis=0), 3.0 * self.noise_std)

    @cached_property
    def path(self) -> JointPath:
        """The nominal path through all poses with the moves between them."""
        if self.moving:
            specific, torque = self.motion.specific_force, self.weights.torque
            every = np.arange(len(self.t))
            return JointPath(self.t, self.q, self.nominal, specific, torque, every)
        return path_of_holds(self)

    @cached_property
    def weights(self) -> Weights:
        """Joint torques (N, J) and base moments (N, 3) by weight, of the nominal robot."""
        stride = _STRIDE if self.moving else 1
        t = self.t if self.moving else None
        return motion_loads.weights(self.robot, self.theta, self.q, self.gravity, t, stride)

    @cached_property
    def tolerance(self) -> tuple[float, float, np.ndarray]:
        """Tolerances of the stated mass [kg], CoG [m] and bias (6,): larger errors are a cause."""
        given = self.metadata.tolerance
        mass = float(given.get("tool.mass", 0.005 * self.load.mass))
        cog = float(given.get("tool.cog", 5e-4))
        bias = np.broadcast_to(given.get("sensor.bias", 3.0 * self.noise_std), 6)
        return mass, cog, np.asarray(bias, dtype=float)

    @cached_property
    def usual(self) -> UsualFit:
        """Fit of bias, mass and CoG to readings, as every diagnosis makes it before all others."""
        load = self.load
        changed = [replace(load, mass=load.mass + 1.0)]
        changed += [replace(load, cog=load.cog + 0.01 * axis) for axis in np.eye(3)]
        pulls = (motion_loads.load_wrench(self.motion, other) for other in changed)
        differences = [pull - self.nominal for pull in pulls]
        return UsualFit.of(differences, self.noise_std)


def _noise(meta: Metadata, robot: Robot, measured: np.ndarray | None) -> np.ndarray:
    """Standard deviation (6,) of one row: ``measured`` if known, else stated, else nominal."""
    typical = np.asarray(registry.load("sensors", robot.sensor).noise.row_std, dtype=float)
    if measured is not None:
        return np.maximum(measured, 0.02 * typical)
    if meta.sensor.noise_std is not None and min(meta.sensor.noise_std) > 0.0:
        return np.array(meta.sensor.noise_std, dtype=float)
    return typical
