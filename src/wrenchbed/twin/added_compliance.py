"""Compliance and backlash in MuJoCo: joints added to arm, base and tool, at static balance.

Names of added elements contain `springs.MARK`. An added joint stands where the weight and the
inertia of what it carries put it; its own dynamics, above 10 Hz, are left out. Weights act in full
here; the servos' compensation of gravity (``gravcomp``) would hide them. A robot known only by its
sensor's orientation is three hinges and the tool.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import held_on
from wrenchbed.physics.taylor_jets import Jet, Value, value
from wrenchbed.physics.wrench import Tool, physical_inertia, symmetric
from wrenchbed.robots.base import INERTIA_AXES, Joint, Robot, SimulatedRobot
from wrenchbed.robots.base import Values as Named
from wrenchbed.robots.mjspec_edits import compiled, write_load
from wrenchbed.simulation.mujoco_wrench import load_on_sensor
from wrenchbed.simulation.springs import LAGS, MARK, MASS, ROUND

_MJCF = """
<mujoco model="sensor">
  <compiler angle="radian"/>
  <option><flag contact="disable"/></option>
  <worldbody>
    <body name="base">
      <body name="flange">
        <joint name="x" axis="1 0 0"/><joint name="y" axis="0 1 0"/><joint name="z" axis="0 0 1"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <body name="tool">
          <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
          <body name="sensor_side"><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/></body>
          <site name="ft"/>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor><force name="force" site="ft"/><torque name="torque" site="ft"/></sensor>
</mujoco>
"""
_UPDATES, _BALANCED = 60, 1e-13
"""Most iterations of the fixed point for balance, and the change [rad or m] that ends them."""


class SensorOnly:
    """Stand-in for a robot known only by its sensor's orientation: three hinges and the tool."""

    joints: tuple[Joint, ...] = ()

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.name, self.parameters = robot.name, robot.parameters

    def values(self, theta: np.ndarray) -> Named:
        """Values of the parameters (P,) by name."""
        return self._robot.values(theta)

    def tool(self, theta: np.ndarray) -> Tool:
        """Tool that the sensor carries, by parameters (P,)."""
        return self._robot.tool(theta)

    def qpos(self, q: Value, theta: np.ndarray) -> np.ndarray:
        """Hinge angles (N, 3) about x, y, z in turn of sensor orientations q (N, 4)."""
        from scipy.spatial.transform import Rotation  # slow to load: only when it is used

        rotation, _ = self._robot.sensor_pose(q, theta)
        return np.asarray(Rotation.from_matrix(rotation).as_euler("XYZ"))

    def spec(self, theta: np.ndarray) -> mujoco.MjSpec:
        """MJCF of three hinges that carry the sensor and its tool, with parameters theta (P,)."""
        spec = mujoco.MjSpec.from_string(_MJCF)
        write_load(spec, self._robot.tool(theta))
        return spec


def in_mujoco(robot: Robot) -> SimulatedRobot | SensorOnly:
    """Robot that MuJoCo simulates: itself if it has an MJCF, else its `SensorOnly`."""
    return robot if isinstance(robot, SimulatedRobot) else SensorOnly(robot)


def edited(
    robot: Robot, theta: np.ndarray, gravity: Sequence[float], active: Sequence[ActiveEffect]
) -> mujoco.MjSpec:
    """The robot's MJCF with parameters theta (P,) and those of the ``active`` effects that MuJoCo
    carries."""
    spec = in_mujoco(robot).spec(theta)
    spec.option.gravity = gravity
    for a in active:
        a.effect.edit_spec(spec, robot, theta, a.values)
    return spec


def marked(spec: mujoco.MjSpec) -> list[str]:
    """Names of all bodies, joints and tendons that effects added to the MJCF model."""
    parts = (*spec.bodies, *spec.joints, *spec.tendons)
    return [part.name for part in parts if MARK in part.name]


def set_weights(
    model: mujoco.MjModel, robot: SimulatedRobot | SensorOnly, theta: np.ndarray
) -> None:
    """In place, let gravity act on all bodies but the base, and set the tool's inertia from
    parameters theta (P,), which may be one that no real body has."""
    names = [model.body(b).name for b in range(model.nbody)]
    model.body_gravcomp[:] = [float(name == "base") for name in names]
    p = robot.values(theta)
    six = [float(p[f"tool.inertia.{a}"]) for a in INERTIA_AXES]
    if not _compiles(six):
        moments, axes = np.linalg.eigh(symmetric(six))
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        body = next((b for b, n in enumerate(names) if n.endswith(MASS)), names.index("tool"))
        model.body_inertia[body], model.body_sameframe[body] = moments, 0
        mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())


def with_some_inertia(robot: Robot, theta: np.ndarray) -> np.ndarray:
    """Parameters (P,) that MuJoCo compiles: an inertia that no real body has is replaced."""
    at = [robot.parameters.index(f"tool.inertia.{a}") for a in INERTIA_AXES]
    if _compiles(theta[at]):
        return theta
    result = np.array(theta)
    result[at] = 1e-3 * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return result


def _compiles(six: Sequence[float] | np.ndarray) -> bool:
    return physical_inertia(six) and float(np.linalg.eigvalsh(symmetric(six))[0]) > 1e-12


@dataclass(frozen=True)
class _Added:
    """A joint that an effect added to the MJCF: spring, backlash, friction."""

    name: str
    at: int
    stiffness: float
    half: float | None
    friction: float
    driven: int | None
    in_tool: bool

    def side(self, force: np.ndarray, coming: np.ndarray) -> np.ndarray:
        """Position in its backlash (M,), −half … half, under forces (M,), and directions ``coming``
        (M, J) in which the robot's joints last moved."""
        half, turn = float(self.half or 0.0), np.sign(self.stiffness)
        if self.name.endswith(LAGS):
            return np.asarray(-half * turn * coming[:, self.driven])
        if self.friction:
            moved = np.where(np.abs(force) > self.friction, np.sign(force), 0.0)
            return np.asarray(half * turn * held_on(moved[:, None])[:, 0])
        return np.asarray(half * np.tanh(force / (self.stiffness * half)))


class Mechanism:
    """One robot with the joints that effects add, compiled in MuJoCo.

    Args:
        theta: parameters of the robot (P,), changed by the effects that act on them.
        gravity: in world axes (3,) [m/s²].
        active: effects; those that MuJoCo can carry are written into the model.
    """

    def __init__(
        self,
        robot: Robot,
        theta: np.ndarray,
        gravity: Sequence[float],
        active: Sequence[ActiveEffect],
    ) -> None:
        self.robot, self.theta = in_mujoco(robot), theta
        self.joints = [joint.name for joint in robot.joints]
        spec = edited(robot, with_some_inertia(robot, theta), gravity, active)
        self.carried = {name.partition(MARK)[0] for name in marked(spec)}
        """Names of the effects that are in the model."""
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # `balance` heeds them
        self.model = compiled(spec)
        self.model.dof_damping[:] = 0.0  # of motors, not of what they carry
        self.data = mujoco.MjData(self.model)
        set_weights(self.model, self.robot, theta)
        joints = [self.model.joint(j) for j in range(self.model.njnt)]
        original = [j for j in joints if MARK not in j.name]
        self._added = [self._describe(j) for j in joints if MARK in j.name]
        self._at = [a.at for a in self._added]
        self._own = [int(j.qposadr[0]) for j in original]
        self._driven = [int(self.model.joint(n).qposadr[0]) for n in self.joints]
        self._passive = [int(j.qposadr[0]) for j in original if j.name not in self.joints]
        self._series = np.array(
            [[float(k == a.driven) for k in range(len(self.joints))] for a in self._added]
        ).reshape(len(self._added), len(self.joints))

    @property
    def smooth(self) -> np.ndarray:
        """Boolean (E,): whether each added joint moves without jumps, so that it has a speed."""
        return np.array(
            [not a.in_tool and (a.half is None or a.name.endswith(ROUND)) for a in self._added]
        )

    def balance(self, q: Value, coming: np.ndarray) -> np.ndarray:
        """Equilibrium positions of the added joints (M, E) [rad or m] at joint values (M, J), or a
        `Jet` with speeds; ``coming`` (M, J) is the direction in which each joint last moved.
        Springs by the fixed point e ← e + force/k; joints with backlash by the force in its
        middle."""
        give = np.zeros((len(value(q)), len(self._added)))
        if not self._added:
            return give
        force = self._force(q, give)
        self._settle_play(give, force, coming)
        sprung = [k for k, a in enumerate(self._added) if a.half is None]
        stiffness = np.array([self._added[k].stiffness for k in sprung])
        for _ in range(_UPDATES if sprung else 0):
            step = force[:, sprung] / stiffness
            give[:, sprung] += step
            if np.abs(step).max() < _BALANCED:
                break
            force = self._force(q, give)
        return give

    def load(self, q: Value, give: Value) -> np.ndarray:
        """Load on the sensor (M, 6) [N, N·m] at joint values q (M, J) and positions ``give`` (M, E)
        of the joints that effects added."""
        rows = _moving(self._place(q, give))
        result = np.empty((len(rows.v), 6))
        for i in range(len(result)):
            _put(self.data, rows, i)
            mujoco.mj_inverse(self.model, self.data)
            result[i] = load_on_sensor(self.data)
        return result

    def place(self, q: np.ndarray, give: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Orientation (M, 3, 3) and position (M, 3) [m] of the sensor in the world, at rest, with
        the added joints at positions ``give`` (M, E)."""
        turn, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
        for i, row in enumerate(self._place(q, give)):
            self.data.qpos[:] = row
            mujoco.mj_kinematics(self.model, self.data)
            site = self.data.site("ft")
            turn[i], position[i] = site.xmat.reshape(3, 3), site.xpos
        return turn, position

    def _describe(self, joint: "mujoco.MjModel") -> _Added:
        """Read the data of one added joint (spring, backlash, friction) from the compiled model."""
        model, on = self.model, joint.name.partition(MARK)[2].removesuffix(LAGS)
        body = model.jnt_bodyid[joint.id]
        return _Added(
            joint.name,
            int(joint.qposadr[0]),
            float(model.jnt_stiffness[joint.id]),
            float(joint.range[1]) if model.jnt_limited[joint.id] else None,
            float(model.dof_frictionloss[joint.dofadr[0]]),
            self.joints.index(on) if on in self.joints else None,
            model.body(body).name.endswith(MASS),
        )

    def _settle_play(self, give: np.ndarray, force: np.ndarray, coming: np.ndarray) -> None:
        """Write into ``give`` (M, E) [rad or m] the side to which each added joint with backlash is
        pushed by the force (M, E) in its middle; ``coming`` (M, J): joints' last directions."""
        for k, a in enumerate(self._added):
            if a.half is not None:
                give[:, k] = a.side(force[:, k], coming)
        disc = [k for k, a in enumerate(self._added) if a.name.endswith(ROUND)]
        if disc:
            soft = self._added[disc[0]].stiffness * float(self._added[disc[0]].half or 0.0)
            size = np.sqrt((force[:, disc] ** 2).sum(axis=1, keepdims=True) + soft**2)
            give[:, disc] = force[:, disc] / size * soft / self._added[disc[0]].stiffness

    def _place(self, q: Value, give: Value) -> Value:
        """MuJoCo coordinates (M, nq), or a `Jet` of them, from joint values q (M, J) and positions
        give (M, E) of added joints; loops are kept closed."""
        moved = q + give @ self._series if self._series.size else q
        inner = self.robot.qpos(moved, self.theta)
        if not isinstance(inner, Jet):
            return self._spread(inner, value(give))
        give = _moving(give)
        pairs = ((inner.v, give.v), (inner.d, give.d), (inner.dd, give.dd))
        return Jet(*(self._spread(a, b) for a, b in pairs))

    def _spread(self, inner: np.ndarray, give: np.ndarray) -> np.ndarray:
        result = np.zeros((len(inner), self.model.nq))
        result[:, self._own] = inner
        result[:, self._at] = give
        if self._series.size:
            result[:, self._driven] -= give @ self._series
        return result

    def _force(self, q: Value, give: np.ndarray) -> np.ndarray:
        """Force on the joints that effects added (M, E) [N·m or N], at joint values q (M, J) and
        added joints' positions ``give`` (M, E); springs included, loops kept closed."""
        rows = _moving(self._place(q, give))
        result, asked = np.empty(give.shape), np.empty(self.model.nv)
        data = self.data
        for i in range(len(result)):
            _put(data, rows, i)
            mujoco.mj_fwdPosition(self.model, data)
            mujoco.mj_fwdVelocity(self.model, data)
            mujoco.mj_rne(self.model, data, 1, asked)
            force = data.qfrc_passive - asked
            result[i] = force[self._at]
            if self._passive:  # a loop's own joints turn as an added one does
                result[i] += force[self._passive] @ self._turns(self._at)
        return result

    def _turns(self, columns: list[int]) -> np.ndarray:
        """Derivative −J_p⁺ J (passive, columns) of the loops' passive joints by those at
        ``columns``; J, J_p: Jacobians of the loops' gaps."""
        data = self.data
        loops = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        jacobian = np.asarray(data.efc_J).reshape(data.nefc, self.model.nv)[loops]
        turn, *_ = np.linalg.lstsq(jacobian[:, self._passive], jacobian[:, columns])
        return np.asarray(-turn)


def _moving(values: Value) -> Jet:
    """Convert to a `Jet` (with time derivatives); a plain array gets zero speed, acceleration."""
    if isinstance(values, Jet):
        return values
    return Jet(values, np.zeros_like(values), np.zeros_like(values))


def _put(data: mujoco.MjData, rows: Jet, i: int) -> None:
    """Write row i of coordinates (M, nq), a `Jet`, into MuJoCo's position, speed, acceleration."""
    data.qpos[:], data.qvel[:], data.qacc[:] = rows.v[i], rows.d[i], rows.dd[i]
