"""A robot in MuJoCo that moves one control cycle at a time, with its sensor and its drives.

Robot, sensor, noise and effects are those of the simulated driver, but in real time: the future is
unknown. `step` and `readings` may be called from different threads.

The links of the simulated body have no weight and no friction (its MJCF is built so): its servos'
torque accelerates the robot and resists external forces. `RealTimeDrives` adds the weight, by
MuJoCo's inverse dynamics at rest, and rotor, friction, faults and noise.
"""

import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import mujoco
import numpy as np

from wrenchbed import registry
from wrenchbed.effects.chain import EffectChain, active_effect, parse_effect
from wrenchbed.errors import NotFoundError
from wrenchbed.physics.noise import noise_model
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.plant.contact_surface import Surface, tip_in
from wrenchbed.plant.sensor import BufferedNoise, SensorRow, SensorWithEffects
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.closed_form import Model
from wrenchbed.simulation.drives.drive_train import DriveTrain, EffortNoise, temperatures
from wrenchbed.simulation.drives.faults import apart, faults_apart
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.servo_motion import ServoDrivenRobot, steps_in
from wrenchbed.twin.replay import Playback
from wrenchbed.twin.twin import Twin

_WARM_EVERY = 250
"""Control cycles between updates of the temperatures, 0.5 s to 2 s: drives warm up over many
minutes, so that rarer updates show as steps and more frequent ones only cost time of each cycle."""
DELAY_S = 0.008
"""Time between computing a state and reporting it [s], so that a fast sensor, which reads between
states, knows the next one. At least one cycle."""
HISTORY_S = 4.0
"""How long the state of a cycle is kept [s]."""


class Efforts(NamedTuple):
    """Torques and currents that the drives report in one control cycle.

    Attributes:
        servo: torque that moves links without weight and friction (J,) [N·m or N].
        torque: motor torque: ``current`` times the drive's nominal constant (J,) [N·m or N].
        current: of the motor (J,) [A].
    """

    servo: np.ndarray
    torque: np.ndarray
    current: np.ndarray


class RealTimeDrives:
    """Computes the torques and currents that a robot's drives report, cycle by cycle.

    Args:
        theta: true parameters of the robot (P,).
        given: true drive parameters that differ from nominal, by name.
        effects: two tuples of texts ``name:key=value``: faults of drives, and all other effects,
            which may change the robot's parameters and so its weight.
        noise: ``real``, ``white`` or ``off``.
        cycle: period of control [s].
        behind: number of cycles after which a state is reported.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, given: Mapping[str, float],
        effects: tuple[tuple[str, ...], tuple[str, ...]], noise: str, seed: int, cycle: float,
        behind: int,
    ) -> None:  # fmt: skip
        faults, others = effects
        active = [active_effect(robot, text) for text in others]
        theta = EffectChain(active).theta(robot, theta)
        named = [parse_effect(text) for text in faults]
        self.train = DriveTrain(robot, theta, robot.gravity, given, named)
        self._noise = EffortNoise(self.train, noise, seed, 1.0 / cycle)
        self._cycle, self._behind, self._count = cycle, behind, 0
        self._rotor = self.train.parameters.inertia - self.train.nominal.inertia
        self._still = np.zeros(self.train.rigid.model.nv)
        self._past: deque[Efforts] = deque()
        self.temperatures = temperatures(np.zeros(1), self.train.joints)[0]
        """Temperatures of the drives (J,) [°C]."""

    @property
    def now(self) -> Efforts:
        """Efforts of the reported state, which is ``behind`` cycles older than the newest."""
        return self._past[0]

    def step(self, plant: ServoDrivenRobot, q: np.ndarray, qd: np.ndarray) -> None:
        """Compute drive torques and currents of a control cycle, from joint values q and speeds qd
        (J,) before it, and the simulated robot ``plant`` after it."""
        train, model, data = self.train, plant.model, plant.data
        constant, spring, damper = model.actuator_biasprm[:, :3].T
        given = model.actuator_gainprm[:, 0] * data.ctrl + constant
        speed = plant.qd
        servo = given + spring * plant.q + damper * speed
        qdd = (speed - qd) / self._cycle
        rigid = servo + train.rigid.at(data.qpos, self._still, self._still) + self._rotor * qdd
        t = np.array([self._count * self._cycle])
        moving = Jet(q[None], 0.5 * (qd + speed)[None], qdd[None])
        total = train.torques(t, moving, rigid[None])
        current = self._noise.on(total / train.parameters.constant, q[None])[0]
        self._past.append(Efforts(servo, current * train.nominal.constant, current))
        while len(self._past) > self._behind + 1:
            self._past.popleft()
        if self._count % _WARM_EVERY == 0:
            self.temperatures = temperatures(t, train.joints)[0]
        self._count += 1


@dataclass(frozen=True)
class BodyOptions:
    """Options of a simulated robot: parameters, noise, effects, sensor.

    Attributes:
        robot: registry name, or the robot itself.
        parameters: true values that differ from nominal, by name, SI.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise and of the effects' random parts.
        effects: texts as ``joint.compliance:joint=2,stiffness=1.4e4``; omitted values are typical.
        sensor: registry name, whose range and noise are simulated; None: the robot's.
    """

    robot: str | SimulatedRobot
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: str = "real"
    seed: int = 0
    effects: tuple[str, ...] = ()
    sensor: str | None = None


class Body:
    """A simulated robot that moves one control cycle at a time.

    Args:
        options: of the robot.
        cycle: period of its control [s].
        surface: for the tool's tip to press on.
        drives: whether its drives report torques and currents.

    Attributes:
        time, q, qd, load: of the reported state: full cycles since the start [s], joint values and
            speeds (J,), and true load on the sensor (6,) [N, N·m], without effects and noise.
        target: last target of the servos (J,).
        newest: when the newest state was due (`time.monotonic`), and its simulated time [s], up to
            which the readings are known.

    Raises:
        NotFoundError: the robot has no MuJoCo model, or no such effect.
        ParameterError: an unknown parameter, an impossible value or kind of noise.
    """

    def __init__(self, options: BodyOptions, cycle: float, surface: Surface | None = None, *,
                 drives: bool = False) -> None:  # fmt: skip
        robot: object = options.robot
        if isinstance(robot, str):
            robot = registry.load("robots", robot)
        if not isinstance(robot, SimulatedRobot):
            raise NotFoundError(f"robot {options.robot!r} has no MuJoCo model to simulate")
        self.robot = robot
        self.cycle = cycle
        self.model = Model(robot, tuple(robot.gravity))
        of_drives, others = apart(options.parameters) if drives else ({}, options.parameters)
        faults, effects = faults_apart(options.effects) if drives else ((), options.effects)
        self.theta = self.model.parameters.vector(others)
        robot_theta = robot.robot_theta(self.theta)
        self.simulation = Simulation(robot, robot_theta, self.model.gravity)
        self.sensor = registry.load("sensors", options.sensor or robot.sensor)
        self._noise = BufferedNoise(noise_model(options.noise, self.sensor.noise), options.seed)
        active = tuple(active_effect(robot, text) for text in effects)
        twin = Twin(self.model, self.theta, active)
        self._playback = Playback(twin, options.seed) if active else None
        self._sensor_effects = (
            SensorWithEffects(self._playback, surface is not None) if self._playback else None
        )
        self._plant = ServoDrivenRobot(self.simulation, robot.home)
        self._surface = surface
        self._tip: np.ndarray | None = None
        self.push = np.zeros(3)
        """Force of the surface on the tip, in the world [N]."""
        self._substeps = steps_in(cycle)
        self._lock = threading.Lock()
        self.target = self._before = np.array(robot.home)
        self._behind = max(1, round(DELAY_S / cycle))
        self._rows: deque[SensorRow] = deque(maxlen=max(8, round(HISTORY_S / cycle)))
        self.drives = (
            RealTimeDrives(robot, robot_theta, of_drives, (faults, effects), options.noise,
                           options.seed, cycle, self._behind) if drives else None
        )  # fmt: skip
        """The drives, which report torques and currents; None if ``drives`` is False."""
        self._cycles = 0
        self._last_read = -np.inf
        self.step(robot.home)

    def step(self, target: np.ndarray, due: float = 0.0) -> None:
        """Move for one control cycle towards a joint target (J,).

        ``due`` is when the new state is due, by `time.monotonic` [s]; 0: when it is computed.

        The servos follow the quadratic B-spline of the targets, half a cycle late, with constant
        acceleration in each cycle and no jump in speed, as drives that interpolate do.
        """
        fraction = np.arange(1, self._substeps + 1)[:, None] / self._substeps
        last, new = self.target, np.asarray(target, dtype=float)
        way = 0.5 * (self._before + last) + fraction * (last - self._before)
        way += 0.5 * fraction**2 * (new - 2.0 * last + self._before)
        if self._surface is not None:
            self._press(self._surface)
        sampled = self._plant.follow(way, self.cycle)
        if self.drives is not None:
            self.drives.step(self._plant, sampled.q, sampled.qd)
        self._before, self.target = last, np.array(new)
        with self._lock:
            self._rows.append(SensorRow(self._cycles * self.cycle, *sampled))
            self.newest = (due or time.monotonic(), self._rows[-1].t)
            self._cycles += 1
            reported = self._rows[max(-self._behind - 1, -len(self._rows))]
            self.time, self.q, self.qd, self.load = reported
            if self._sensor_effects is not None:
                self._sensor_effects.advance(self._rows)

    def readings(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Readings (n, 6) [N, N·m] and saturated channels (n,), as bits 0 … 5, at times (n,) [s],
        which increase from call to call; a time after the newest state gives the reading of that
        state, one before the last call is moved after it by a nanosecond."""
        with self._lock:
            t = np.minimum(t, self.newest[1])
            t = np.maximum(t, self._last_read + 1e-9 * np.arange(1, len(t) + 1))
            self._last_read = float(t[-1])
            means = self._mean(t) if self._sensor_effects is None else self._sensor_effects.mean(t)
            values, status = self._noise.corrupt(t, means)
            if self._sensor_effects is not None:
                values = self._sensor_effects.corrupt(t, values)
            return values, status

    def _press(self, surface: Surface) -> None:
        """Apply a surface's contact force to the tool's tip in MuJoCo, for the next step."""
        data, model = self._plant.data, self._plant.model
        mujoco.mj_kinematics(model, data)
        tip = tip_in(model, data)
        before, self._tip = self._tip, tip
        speed = (tip - before) / self.cycle if before is not None else np.zeros(3)
        self.push = surface.push(tip, speed)
        tool = model.body("tool").id
        lever = tip - data.xipos[tool]
        data.xfrc_applied[tool] = np.concatenate([self.push, np.cross(lever, self.push)])

    def _mean(self, t: np.ndarray) -> np.ndarray:
        recent = list(self._rows)[-16:]
        times = np.array([row.t for row in recent])
        loads = np.array([row.load for row in recent])
        load = np.stack([np.interp(t, times, loads[:, k]) for k in range(6)], axis=-1)
        return self.model.read(load, self.theta)
