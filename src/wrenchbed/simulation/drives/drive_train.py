"""What the drives of a simulated robot report: torques or currents, with friction, faults, noise.

    τ = rigid body and rotor (MuJoCo) + F_c tanh(q̇/v₀) + F_v q̇ + τ₀,   then the faults,
    i = τ/K + noise, quantised.

Noise of a current: white, and a ripple of the motor's turns, both through the filter of the drive's
current reading. Reported torques are such currents times K.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import mujoco
import numpy as np

from wrenchbed.errors import ParameterError, did_you_mean
from wrenchbed.physics.noise import carried
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.drives.faults import PREFIX, REVERSAL, ActiveFault, Rows, active_fault
from wrenchbed.simulation.mujoco_wrench import loop_sites

Kind = Literal["torque", "current"]
COLUMN: Mapping[str, str] = {"torque": "tau", "current": "i"}
"""Start of a column's name by kind of effort: ``tau`` for torques, ``i`` for currents."""
_WHITE = 0.01
"""White noise of a current before its filter, over `DriveTrain.level`: a sensor of 1 %."""
_RIPPLE = 0.005
"""Amplitude of a current's ripple, as a share of `DriveTrain.level`: half of its white noise."""
_FRICTIONS = 4.0
"""Typical load of a drive: the torque that holds the robot plus this many times the Coulomb
friction; motors are chosen for some times their gear's friction."""
_GEAR, _POLES = 100.0, 6.0
"""Turns of a motor per turn of its joint (strain wave gears have 100), and waves a turn of the
motor: three pole pairs."""
_FILTER_HZ = 40.0
"""Cutoff of the first-order filter on a drive's current reading [Hz]: below the Nyquist frequency
of a log at 125 Hz."""
_STEP = 0.001
"""Resolution of reported currents [A]: thousandths, as RTDE and CiA 402 report."""
_COLD, _WARMER, _WARM_S = 25.0, 8.0, 1800.0
"""Temperature of a drive [°C] as it starts, its rise [K], and the time constant [s]: a room,
hand-warm, half an hour."""
_POSES, _SEED = 200, 5
"""Number and seed of the random poses for the torque that holds the robot."""
_COULOMB: Mapping[str, tuple[float, ...]] = {"ur5": (6.0, 6.5, 4.5, 1.4, 1.2, 1.0)}
"""Coulomb friction of each joint by robot [N·m]; estimates: one third of a UR10e's (recordings of
Innopolis University, doi 10.3389/frobt.2020.571574) to one half."""
_VISCOUS: Mapping[str, tuple[float, ...]] = {"ur5": (8.0, 8.5, 6.5, 1.5, 1.4, 1.2)}
"""Viscous friction of each joint by robot [N·m·s/rad]; estimates, as `_COULOMB`."""
_CONSTANT: Mapping[str, tuple[float, ...]] = {
    "ur5": (12.6, 12.6, 12.6, 9.3, 9.3, 9.3),
    "medrue": (50.0, 0.5, 0.5, 0.5, 0.5, 0.5),
}
"""Torque per current, gear included [N·m/A; N/A]. UR5: estimate, as its emulator has. MedRUE:
rated 200 N and 2 N·m over 4 A, estimates as the emulated drives have."""
_USUAL_CONSTANT = 10.0
"""Torque per current of a robot that `_CONSTANT` lacks [N·m/A]: between a UR10e's joints."""
_SHARE, _LEAST = 0.04, 0.5
"""Coulomb friction where none is stated: share of the torque that holds the arm's weight, about a
UR5's, and no less than the second number [N·m or N]."""
_PER_SPEED = 1.0
"""Viscous over Coulomb friction where none is stated [s/rad or s/m]: about a UR5's, 1.1 to 1.4."""


class JointTorques:
    """Torques that the motors need, by MuJoCo's inverse dynamics without friction and servos.

    Inverse dynamics of the open tree gives the force τ₀ on every coordinate. Motors act on J of
    them, and the loops' closing forces λ on the others:

        Sᵀ τ + Aᵀ λ = τ₀,   A the Jacobian of the gaps between both sides of a loop.

    Featherstone 2008, Rigid Body Dynamics Algorithms, Section 8.3 (loop-closure forces).

    Args:
        theta: parameters of the robot (P,).
        gravity: in world axes (3,) [m/s²].
        rotor: inertia of each motor at its joint (J,) [kg·m² or kg]; if None, the MJCF's.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, gravity: Sequence[float],
        rotor: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.robot, self.theta = robot, theta
        spec = robot.spec(theta)
        spec.option.gravity = gravity
        model, disabled = spec.compile(), mujoco.mjtDisableBit
        self._dofs = np.array([int(model.joint(joint.name).dofadr[0]) for joint in robot.joints])
        self.coulomb = model.dof_frictionloss[self._dofs]
        self.viscous = model.dof_damping[self._dofs]
        if rotor is not None:
            model.dof_armature[self._dofs] = rotor
        self.rotor = model.dof_armature[self._dofs]
        """Of each motor at its joint (J,), inertia [kg·m² or kg], friction and damping, as the
        robot's MJCF states them."""
        model.body_gravcomp[:] = 0.0
        model.dof_damping[:] = model.dof_frictionloss[:] = 0.0
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        for feature in ("CONSTRAINT", "CONTACT", "SENSOR"):
            model.opt.disableflags |= getattr(disabled, f"mjDSBL_{feature}")
        self.model, self.data, self._loops = model, mujoco.MjData(model), loop_sites(model)

    def of(self, q: Jet) -> np.ndarray:
        """Torques (N, J) [N·m or N] at joint values with speeds and accelerations, (N, J) each."""
        all_joints = self.robot.qpos(q, self.theta)
        assert isinstance(all_joints, Jet)
        rows = zip(all_joints.v, all_joints.d, all_joints.dd, strict=True)
        return np.array([self.at(*row) for row in rows])

    def at(self, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray) -> np.ndarray:
        """Torques (J,) at MuJoCo's coordinates (nq,), speeds and accelerations (nv,)."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
        mujoco.mj_inverse(self.model, data)
        if not self._loops:
            return np.array(data.qfrc_inverse[self._dofs])
        joints, nv = len(self._dofs), self.model.nv
        acting = np.zeros((nv, joints + 3 * len(self._loops)))
        acting[self._dofs, np.arange(joints)] = 1.0
        one, other = np.empty((3, nv)), np.empty((3, nv))
        for k, (a, b) in enumerate(self._loops):
            mujoco.mj_jacSite(self.model, data, one, None, a)
            mujoco.mj_jacSite(self.model, data, other, None, b)
            acting[:, joints + 3 * k : joints + 3 * k + 3] = (one - other).T
        return np.asarray(np.linalg.lstsq(acting, data.qfrc_inverse, rcond=1e-10)[0][:joints])


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
    def nominal(cls, rigid: JointTorques, holding: np.ndarray) -> "DriveParameters":
        """Default parameters of the drives of the robot in ``rigid``, of known robots from a table,
        else from its MJCF; else friction is a share of ``holding`` (J,), the largest torques that
        hold its weight [N·m or N]."""
        name, likely = rigid.robot.name, np.maximum(_SHARE * holding, _LEAST)
        coulomb = np.where(rigid.coulomb > 0.0, rigid.coulomb, likely)
        viscous = np.where(rigid.viscous > 0.0, rigid.viscous, _PER_SPEED * likely)
        if name in _COULOMB:
            coulomb, viscous = np.array(_COULOMB[name]), np.array(_VISCOUS[name])
        usual = (_USUAL_CONSTANT,) * len(holding)
        constant = np.array(_CONSTANT.get(name, usual))
        return cls(coulomb, viscous, np.zeros(len(holding)), rigid.rotor, constant)

    def changed(self, given: Mapping[str, float]) -> "DriveParameters":
        """Copy with new values by name, ``drive.coulomb.2``: joints count from 1; a
        `ParameterError` if there is no such name, or the value is impossible."""
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


def temperatures(t: np.ndarray, joints: int) -> np.ndarray:
    """Temperatures of the drives (N, J) [°C] at times (N,) [s], warming up from t = 0 on."""
    warm = _COLD + _WARMER * (1.0 - np.exp(-np.asarray(t, dtype=float) / _WARM_S))
    return np.repeat(warm[:, None], joints, axis=1)


class DriveTrain:
    """Drives of one simulated robot: motion in, reported torques out.

    Args:
        theta: true parameters of the robot (P,).
        gravity: in world axes (3,) [m/s²].
        given: true drive parameters that differ from nominal, by name: ``drive.coulomb.2``.
        faults: (name, values) of each fault.

    Raises:
        NotFoundError, ParameterError: a parameter or a fault does not exist or is impossible.
    """

    def __init__(
        self, robot: SimulatedRobot, theta: np.ndarray, gravity: Sequence[float],
        given: Mapping[str, float] | None = None,
        faults: Sequence[tuple[str, Mapping[str, Any]]] = (),
    ) -> None:  # fmt: skip
        nominal = JointTorques(robot, robot.parameters.nominal, gravity)
        poses = robot.sample(_POSES, np.random.default_rng(_SEED))
        holding = nominal.of(Jet(poses, 0.0 * poses, 0.0 * poses))
        self.holding = np.abs(holding).max(axis=0)
        self.nominal = DriveParameters.nominal(nominal, self.holding)
        self.parameters = self.nominal.changed(given or {})
        self.joints = len(robot.joints)
        self.rigid = JointTorques(robot, theta, gravity, self.parameters.inertia)
        self.controller = nominal
        """Torques of the robot with nominal parameters, which its controller assumes."""
        self.faults: tuple[ActiveFault, ...] = tuple(
            active_fault(name, values, self.nominal.coulomb) for name, values in faults
        )

    def torques(self, t: np.ndarray, q: Jet, rigid: np.ndarray | None = None) -> np.ndarray:
        """Torques (N, J) [N·m or N] that drives with nominal constants report, at times t (N,) [s]
        and joint values with speeds and accelerations (N, J). Calls must follow each other in time:
        some faults have memory. ``rigid`` are torques of the rigid body (N, J), computed if
        None."""
        p = self.parameters
        rigid = self.rigid.of(q) if rigid is None else rigid
        total = rigid + p.coulomb * np.tanh(q.d / REVERSAL) + p.viscous * q.d + p.offset
        if not self.faults:
            return np.asarray(total)
        warm = temperatures(t, 1)[:, 0]
        for fault in self.faults:
            j = fault.joint - 1
            rows = Rows(t, q.v[:, j], q.d[:, j], q.dd[:, j], rigid[:, j], warm,
                        float(self.nominal.coulomb[j]))  # fmt: skip
            total[:, j] = fault.act(rows, total[:, j])
        return np.asarray(total)

    def level(self) -> np.ndarray:
        """Typical current (J,) [A] of each drive, to which noise and ripple are proportional."""
        load = self.holding + _FRICTIONS * self.nominal.coulomb
        return np.asarray(load / np.abs(self.nominal.constant))


class EffortNoise:
    """Generator of a current sensor's noise (``real``, ``white`` or ``off``) for rows at a constant
    rate [Hz]; each call continues the previous one."""

    def __init__(self, train: DriveTrain, noise: str, seed: int, rate: float) -> None:
        self._kind, self._level = noise, train.level()
        self._rng = np.random.default_rng([seed, 17])
        self._phase = self._rng.uniform(0.0, 2.0 * np.pi, train.joints)
        self._keep = float(np.exp(-2.0 * np.pi * _FILTER_HZ / rate))
        self._last = np.zeros(train.joints)

    def on(self, current: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Reported currents (N, J) [A]: true ones plus noise, at joint values q (N, J)."""
        if self._kind == "off":
            return current
        noise = _WHITE * self._rng.normal(size=current.shape)
        if self._kind == "white":
            return np.asarray(current + self._level * noise)
        noise = noise + _RIPPLE * np.sin(_GEAR * _POLES * q + self._phase)
        push = (1.0 - self._keep) * noise.T
        push[:, 0] += self._keep * self._last
        seen = carried(np.full(len(noise), self._keep), push).T
        self._last = seen[-1]
        return np.asarray(np.round((current + self._level * seen) / _STEP) * _STEP)


class ReportedEfforts:
    """Makes a recording's drive columns: efforts, the controller's targets, temperatures; ``noise``
    is ``real``, ``white`` or ``off``."""

    def __init__(self, train: DriveTrain, kind: Kind, noise: str, seed: int) -> None:
        self._train, self._kind, self._noise, self._seed = train, kind, noise, seed
        self._stream: EffortNoise | None = None

    def columns(
        self, t: np.ndarray, q: Jet, targets: np.ndarray, rate: float
    ) -> dict[str, np.ndarray]:
        """Columns (N,) by name for N rows at a rate [Hz] that follow those of the last call: times
        (N,) [s], joint values with speeds and accelerations, and their targets, (N, J) each."""
        train = self._train
        if self._stream is None:
            self._stream = EffortNoise(train, self._noise, self._seed, rate)
        seen = self._stream.on(train.torques(t, q) / train.parameters.constant, q.v)
        if self._kind == "torque":
            seen = seen * train.nominal.constant
        speed = np.gradient(targets, 1.0 / rate, axis=0) if len(targets) > 1 else 0.0 * targets
        parts = {
            COLUMN[self._kind]: seen, "qd_target": speed, "tau_target": train.controller.of(q),
            "joint_temperature": temperatures(t, train.joints),
        }  # fmt: skip
        return {f"{k}{j + 1}": v[:, j] for k, v in parts.items() for j in range(train.joints)}
