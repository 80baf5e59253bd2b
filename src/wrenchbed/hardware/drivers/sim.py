"""The simulated robot: MuJoCo moves it in simulated time, its sensor adds realistic noise.

At rest the wrench is exact at the joint values that the servos reached; in motion it is that of
the servo-driven dynamics. The true ``parameters`` never enter the metadata, which state the nominal
robot. Seeds keep recordings repeatable: a change of the order of draws changes them all.

Effects do not change the measured joint values: the robot moves without them, and their change of
the load on the sensor is computed at the measured joints (`twin`). Effects with memory, such as
creep, remember the complete recording run.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from wrenchbed import registry
from wrenchbed.data.metadata import Metadata
from wrenchbed.data.recording import TARGET, TOUCH_STD
from wrenchbed.effects.chain import ActiveEffect, EffectChain, active_effect, parse_effect
from wrenchbed.errors import DriverError, LateError, NotFoundError, ParameterError, WrenchbedWarning
from wrenchbed.hardware.drivers.base import (
    Applied,
    ArmSample,
    Block,
    Driver,
    Move,
    Reached,
    as_designed,
)
from wrenchbed.hardware.transducers.base import WrenchSample
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.physics.rotations import exp
from wrenchbed.physics.taylor_jets import Jet, value
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.checked_moves import Limits, minimum_jerk
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.drives.drive_train import DriveTrain, Kind, ReportedEfforts
from wrenchbed.simulation.drives.faults import FAULTS, PREFIX, apart, faults_apart
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.servo_motion import ServoDrivenRobot, steps_in
from wrenchbed.twin.replay import Playback
from wrenchbed.twin.twin import Twin

_IMU = ("ax", "ay", "az")
CONTROL_S = 0.008
"""Time between two position targets of a move [s], as on a CB3."""
_BLOCK_S = 4.0
"""Length of the blocks in which the rows of a motion are yielded [s]."""
_LEAST_ROWS = 12
"""Fewest rows of a motion whose derivatives a spline gives: twice the six parameters of a piece."""
_PUSH = 3.0
"""Largest contact force of a touch along each axis [N], as of a light push by hand."""
Samples = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Times (n,) [s], joint values and speeds (n, J), loads or readings (n, 6) [N, N·m]."""


class SimMove(Move):
    """Move of a simulated robot; each `poll` advances it by one control period.

    Args:
        goal: joint values (J,).
        steps: yields the joint values after each period; only the last has a duration above 0.
        halt: brings the robot to rest, given the time that the move has lasted [s].
    """

    def __init__(
        self, goal: np.ndarray, steps: Iterator[Reached], halt: Callable[[float], None]
    ) -> None:
        super().__init__(goal)
        self._steps, self._stop = steps, halt
        self._taken = 0

    def _advance(self) -> Reached | None:
        reached = next(self._steps)
        self._taken += 1
        return reached if reached.duration > 0.0 else None

    def _pause(self, timeout: float | None) -> None:
        if timeout is not None and self._taken * CONTROL_S > timeout:
            self._halt()
            raise LateError(f"the move did not arrive within {timeout:g} s")

    def _halt(self) -> None:
        self._stop(self._taken * CONTROL_S)


@dataclass(frozen=True)
class SimOptions:
    """Options of the simulated robot and its sensor.

    Attributes:
        robot: registry name.
        parameters: true values of parameters that differ from nominal, by name, SI.
        noise: ``real``, ``white`` or ``off``.
        seed: seed of the noise.
        gravity: (3,) [m/s²], the robot's default if None.
        effects: imperfections, as ``joint.compliance:joint=2,stiffness=1.4e4``; values that are
            left out have typical sizes.
        limits: limits of the robot's motion; None: half of top speed, anywhere.
        effort: ``torque`` or ``current``: recordings have it as tau1… [N·m or N] or i1… [A], with
            the controller's targets and the drives' temperatures; ``off``: they do not.
        tracker: standard deviation of a tracker's readings [m]: recordings at rest have the
            position of a target on the flange as mx my mz; 0: they do not.
        imu: standard deviation of an accelerometer's readings ax ay az [m/s²]; 0: none.
    """

    robot: str
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: str = "real"
    seed: int = 0
    gravity: tuple[float, float, float] | None = None
    effects: tuple[str, ...] = ()
    limits: Limits | None = None
    effort: str = "off"
    tracker: float = 0.0
    imu: float = 0.0


class Beside:
    """Simulates a tracker, read at rest, and an accelerometer besides the wrench sensor.

    The tracker stands anywhere in the room, its target and the accelerometer are mounted anywhere
    on the flange; the accelerometer's scales are off by 2 % and its zeros by 0.3 m/s². The rows of
    a pose share an error (seat of the target, air) of half the standard deviation of a row's noise.
    """

    def __init__(self, twin: Twin, options: SimOptions) -> None:
        quiet = 0.0 if options.noise == "off" else 1.0
        self._twin, self._rng = twin, np.random.default_rng([options.seed, 4])
        self._turn = value(exp(*self._rng.uniform(-1.5, 1.5, 3)))
        self._stand, self._target = self._rng.uniform(-2.0, 2.0, (2, 3)) * [[1.0], [0.05]]
        mount = value(exp(*self._rng.uniform(-1.5, 1.5, 3)))
        self._gain = mount @ (np.eye(3) + 0.02 * self._rng.standard_normal((3, 3)))
        self._zero = 0.3 * self._rng.standard_normal(3)
        sizes = {TARGET: options.tracker, _IMU: options.imu}
        self._std = {names: quiet * std for names, std in sizes.items() if std > 0.0}
        self._before: np.ndarray | None = None
        self._lever = self._rng.uniform(-0.05, 0.05, 3)  # of the accelerometer, sensor axes [m]

    @property
    def moves(self) -> bool:
        """Whether something is read in motion too."""
        return _IMU in self._std

    def in_motion(self, t: np.ndarray, q: np.ndarray) -> Block:
        """Simulate the accelerometer in a complete motion with joint values q (n, J) at times t
        (n,) [s]; its place is differentiated by a spline."""
        scene = self._twin.scene(q, t)
        rotation, position = self._twin.place(scene)
        felt = scene.gravity - _moving(t, position + rotation @ self._lever).dd
        true = np.einsum("nji,nj->ni", rotation, -felt) @ self._gain.T + self._zero
        rows = true + self._std[_IMU] * self._rng.standard_normal((len(t), 3))
        return dict(zip(_IMU, rows.T, strict=True))

    def columns(self, q: np.ndarray, n: int) -> Block:
        """Simulate the readings of n rows at joint values (J,), as column name → values (n,)."""
        before = q if self._before is None else self._before
        scene = self._twin.scene(np.stack([before, q]), np.arange(2.0))
        rotation, position = (part[1] for part in self._twin.place(scene))
        self._before = q
        true = {
            TARGET: self._turn @ (position + rotation @ self._target) + self._stand,
            _IMU: self._gain @ -(scene.gravity @ rotation) + self._zero,
        }
        block = dict[str, np.ndarray]()
        for names, std in self._std.items():
            shared = true[names] + 0.5 * std * self._rng.standard_normal(3)
            rows = shared + std * self._rng.standard_normal((n, 3))
            block |= dict(zip(names, rows.T, strict=True))
        return block


class SimDriver(Driver):
    """Driver of a simulated robot: MuJoCo moves it, its sensor has data-sheet noise. A
    `NotFoundError` if the robot has no MuJoCo model, a `ParameterError` for an unknown parameter,
    or an impossible value or kind of noise."""

    name = "sim"
    title = "the robot in MuJoCo, in simulated time, with realistic noise"
    options = SimOptions

    def __init__(self, options: SimOptions) -> None:
        super().__init__(options.limits)
        robot = registry.load("robots", options.robot)
        if not isinstance(robot, SimulatedRobot):
            raise NotFoundError(f"robot {options.robot!r} has no MuJoCo model to simulate")
        self.robot: SimulatedRobot = robot
        self.model = Model(robot, tuple(options.gravity or robot.gravity))
        drives, others = apart(options.parameters)
        faults, effects = faults_apart(options.effects)
        self.theta = self.model.parameters.vector(others)
        theta = robot.robot_theta(self.theta)
        self._simulation = Simulation(robot, theta, self.model.gravity)
        self._sensor = registry.load("sensors", robot.sensor)
        self._noise = noise_model(options.noise, self._sensor.noise)
        self._stream = NoiseStream(self._noise, options.seed)
        active = tuple(active_effect(robot, text) for text in effects)
        self._efforts = self._reported(options, active, drives, faults)
        twin = Twin(self.model, self.theta, active)
        self._beside = Beside(twin, options)
        self._playback = Playback(twin, options.seed) if active else None
        self._plant = ServoDrivenRobot(self._simulation, robot.home)
        self._time = 0.0
        self._touch_rng = np.random.default_rng([options.seed, 1])
        self._contact = np.zeros(6)

    @staticmethod
    def drive_faults() -> dict[str, str]:
        """Faults that a simulated drive can have: name, as option ``effects`` takes it → title."""
        return {f"{PREFIX}{kind}": fault.title for kind, fault in FAULTS.items()}

    def _reported(
        self, options: SimOptions, active: tuple[ActiveEffect, ...], drives: Mapping[str, float],
        faults: tuple[str, ...],
    ) -> ReportedEfforts | None:  # fmt: skip
        """Make the model of the efforts that simulated drives report, None for ``effort`` off, from
        ``active`` effects, parameters of drives by name, and texts of drive faults."""
        if options.effort not in ("torque", "current", "off"):
            raise ParameterError(f"effort {options.effort!r}: give torque, current or off")
        if options.effort == "off":
            for first in (*drives, *faults):
                alone = f"{first} shows in joint efforts alone"
                raise ParameterError(f"{alone}: record with --effort torque or current")
            return None
        theta = EffectChain(active).theta(self.robot, self.robot.robot_theta(self.theta))
        named = [parse_effect(text) for text in faults]
        train = DriveTrain(self.robot, theta, self.model.gravity, drives, named)
        kind: Kind = "torque" if options.effort == "torque" else "current"
        return ReportedEfforts(train, kind, options.noise, options.seed)

    def metadata(self, mode: str, rate: float) -> Metadata:
        return as_designed(
            self.robot, source="sim", mode=mode, rate=rate, gravity=self.model.gravity,
            sensor=self._sensor.name, noise_std=self._noise.row_std,
        )  # fmt: skip

    def expect(self, plan: np.ndarray, mode: str) -> None:
        if self._playback is None:
            return
        for active in self._playback.twin.active:
            if mode not in active.effect.modes:
                text = f"{active.effect.name} does not show in a {mode} plan"
                warnings.warn(f"{text}: recorded as without it", WrenchbedWarning, stacklevel=2)
        if mode == "static":
            self._playback.expect(plan)

    def _read(self) -> ArmSample:
        plant = self._plant
        return ArmSample(self._time, self._time, 0.0, plant.q, plant.qd, plant.target)

    def _read_wrench(self) -> WrenchSample:
        """Simulate one sensor reading at rest; a microsecond of simulated time passes."""
        block = self._sample(1, 1e6)
        reading, status = np.array([block[c][0] for c in CHANNELS]), int(block["status"][0])
        return WrenchSample(self._time, self._time, 0, 0.0, True, reading, status, status)

    def _write(self, q: np.ndarray) -> Applied:
        """Drive the joints towards a target (J,) for one control period; return what was sent."""
        if why := self.limits.check_step(self.robot, self._plant.target, q, CONTROL_S):
            return Applied(None, why)
        self._contact = np.zeros(6)
        self._plant.advance(q, CONTROL_S)
        self._time += CONTROL_S
        return Applied(q)

    def _stop(self, kind: str) -> None:
        """Bring the simulated robot to rest at its present joint values, whatever the ``kind``."""
        start, begun = self._plant.q, self._time
        self._time += self._plant.settle(start)[1]
        if self._playback is not None:
            self._playback.move((begun, self._time), start, self._plant.q)

    def _touch(self, point: np.ndarray) -> Reached:
        """Move the tip to a point in the base (3,) [m], with a random error of standard deviation
        `TOUCH_STD` on each axis; return the joint values there. A random force pushes the tip."""
        seat = point + self._touch_rng.normal(0.0, TOUCH_STD, 3)
        start = self._plant.q
        target = self._simulation.joints_touching(start, seat)
        if target is None or self.robot.infeasible(target[None], self._simulation.theta):
            raise DriverError(f"the simulated {self.robot.name} cannot reach the point {point} m")
        reached = self._move(start, target, 1.0).wait()
        rotation, origin = self.robot.sensor_pose(reached.q[None], self._simulation.theta)
        force = rotation[0].T @ self._touch_rng.uniform(-_PUSH, _PUSH, 3)
        lever = rotation[0].T @ (seat - origin[0])
        self._contact = np.concatenate([force, np.cross(lever, force)])
        return reached

    def _move(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> SimMove:
        def halt(seconds: float) -> None:
            _, waited = self._plant.settle(self._plant.q)
            self._arrived(start, seconds + waited)

        return SimMove(goal, self._steps(start, goal, seconds), halt)

    def _steps(self, start: np.ndarray, goal: np.ndarray, seconds: float) -> Iterator[Reached]:
        """Yield joint values after each control period of a move of ``seconds``, then at rest."""
        self._contact = np.zeros(6)
        steps = max(1, int(np.ceil(seconds / CONTROL_S)))
        for fraction in minimum_jerk(np.arange(1, steps + 1) / steps):
            self._plant.advance(start + fraction * (goal - start), seconds / steps)
            yield Reached(self._plant.q, 0.0)
        there, waited = self._plant.settle(goal)
        if not there:
            miss = np.abs(self._plant.q - goal).max()
            raise DriverError(f"the simulated {self.robot.name} stopped {miss:.2g} off its target")
        yield self._arrived(start, seconds + waited)

    def _arrived(self, start: np.ndarray, seconds: float) -> Reached:
        """End a move from ``start`` (J,) that took ``seconds``; return joint values (J,), time."""
        arrived = self._time + seconds
        if self._playback is not None:
            self._playback.move((self._time, arrived), start, self._plant.q)
        self._time = arrived
        return Reached(self._plant.q, seconds)

    def _sample(self, n: int, rate: float) -> Block:
        q = self._plant.q
        t = self._time + np.arange(n) / rate
        self._time = float(t[-1]) + 1.0 / rate
        if self._playback is None:
            load = np.repeat(self._simulation.wrench(q[None]) + self._contact, n, axis=0)
            reading = self.model.read(load, self.theta)
        else:
            reading = self._playback.rest(t, q, self._contact)
        still = np.repeat(q[None], n, axis=0)
        columns = {**self._columns(t, still, reading), **self._beside.columns(q, n)}
        if self._efforts is not None:
            targets = np.repeat(self._plant.target[None], n, axis=0)
            columns |= self._efforts.columns(t, Jet(still, 0.0 * still, 0.0 * still), targets, rate)
        return columns

    def _track(self, targets: np.ndarray, rate: float) -> Iterator[Block]:
        """Yield rows of a motion along targets (N, J) at ``rate`` [Hz], in blocks; with effects,
        efforts or an accelerometer after all of it was simulated."""
        moved: Iterable[Samples] = self._moved(targets, rate)
        readings: np.ndarray | None = None
        further: dict[str, np.ndarray] = {}
        if self._playback is not None or self._efforts is not None or self._beside.moves:
            moved = list(moved)
            t, q, qd, load = (np.concatenate(part) for part in zip(*moved, strict=True))
            if self._playback is not None:
                readings = self._playback.motion(t, q, qd, load)
            if self._efforts is not None:
                further |= self._efforts.columns(t, _moving(t, q), targets, rate)
            if self._beside.moves:
                further |= self._beside.in_motion(t, q)
        done = 0
        for t, q, qd, reading in moved:
            part = slice(done, done + len(t))
            done += len(t)
            columns = dict(self._columns(t, q, reading if readings is None else readings[part]))
            columns |= {f"qd{j + 1}": qd[:, j] for j in range(qd.shape[1])}
            columns |= {f"q_target{j + 1}": v for j, v in enumerate(targets[part].T)}
            yield columns | {name: values[part] for name, values in further.items()}

    def _moved(self, targets: np.ndarray, rate: float) -> Iterator[Samples]:
        """Yield samples of a motion along targets (N, J) at ``rate`` [Hz], in blocks: with the
        sensor's readings or, if effects are on, with loads."""
        from scipy.interpolate import CubicSpline  # slow to load: only when it is used

        block, steps = max(1, int(_BLOCK_S * rate)), steps_in(1.0 / rate)
        path = CubicSpline(np.arange(len(targets)), targets, bc_type="natural")
        between = np.arange(1, steps + 1) / steps
        for first in range(0, len(targets), block):
            part = targets[first : first + block]
            at = first + np.arange(len(part))[:, None] + between
            places = path(np.minimum(at, len(targets) - 1))
            q, qd, load = self._plant.follow_all(places, 1.0 / rate)
            t = self._time + np.arange(len(part)) / rate
            self._time = float(t[-1]) + 1.0 / rate
            yield t, q, qd, load if self._playback else self.model.read(load, self.theta)

    def _columns(self, t: np.ndarray, q: np.ndarray, reading: np.ndarray) -> Block:
        reading, status = self._stream.corrupt(t, reading)
        if self._playback is not None:
            reading = self._playback.corrupt(t, reading)
        joints = {f"q{j + 1}": q[:, j] for j in range(q.shape[1])}
        channels = {c: reading[:, k] for k, c in enumerate(CHANNELS)}
        return {"t": t} | joints | channels | {"status": status}


def _moving(t: np.ndarray, q: np.ndarray) -> Jet:
    """Joint values, or a place, with speeds and accelerations (n, J) of a complete motion q (n, J)
    at times t (n,) [s], by a spline: MuJoCo's own are those of half a step before."""
    if len(t) < _LEAST_ROWS:
        raise ParameterError(f"{len(t)} rows of motion are too few for speeds: give {_LEAST_ROWS}")
    from scipy.interpolate import make_interp_spline  # slow to load: only when it is used

    path = make_interp_spline(t, q, k=5)
    return Jet(q, path.derivative(1)(t), path.derivative(2)(t))


DRIVER = SimDriver
