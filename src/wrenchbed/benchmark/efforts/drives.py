"""Simulates what the drives of a robot with a fault report, before noise.

Ranges of friction, rotors and noise follow data sheets of collaborative arms roughly: estimates.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import signal

from wrenchbed.benchmark.efforts.arm import Path, TrueArm, draw, manufactured
from wrenchbed.benchmark.fault import Fault, Rng, log_uniform
from wrenchbed.benchmark.mujoco_loads import Edit
from wrenchbed.robots.base import SimulatedRobot

UNITS = ("tau", "i")
"""Prefixes of recorded efforts: torques [N·m] or currents [A]."""
OFF = (0.05, 0.1)
"""Range by which true friction differs from the configured values, relative."""
_LEAST_RATED = 0.12
"""Rated torque of a wrist over that of the strongest joint, at least."""
_MOVING = 0.03
"""Share of a joint's top speed below which it counts as at rest."""
_TURN = 0.01
"""Speed [rad/s] over which friction that a fault adds turns its sign."""
_SIDE_FILTER = 0.3
"""Cutoff of the controller's own filter over the rate of rows."""


def lugre(
    speed: np.ndarray, step: float, level: np.ndarray, stiffness: np.ndarray, damping: np.ndarray
) -> np.ndarray:
    """Friction (T, J) [N·m], but its viscous part, of LuGre bristles at speeds v (T, J) [rad/s].

    ż = v − σ₀ |v| z / g(v), F = σ₀ z + σ₁ ż, in steps of ``step`` [s], with ``level`` g(v) (T, J)
    [N·m] in steady motion, ``stiffness`` σ₀ [N·m/rad], ``damping`` σ₁ [N·m·s/rad], both (J,); exact
    for a speed that stays. Canudas de Wit et al. 1995, doi 10.1109/9.376053, Eqs. 2 to 6.
    """
    rate = stiffness * np.abs(speed) / level
    fraction = -np.expm1(-rate * step)
    target = np.sign(speed) * level / stiffness
    bristle, z = np.empty_like(speed), np.zeros(speed.shape[1])
    for k in range(len(speed)):
        z = z + fraction[k] * (target[k] - z)
        bristle[k] = z
    return np.asarray(stiffness * bristle + damping * (speed - rate * bristle))


def bouc_wen(speed: np.ndarray, step: float, width: float, loop: float = 0.6) -> np.ndarray:
    """Hysteretic state z (T,), −1 … 1, of a spring that yields over ``width`` [rad]; speeds v (T,).

    ż = v (1 − |z| (γ + β sgn(v z))) / width, β = ``loop``, β + γ = 1, in Heun's steps of ``step``
    [s]. Wen 1976, doi 10.1061/JMCEA3.0002106.
    """
    beta, gamma = loop, 1.0 - loop

    def rate(v: float, z: float) -> float:
        turn = beta if v * z > 0.0 else -beta
        return v * (1.0 - abs(z) * (gamma + turn)) / width

    state, z = np.empty_like(speed), 0.0
    for k, v in enumerate(speed.tolist()):
        first = rate(v, z)
        z = z + 0.5 * step * (first + rate(v, z + step * first))
        state[k] = z
    return state


@dataclass(frozen=True, eq=False)
class TrueDrives:
    """True parameters of an arm's drives, each (J,): Coulomb and viscous friction [N·m, N·m·s/rad],
    Stribeck dip as a share of Coulomb and its speed [rad/s], offset [N·m], rotor at the joint
    [kg·m²], constant [N·m/A], bristles' stiffness [N·m/rad], cogging [N·m], change of friction per
    kelvin."""

    coulomb: np.ndarray
    viscous: np.ndarray
    dip: np.ndarray
    dip_speed: np.ndarray
    offset: np.ndarray
    rotor: np.ndarray
    constant: np.ndarray
    stiffness: np.ndarray
    cogging: np.ndarray
    per_kelvin: np.ndarray


@dataclass(frozen=True, eq=False)
class State:
    """State of the robot on which a fault may depend, on the fine grid.

    ``rigid`` is the links' torque (T, J) [N·m], ``temperature`` of the drives (T,) [°C]. Of the
    fault's joint (else the first): ``q`` [rad], ``qd`` [rad/s], the links' torque ``load`` [N·m],
    each (T,), and friction ``coulomb`` [N·m] and ``viscous`` [N·m·s/rad].
    """

    path: Path
    temperature: np.ndarray
    drives: TrueDrives
    arm: TrueArm
    rigid: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    load: np.ndarray
    coulomb: float
    viscous: float


def direction(state: State) -> np.ndarray:
    """Direction of motion (T,) of the fault's joint, −1 … 1, smooth through rest."""
    return np.asarray(np.tanh(state.qd / _TURN))


def since_reversal(speed: np.ndarray, step: float) -> np.ndarray:
    """Distance (T,) [rad] since a joint last turned around; speed (T,) [rad/s], ``step`` [s]."""
    sign = np.sign(np.where(np.abs(speed) < 1e-4, 0.0, speed))
    way, gone, last = np.empty_like(speed), np.inf, 0.0
    for k, s in enumerate(sign.tolist()):
        if s not in (0.0, last):
            gone, last = 0.0, s
        gone += abs(float(speed[k])) * step
        way[k] = gone
    return way


def vector(rng: Rng, low: float, high: float) -> np.ndarray:
    """Draw a vector (3,) of random direction and length (log-uniform, ``low`` … ``high``)."""
    direction = rng.normal(size=3)
    direction *= log_uniform(rng, low, high) / np.linalg.norm(direction)
    return direction


Hook = Callable[[State], np.ndarray]


@dataclass(frozen=True, eq=False)
class EffortFault(Fault):
    """A fault as changes at stages of the simulation; None changes nothing there.

    ``joint`` is 0-based, None of faults of tool and base. ``theta`` changes the true parameters
    (P,), ``edit`` the compiled model, ``drives`` the drives' parameters, ``motion`` the true motion
    but not what encoders report, ``rows`` recorded rows (N, J). ``level`` adds Coulomb friction and
    ``torque`` torque of the drives [N·m], ``reading`` changes the effort: each the column (T,) of
    the fault's joint, or all columns (T, J) if the fault has none.
    """

    joint: int | None = None
    theta: Callable[[np.ndarray], np.ndarray] | None = None
    edit: Edit | None = None
    drives: Callable[[TrueDrives], TrueDrives] | None = None
    level: Hook | None = None
    torque: Hook | None = None
    reading: Callable[[State, np.ndarray], np.ndarray] | None = None
    rows: Callable[[np.ndarray], np.ndarray] | None = None
    motion: Callable[[Path], Path] | None = None

    @property
    def place(self) -> str:
        """Name of the effect with the number of its joint from 1, as ``drive.coulomb.2``."""
        return self.name if self.joint is None else f"{self.name}.{self.joint + 1}"

    def changed(self, matrix: np.ndarray, change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Copy of a matrix (T, J) with ``change`` applied to the column of the fault's joint, or to
        all columns of a fault without a joint."""
        if self.joint is None:
            return change(matrix)
        result = matrix.copy()
        result[:, self.joint] = change(matrix[:, self.joint])
        return result


HEALTHY = EffortFault(name="none")


@dataclass(frozen=True, eq=False)
class EffortSetting:
    """A robot with its imperfections, its motion and its instruments.

    ``stated`` and ``theta`` are parameters as stated and as they are (P,), ``edits`` changes of the
    model, ``path`` what encoders report, ``configured`` values of the drives by name as stated,
    ``rated`` torques (J,) [N·m] that sizes are shares of, ``noise`` the standard deviation of a
    row's torque (J,) [N·m], ``temperature`` of the drives (T,) [°C], ``prefix`` one of `UNITS`,
    ``gear`` motor turns a joint turn, ``jitter`` the std of sampling instants [s], of a ``seed``.
    """

    robot: SimulatedRobot
    stated: np.ndarray
    theta: np.ndarray
    edits: tuple[Edit, ...]
    path: Path
    drives: TrueDrives
    configured: Mapping[str, float]
    rated: np.ndarray
    noise: np.ndarray
    temperature: np.ndarray
    prefix: str
    gear: float
    jitter: float
    seed: int

    @cached_property
    def scale(self) -> np.ndarray:
        """Torque per unit of the recorded effort (J,): constants [N·m/A] of currents, else ones."""
        joints = range(1, len(self.rated) + 1)
        constants = [self.configured[f"drive.constant.{j}"] for j in joints]
        return np.array(constants) if self.prefix == "i" else np.ones(len(joints))

    @cached_property
    def healthy_torque(self) -> np.ndarray:
        """Torque of the true links (T, J) [N·m] without a fault."""
        return TrueArm(self.robot, self.theta, self.edits).inverse(self.path)[0]

    @cached_property
    def moving(self) -> np.ndarray:
        """Whether each joint moves at each recorded row (N, J); at rest its effort is unknown."""
        speed = np.abs(self.path.qd[self.path.rows])
        return np.asarray(speed > _MOVING * speed.max(axis=0))

    @cached_property
    def healthy(self) -> np.ndarray:
        """Efforts at the recorded rows (N, J) of the robot without a fault, noise-free."""
        return simulate(self, HEALTHY)


def state_of(setting: EffortSetting, fault: EffortFault) -> State:
    """Simulate the motion, links' torque and friction of a robot with a fault: its state."""
    theta = setting.theta if fault.theta is None else fault.theta(setting.theta)
    edits = setting.edits if fault.edit is None else (*setting.edits, fault.edit)
    path = setting.path if fault.motion is None else fault.motion(setting.path)
    arm = TrueArm(setting.robot, theta, edits)
    rigid_fault = fault.theta is not None or fault.edit is not None or fault.motion is not None
    rigid = arm.inverse(path)[0] if rigid_fault else setting.healthy_torque
    drives = setting.drives if fault.drives is None else fault.drives(setting.drives)
    j = fault.joint or 0
    friction = float(drives.coulomb[j]), float(drives.viscous[j])
    columns = path.q[:, j], path.qd[:, j], rigid[:, j]
    return State(path, setting.temperature, drives, arm, rigid, *columns, *friction)


def drive_torque(state: State, gear: float, fault: EffortFault) -> np.ndarray:
    """Torque (T, J) [N·m] of links, rotors and friction; ``gear`` is motor turns per joint turn."""
    d, path = state.drives, state.path
    thin = np.exp(-d.per_kelvin * (state.temperature - state.temperature[0])[:, None])
    dip = 1.0 + d.dip * np.exp(-((path.qd / d.dip_speed) ** 2))
    level = np.asarray(d.coulomb * dip * thin)
    if fault.level is not None:
        more = fault.level(state)
        level = fault.changed(level, lambda x: x + more)
        level = np.maximum(level, 0.05 * d.coulomb)  # it stays friction
    friction = lugre(path.qd, path.step, level, d.stiffness, 0.4 * np.sqrt(d.stiffness))
    torque = state.rigid + d.rotor * path.qdd + friction + d.viscous * thin * path.qd + d.offset
    torque = torque + d.cogging * np.sin(gear * path.q)
    if fault.torque is not None:
        added = fault.torque(state)
        torque = fault.changed(torque, lambda x: x + added)
    return np.asarray(torque)


def simulate(setting: EffortSetting, fault: EffortFault) -> np.ndarray:
    """Noise-free efforts (N, J) [N·m or A] at the recorded rows of a robot with a fault."""
    state = state_of(setting, fault)
    torque = drive_torque(state, setting.gear, fault)
    current = torque / (state.drives.constant if setting.prefix == "i" else 1.0)
    if fault.reading is not None:
        reading = fault.reading
        current = fault.changed(current, lambda x: reading(state, x))
    corner = min(_SIDE_FILTER * setting.path.rate, 0.4 / setting.path.step)
    b, a = signal.butter(1, corner, fs=1.0 / setting.path.step)
    start = signal.lfilter_zi(b, a)[:, None] * current[:1]
    filtered = signal.lfilter(b, a, current, axis=0, zi=start)[0]
    at = setting.path.t[setting.path.rows]
    at = at + setting.jitter * np.random.default_rng(setting.seed).normal(size=len(at))
    rows = np.stack([np.interp(at, setting.path.t, column) for column in filtered.T], axis=1)
    return rows if fault.rows is None else np.asarray(fault.rows(rows))


def draw_setting(robot: SimulatedRobot, rng: Rng) -> EffortSetting:
    """Draw a healthy robot with the small errors of all robots, its motion and instruments."""
    path, joints = draw(robot, rng), len(robot.joints)
    stated = _stated(robot, rng)
    tool = robot.tool(stated)
    theta = robot.theta_of_tool(
        stated,
        float(tool.mass) * (1.0 + 0.003 * rng.normal()),
        [float(c) + 3e-4 * rng.normal() for c in np.asarray(tool.cog)],  # [m], estimate
    )
    rated = rated_torques(robot, stated, rng)
    size = rated * rng.uniform(0.75, 1.3, joints)  # from here on after fits of a UR5
    known = {
        "coulomb": 0.05 * size * rng.uniform(0.7, 1.4, joints),
        "viscous": 0.06 * size * rng.uniform(0.6, 1.5, joints),
        "offset": 0.003 * size * rng.normal(size=joints),
        "inertia": 0.012 * size * rng.uniform(0.7, 1.3, joints),
        "constant": (10.0 if rated.max() < 250.0 else 13.0) * rng.uniform(0.85, 1.15, joints),
    }
    known = {k: np.array([float(f"{x:.4g}") for x in v]) for k, v in known.items()}
    configured = {
        f"drive.{k}.{j + 1}": float(v[j]) for k, v in known.items() for j in range(joints)
    }

    def off(low: float, high: float) -> np.ndarray:
        return 1.0 + rng.choice((-1.0, 1.0), joints) * rng.uniform(low, high, joints)

    coulomb = known["coulomb"] * off(*OFF)
    noise = rated * rng.uniform(0.004, 0.008) * rng.uniform(0.8, 1.25, joints)
    drives = TrueDrives(
        coulomb=coulomb,
        viscous=known["viscous"] * off(*OFF),
        dip=rng.uniform(0.03, 0.12, joints),
        dip_speed=rng.uniform(0.02, 0.06, joints),
        offset=known["offset"] + 0.001 * size * rng.normal(size=joints),
        rotor=known["inertia"] * off(0.0, 0.05),
        constant=known["constant"] * off(0.0, 0.01),
        stiffness=coulomb / rng.uniform(3e-5, 2e-4, joints),
        cogging=0.3 * noise * rng.random(joints),
        per_kelvin=rng.uniform(0.003, 0.008, joints),
    )
    temperature = warming(path, rng, rise=rng.uniform(0.0, 2.0))
    prefix = str(rng.choice(UNITS))
    return EffortSetting(
        robot, stated, theta, (manufactured(rng),), path, drives, configured, rated, noise,
        temperature, prefix, float(rng.choice((100.0, 101.0, 120.0))),
        float(rng.uniform(0.0, 4e-4)), int(rng.integers(2**31)),
    )  # fmt: skip


def warming(path: Path, rng: Rng, rise: float) -> np.ndarray:
    """Draw temperatures (T,) [°C] along a path that rise by ``rise`` [K], at two rates."""
    fast, slow = rng.uniform(12.0, 40.0), rng.uniform(100.0, 400.0)
    warmth = 0.7 * -np.expm1(-path.t / fast) + 0.3 * -np.expm1(-path.t / slow)
    wave = 0.1 * np.sin(2.0 * np.pi * path.t / rng.uniform(20.0, 50.0))
    return np.asarray(rng.uniform(22.0, 32.0) + rise * warmth / warmth[-1] + wave)


def _stated(robot: SimulatedRobot, rng: Rng) -> np.ndarray:
    """Draw stated parameters (P,): nominal ones with a tool of a size that users mount."""
    mass = float(f"{rng.uniform(0.4, 2.5):.3g}")
    cog = [round(float(c), 4) for c in rng.normal(0.0, 0.015, 2)]
    start = robot.parameters.nominal
    return robot.theta_of_tool(start, mass, [*cog, round(float(rng.uniform(0.03, 0.09)), 4)])


def rated_torques(robot: SimulatedRobot, theta: np.ndarray, rng: Rng) -> np.ndarray:
    """Draw rated torques of drives (J,) [N·m]: the largest at random poses, with a margin."""
    poses = robot.sample(40, rng)
    still = Path(1.0, np.arange(40.0), poses, 0.0 * poses, 0.0 * poses)
    peak = 1.7 * np.abs(TrueArm(robot, theta).inverse(still)[0]).max(axis=0)
    return np.asarray(np.maximum(peak, _LEAST_RATED * peak.max()))
