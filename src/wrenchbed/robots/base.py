"""What a robot is: joints, parameters, a closed-form sensor pose and the same robot in MuJoCo.

Functions turn a robot's base or its sensor through whichever parameters the robot has for it.
"""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wrenchbed.errors import NotFoundError, PlanError, WrenchbedError
from wrenchbed.physics.gravity_torques import ArmBodies, BodyMass
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.rigid_load_regressor import Motion, carried_along, motion_of
from wrenchbed.physics.rotations import apply, euler, exp
from wrenchbed.physics.taylor_jets import STEP, Jet, Value, stack_jets
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.arm_numbers import Load
from wrenchbed.robots.compiled.statics import Packed

if TYPE_CHECKING:
    import mujoco
    from scipy.spatial.transform import Rotation


Values = Mapping[str, Any]
"""Parameter values by name: numbers, or (K, 1) for a batch of K vectors against N poses."""
_OF_SLIDES: Mapping[str, str] = {
    "N·m": "N", "N·m·s/rad": "N·s/m", "kg·m²": "kg", "N·m/A": "N/A", "N·m/K": "N/K",
    "N·m/rad": "N/m", "rad": "m", "rad/s": "m/s",
}  # fmt: skip
"""Units for slides in place of the units for hinges."""
ANGLE = np.deg2rad(0.5)
"""Typical error of a joint's zero, of the base's tilt and of the mount [rad]: it scales a fit's
columns, and is the spread of priors and of simulated robots."""
TILT = "rotation vector that turns gravity as the base sees it, g → Exp(α) g"
_USUAL = {"rad": (7.0, " (is it in degrees?)"), "m": (5.0, " (is it in mm?)")}
"""Largest joint value that is usual, by its unit, and the likely cause of a larger one."""
INERTIA_AXES = ("xx", "yy", "zz", "xy", "xz", "yz")
LOAD = frozenset([*(f"tool.inertia.{a}" for a in INERTIA_AXES), "sensor.mass"])
"""Names of the parameters that `load_parameters` makes."""


@dataclass(frozen=True)
class Joint:
    """An actuated joint: name, unit (m or rad), limits [unit] and top speed [unit/s]."""

    name: str
    unit: str
    lower: float
    upper: float
    speed: float

    def own(self, unit: str) -> str:
        """Convert a hinge's unit to this joint's: of a slide N·m becomes N, rad becomes m."""
        return _OF_SLIDES.get(unit, unit) if self.unit == "m" else unit


class GoalSets(NamedTuple):
    """Candidate joint values for measuring and touching, and those that must be accurate.

    Attributes:
        gravity: N poses at which the sensor may read the tool's weight (N, J).
        touch: poses at which the tip, by the nominal model, is at ``points`` (T, J).
        points: known positions in the world (T, 3) [m].
        target: poses at which the position error counts (G, J).
    """

    gravity: np.ndarray
    touch: np.ndarray
    points: np.ndarray
    target: np.ndarray


class Robot(ArmBodies):
    """Base class of robots that carry a six-axis force/torque sensor.

    Every formula accepts joint values ``q`` (N, J) as an array or as a `Jet`, with which the result
    has velocity and acceleration too, and real or complex parameters ``theta`` (P,) or (K, 1, P).
    """

    title: str
    joints: tuple[Joint, ...]
    parameters: ParameterSet
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665)
    """Default gravity in world axes [m/s²]."""
    sensor: str
    """Registry name of the sensor that the robot carries."""
    free: tuple[str, ...]
    """Patterns of the parameters that `calibrate` identifies by default."""
    candidates: tuple[str, ...]
    """Patterns of the parameters whose identifiability `calibrate` reports."""
    load: frozenset[str]
    """Parameters that change the load on the sensor but not where the sensor is."""
    mount: frozenset[str] = frozenset()
    """Parameters of the sensor's place on what carries it, which only `at_sensor` reads."""
    large_gears: int = 0
    """Number of joints from the base on with gears about three times as stiff as the others'."""
    broadcasts: bool = False
    """Whether formulas at rest take theta (R, 1, P) of R robots, with the bits of each alone."""
    compiled: str = ""
    """Name of the function of `compiled.statics` for readings at rest of this robot, if any."""
    unobservable: tuple[str, ...] = ()
    """Parameters that no wrench and no pose of the sensor depends on."""
    zero_names: tuple[str, ...] = ()
    """Names of the parameters that are added to the joint values, by joint; empty if none."""
    twists: tuple[str, ...] = ()
    lengths: tuple[str, ...] = ()
    """Names of parameters that are angles (``twists``), and lengths, between adjacent joints."""

    def robot_theta(self, theta: np.ndarray) -> np.ndarray:
        """Parameters of the robot alone, which stand first in a model's parameter vector (P,)."""
        return theta[: len(self.parameters)]

    def tool_pose(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_world_tool (…, N, 3, 3) and the tool tip's position in the world (…, N, 3) [m]; a
        `NotFoundError` if the model of this robot has no tool tip."""
        raise NotFoundError(f"robot {self.name!r} has no tool tip in its model")

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Gravity in sensor axes (…, N, 3) [m/s²] at q (N, J), from gravity in world axes (3,)."""
        return np.asarray(np.swapaxes(self.sensor_pose(q, theta)[0], -1, -2) @ gravity)

    def carrier_motion(self, q: Jet, theta: np.ndarray, gravity: np.ndarray) -> Motion:
        """Motion (3, …, N) of what carries the sensor, in its axes; gravity (3,) in world axes."""
        return motion_of(*self.sensor_pose(q, theta), gravity)

    def at_sensor(self, motion: Motion, theta: np.ndarray) -> Motion:
        """The sensor's motion, from the `carrier_motion`."""
        return motion

    def packed(self, theta: np.ndarray, gravity: np.ndarray) -> Packed:
        """Constants for `compiled.statics` at theta (P,), or (R, P) of R robots, and at gravity
        (3,) in world axes [m/s²]; a `TypeError` where `compiled` is empty."""
        raise TypeError(f"robot {self.name!r} has no compiled function")

    @abstractmethod
    def theta_of_tool(self, theta: np.ndarray, mass: float, cog: Sequence[float]) -> np.ndarray:
        """Parameters (P,) with a new tool: mass [kg], CoG in sensor axes from its origin [m]."""

    @abstractmethod
    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        """Row → reason, of the rows of q (N, J) without a solution or outside joint limits."""

    @abstractmethod
    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Draw n random feasible joint values (n, J) with widely varied tool orientations."""

    def pool(self, n: int, seed: int) -> np.ndarray:
        """Draw n candidate joint values (n, J) from which calibration poses are chosen."""
        return self.sample(n, np.random.default_rng(seed))

    def target(self) -> np.ndarray | None:
        """Joint values (G, J) over the workspace where the tool must be accurate; None if none."""
        return None

    def goal_sets(self, pool: int, points: np.ndarray | None, seed: int) -> GoalSets:
        """Make the candidates of a plan for tool accuracy: ``pool`` poses to weigh at, and touches
        of ``points`` (K, 3) [m]. A `NotFoundError` without tool tip or target workspace."""
        raise NotFoundError(f"robot {self.name!r} has no tool tip and target workspace to plan for")

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints (J,) in the robot's driver or file; q1 … if it has neither."""
        return tuple(joint.name for joint in self.joints)

    def symmetries(self, theta: np.ndarray) -> dict[str, dict[str, float]]:
        """Parameter changes that should not change any wrench: name of the symmetry → parameter →
        change. They give null directions a name; the data alone decide whether one is null."""
        return {}

    def values(self, theta: np.ndarray) -> Values:
        """Parameter name → value, from a vector theta (P,) or a batch (K, 1, P)."""
        return dict(zip(self.parameters.names, np.moveaxis(np.asarray(theta), -1, 0), strict=True))

    def check(self, q: np.ndarray | Iterable[np.ndarray], theta: np.ndarray, where: str) -> None:
        """Check that the robot can take joint values (N, J), in one array or in parts; a
        `PlanError` names ``where``, the first bad row and the number of bad rows."""
        parts: Iterable[np.ndarray] = [q] if isinstance(q, np.ndarray) else q
        bad, first = dict[int, str](), 0
        for q in parts:
            if q.ndim != 2 or q.shape[1] != len(self.joints):
                raise PlanError(
                    f"{where}: {self.name} has {len(self.joints)} joints "
                    f"(q1…q{len(self.joints)}), found {q.shape[-1]}"
                )
            # rows of one pose are checked once
            new = np.append(True, (q[1:] != q[:-1]).any(axis=1))[: len(q)]
            if wrong := self.infeasible(q[new], theta):
                which = np.cumsum(new) - 1
                rows = np.flatnonzero(np.isin(which, list(wrong)))
                bad |= {first + int(row): wrong[int(which[row])] for row in rows}
            first += len(q)
        if bad:
            row, why = next(iter(bad.items()))
            more = f" ({len(bad)} such rows)" if len(bad) > 1 else ""
            raise PlanError(f"{where}: row {row}: {why}{more}")

    def outside_limits(self, q: np.ndarray) -> dict[int, str]:
        """Row → reason, of the rows of q (N, J) with a joint outside its limits."""
        bad: dict[int, str] = {}
        for j, joint in enumerate(self.joints):
            usual, hint = _USUAL[joint.unit]
            for row in np.flatnonzero(~((q[:, j] >= joint.lower) & (q[:, j] <= joint.upper))):
                bad.setdefault(
                    int(row),
                    f"{joint.name} = {q[row, j]:.6g} {joint.unit} is outside its limits "
                    f"{joint.lower:.4g} … {joint.upper:.4g} {joint.unit}"
                    f"{hint if abs(q[row, j]) > usual else ''}",
                )
        return dict(sorted(bad.items()))


class SimulatedRobot(Robot):
    """Base class of robots that also exist in MuJoCo, as ``models/<name>/<name>.xml``."""

    bodies: tuple[BodyMass, ...]
    """Mass and CoG of the link behind each of MuJoCo's joints, in axes of `link_frames`."""
    carrier: int
    """Number of the link that carries the sensor, from 0 as in `link_frames`."""

    @abstractmethod
    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        """MuJoCo's joint coordinates (N, nq) at actuated joint values q (N, J)."""

    @abstractmethod
    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        """MJCF spec of the robot, with every parameter of theta (P,) written into it."""

    def link_frames(self, q: Value, theta: np.ndarray) -> Sequence[tuple[Value, Value]]:
        """R_world_link (…, N, 3, 3) and origin (…, N, 3) [m] of the link behind each of MuJoCo's
        joints, in their order; loops stay closed. A `NotFoundError` if the model has no such
        frames."""
        raise NotFoundError(f"robot {self.name!r} has no frames of links: its joints no torques")

    def links(self, q: Value, theta: np.ndarray) -> tuple[np.ndarray, list[Value]]:
        frames = zip(self.link_frames(q, theta), self.bodies, strict=True)
        centres = [origin + turn @ np.array(body.cog) for (turn, origin), body in frames]
        return np.array([body.mass for body in self.bodies]), centres

    @property
    @abstractmethod
    def home(self) -> np.ndarray:
        """Joint values (J,) of the pose in which the MJCF opens."""

    @property
    def eye(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Camera position (3,) for pictures of the robot, and the point (3,) it looks at [m]."""
        return (0.75, -1.3, 0.95), (-0.2, -0.1, 0.35)

    @property
    def mjcf(self) -> Path:
        """Path of the robot's MJCF file."""
        return models() / self.name / f"{self.name}.xml"


def complex_steps(theta: np.ndarray, columns: Sequence[int]) -> np.ndarray:
    """Copy theta (P,) to (K, 1, P), the k-th copy with an imaginary `STEP` in ``columns[k]``."""
    shifted = np.tile(theta.astype(complex), (len(columns), 1, 1))
    shifted[np.arange(len(columns)), 0, list(columns)] += 1j * STEP
    return shifted


def load_parameters(inertia: Sequence[float]) -> ParameterSet:
    """Parameters of the load that every robot has, in sensor axes: the tool's inertia about its
    CoG, xx yy zz xy xz yz [kg·m²], nominally ``inertia``, and the sensor's own mass."""
    text = "inertia about the centre of gravity"
    items = (
        Parameter(f"tool.inertia.{a}", v, "kg·m²", 1e-3, -10.0 if a[0] != a[1] else 0.0, 10.0, text)
        for a, v in zip(INERTIA_AXES, inertia, strict=True)
    )
    sensor = Parameter("sensor.mass", 0.0, "kg", 0.02, 0.0, 5.0, "own mass that loads the gauges")
    return ParameterSet((*items, sensor))


def inertia_matrix(p: Values) -> np.ndarray:
    """Inertia matrix (…, 3, 3) [kg·m²] of the load about its CoG, from ``tool.inertia`` values."""
    xx, yy, zz, xy, xz, yz = (p[f"tool.inertia.{a}"] for a in INERTIA_AXES)
    rows = [stack_jets([xx, xy, xz]), stack_jets([xy, yy, yz]), stack_jets([xz, yz, zz])]
    return np.stack(rows, axis=-2)


class LoadInSensorAxes(Robot):
    """Base class of robots with their tool's mass and CoG, in sensor axes, as parameters."""

    load = LOAD | {"tool.mass", *(f"tool.cog.{a}" for a in "xyz")}

    def tool(self, theta: np.ndarray) -> Tool:
        p = self.values(theta)
        cog = stack_jets([p[f"tool.cog.{a}"] for a in "xyz"])
        return Tool(p["tool.mass"], cog, inertia_matrix(p), p["sensor.mass"])

    def theta_of_tool(self, theta: np.ndarray, mass: float, cog: Sequence[float]) -> np.ndarray:
        values = {"tool.mass": mass} | {f"tool.cog.{a}": c for a, c in zip("xyz", cog, strict=True)}
        return self.parameters.vector(values, start=theta)


class MountedArm(LoadInSensorAxes, SimulatedRobot):
    """Base class of arms whose base may tilt, with a sensor mounted on the flange.

    Subclasses set ``parameters`` and call `_prepare`.
    """

    def _prepare(self) -> None:
        self.carrier = len(self.joints) - 1
        groups = ("base.tilt", "mount.position", "mount.rotation")
        columns = [self.parameters.select([group]) for group in groups]
        self._tilt, self._offset, self._turn = (slice(c[0], c[-1] + 1) for c in columns)
        self.mount = frozenset(self.parameters.names[c] for group in columns[1:] for c in group)

    def carrier_motion(self, q: Jet, theta: np.ndarray, gravity: np.ndarray) -> Motion:
        return motion_of(*self.flange_pose(q, theta), gravity)

    def at_sensor(self, motion: Motion, theta: np.ndarray) -> Motion:
        return carried_along(motion, mount_turn(theta[..., self._turn]), theta[..., self._offset])

    @abstractmethod
    def flange_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_flange (…, N, 3, 3) and the flange's origin in the world (…, N, 3) [m]."""

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        flat = theta.reshape(-1, theta.shape[-1])
        alike = (flat == flat[:1].real).all(axis=0)
        alike[self._offset] = alike[self._turn] = True  # the flange does not depend on the mount
        one = flat[0].real if len(flat) and alike.all() else theta
        rotation, position = self.flange_pose(q, one)
        offset, turn = theta[..., self._offset], theta[..., self._turn]
        if offset.any():
            position = position + apply(rotation, offset)
        return (rotation @ mount_turn(turn) if turn.any() else rotation), position

    def _leaning(self, base: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """R_world_base (…, 3, 3) of a base whose nominal rotation is ``base`` (3, 3). The
        parameters ``base.tilt`` turn gravity in the base's axes: the base turns the opposite
        way."""
        tilt = theta[..., self._tilt]
        if not tilt.any():
            return base
        return np.asarray(exp(-tilt[..., 0], -tilt[..., 1], 0.0 * tilt[..., 0]) @ base)


def tool_parameters(mass: float, cog: Sequence[float]) -> tuple[Parameter, ...]:
    """Make the parameters ``tool.mass`` [kg] and ``tool.cog`` [m] of a `LoadInSensorAxes`."""
    centre = (
        Parameter(f"tool.cog.{a}", c, "m", 5e-3, -2.0, 2.0, "CoG in sensor axes")
        for a, c in zip("xyz", cog, strict=True)
    )
    return (Parameter("tool.mass", mass, "kg", 0.05, 1e-4, 50.0, "mass on the sensor"), *centre)


def mounted_parameters(tool: Load) -> ParameterSet:
    """Make the parameters of an arm's base tilt, mount and load, with a nominal tool."""
    position, rotation = "sensor's origin in flange axes", "rotation vector, sensor in flange"
    items = (
        *vector_parameters("base.tilt", "xy", "rad", ANGLE, TILT),
        *vector_parameters("mount.position", "xyz", "m", 1e-3, position),
        *vector_parameters("mount.rotation", "xyz", "rad", ANGLE, rotation),
        *tool_parameters(tool.mass, tool.cog),
    )
    return ParameterSet(items) + load_parameters(tool.inertia)


def vector_parameters(
    group: str, axes: str, unit: str, tolerance: float, text: str
) -> list[Parameter]:
    """Make parameters ``group.x`` …, one for each letter of ``axes``, 0 ± ``tolerance`` [unit];
    ``text`` describes them."""
    bound = 3.2 if unit == "rad" else 2.0
    return [Parameter(f"{group}.{a}", 0.0, unit, tolerance, -bound, bound, text) for a in axes]


def sample_until(
    n: int, draw: Callable[[int], np.ndarray], good: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Call ``draw(n)`` until n rows are ``good`` (rows → booleans); return these n rows (n, …). A
    `WrenchbedError` if fewer than 1 in 1,000 draws is good."""
    kept: list[np.ndarray] = []
    accepted = drawn = 0
    while accepted < n:
        count = max(2 * (n - accepted), 64)
        batch = draw(count)
        kept.append(batch[good(batch)])
        drawn, accepted = drawn + count, accepted + len(kept[-1])
        if drawn > 1000 * (accepted + 10):
            raise WrenchbedError(
                "fewer than 1 in 1,000 random poses is feasible: loosen the ranges"
            )
    return np.concatenate(kept)[:n]


def segment_distance(start: np.ndarray, end: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance (N,) [m] between segments start–end (N, 3) and the nearest of points (M, N, 3)."""
    along = end - start
    fraction = ((points - start) * along).sum(axis=-1) / (along * along).sum(axis=-1)
    nearest = start + np.clip(fraction, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(points - nearest, axis=-1).min(axis=0)


@cache
def models() -> Path:
    """Folder that holds the MJCF models: in the installed package, or at the top of a checkout."""
    inside = Path(str(files("wrenchbed"))) / "models"
    checkout = Path(__file__).resolve().parents[3] / "models"
    for folder in (inside, checkout):
        if folder.is_dir():
            return folder
    raise NotFoundError(f"the models folder is missing: neither {inside} nor {checkout} exists")


def mount_turn(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix R_flange_sensor (…, 3, 3) of a rotation vector (…, 3) [rad]."""
    return exp(vector[..., 0], vector[..., 1], vector[..., 2]) if vector.any() else np.eye(3)


def rotate_base(robot: Robot, theta: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Parameters (P,) changed so that gravity, in base axes, turns by a rotation vector (3,) [rad].
    A turn about the vertical is lost on robots whose base has a tilt only; no wrench shows it."""
    names, turned = robot.parameters.names, np.array(theta, dtype=float)
    if "base.tilt.x" in names:
        at = [names.index(f"base.tilt.{a}") for a in "xy"]
        before = exp(theta[at[0]], theta[at[1]], 0.0)
        turned[at] = _rotation(exp(*vector) @ before).as_rotvec()[:2]
    else:
        at = [names.index(n) for n in ("alpha0", "beta0", "gamma0")]
        turned[at] = _angles(exp(*-vector) @ euler(*theta[at]))
    return turned


def rotate_sensor(robot: Robot, theta: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Parameters (P,) with the sensor turned by a rotation vector (3,) [rad] in its axes."""
    names, turned = robot.parameters.names, np.array(theta, dtype=float)
    if "mount.rotation.x" in names:
        at = [names.index(f"mount.rotation.{a}") for a in "xyz"]
        turned[at] = _rotation(exp(*theta[at]) @ exp(*vector)).as_rotvec()
        return turned
    at = [names.index(n) for n in ("alphaS", "betaS", "gammaS")]
    turned[at] = _angles(euler(*theta[at]) @ exp(*vector))
    tool = robot.tool(theta)
    return robot.theta_of_tool(turned, float(tool.mass), [float(c) for c in tool.cog])


def _angles(rotation: np.ndarray) -> np.ndarray:
    """Angles α, β, γ (3,) [rad] for which a rotation (3, 3) equals Rx(γ) Ry(β) Rz(α)."""
    return np.asarray(_rotation(rotation).as_euler("XYZ")[::-1])


def _rotation(matrix: np.ndarray) -> "Rotation":
    from scipy.spatial.transform import Rotation  # slow to load: only when it is used

    return Rotation.from_matrix(matrix)
