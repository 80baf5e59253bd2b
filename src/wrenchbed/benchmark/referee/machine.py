"""The true machine in MuJoCo, by forward dynamics: hidden hinges, stops, hoses and pads that push;
and one fault of it: where it acts, its true numbers, how a list of faults makes a reading.

Drives are prescribed: each has an armature so large that only the commanded acceleration moves it.
Everything else follows from the equations of motion, by MuJoCo's implicit integrator. Dampings,
armatures, steps and ranges of draws are estimates: stable, and small against all time constants.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from wrenchbed.benchmark.fault import Fault, Rng, RowChange, by_axis
from wrenchbed.benchmark.referee.scenario import DrivePath, RefereeSetting
from wrenchbed.errors import ParameterError
from wrenchbed.robots.base import SimulatedRobot

STEP_S = {"static": 1e-3, "dynamic": 5e-4}
"""MuJoCo's step; wrenchbed's own plant takes 2 ms."""
_SEAT_S = 1.5
"""Time to come to rest where the machine is placed at a pose [s]."""
Drive = Callable[[np.ndarray], np.ndarray]
"""Function of reported joint values (T, J) [rad or m]: what gears and zeros add to these."""
ARMATURE = 1e8
"""Armature inertia of a prescribed drive [kg·m² or kg]."""
_STIFFEST = 0.25
"""Highest (frequency × step)² of a hidden spring alone: armature grows until it holds."""
_DAMPING_S = 6e-3
"""Damping of a hidden spring over its stiffness [s]."""
_BEARING = 0.02
"""Damping of a joint that is not driven [N·m·s/rad]."""
_BACKLASH_DAMPING = {False: 20.0, True: 120.0}
"""Damping of a drive that crosses its backlash, without and with loops, which would rattle
[N·m·s/rad]."""
_PIN_DAMPING = 500.0
"""Damping of a pin that crosses its clearance [N·s/m]."""
_LEAST_COMPLIANCE = 1e-9
"""Compliance below which a joint is rigid [rad/(N·m)]."""
_BEND_RATIO = 0.3
"""Damping ratio of a tool's root."""
_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
LOAD, GAIN, MIX, BEND, LOOP, CREEP, ZERO, CLOCK = range(8)
"""Order in which faults act: on the load, in the sensor, and on the time of its readings."""


class Backlash(NamedTuple):
    """A gear with backlash: its full width [rad] and the friction inside it [N·m]."""

    width: float
    friction: float


class LoosePart(NamedTuple):
    """A part of the tool, a share of its mass, that slides along an axis in sensor axes (3,)
    between stops at ±``stop`` [m]; its friction is the share ``stick`` of its weight."""

    share: float
    axis: np.ndarray
    stop: float
    stick: float

    def attach(self, spec: mujoco.MjSpec) -> None:
        load = spec.body("hidden_load")
        total = load.mass
        load.mass = (1.0 - self.share) * total
        slide = load.add_body(name="hidden_part", pos=load.ipos)
        slide.mass, slide.ipos, slide.explicitinertial = self.share * total, [0.0, 0.0, 0.0], True
        slide.inertia = [1e-6, 1e-6, 1e-6]
        joint = slide.add_joint(name="hidden_slide", type=_SLIDE, axis=self.axis)
        joint.limited, joint.range = True, [-self.stop, self.stop]
        joint.frictionloss = self.stick * self.share * total * 9.81
        joint.damping = [2.0, 0.0, 0.0]


class Hose(NamedTuple):
    """A hose from world (3,) to tool (3,) [m]: a spring [N/m] once longer than ``slack`` [m]."""

    hook: np.ndarray
    point: np.ndarray
    slack: float
    stiffness: float

    def attach(self, spec: mujoco.MjSpec) -> None:
        spec.worldbody.add_site(name="hidden_hook", pos=self.hook)
        spec.body("hidden_load").add_site(name="hidden_tie", pos=self.point)
        string = spec.add_tendon(name="hidden_hose", stiffness=[self.stiffness, 0.0, 0.0])
        string.springlength = [0.0, self.slack]
        string.damping = [0.02 * self.stiffness, 0.0, 0.0]
        string.wrap_site("hidden_hook")
        string.wrap_site("hidden_tie")


class Pad(NamedTuple):
    """A light plate on a spring [N/m] that the tool's end can touch: ``point`` on its face at rest
    and its normal towards the robot, in the world; ``tip`` of the tool in sensor axes (3,) [m], a
    ball of ``radius`` [m]. The contact is as hard as MuJoCo makes it."""

    point: np.ndarray
    normal: np.ndarray
    stiffness: float
    friction: float
    tip: np.ndarray
    radius: float

    def attach(self, spec: mujoco.MjSpec) -> None:
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        rotation, _ = Rotation.align_vectors([self.normal], [[0.0, 0.0, 1.0]])
        turn = rotation.as_quat(scalar_first=True)
        plate = spec.worldbody.add_body(name="hidden_pad", pos=self.point, quat=turn)
        joint = plate.add_joint(name="hidden_pad", type=_SLIDE, axis=[0.0, 0.0, 1.0])
        joint.limited, joint.stiffness = False, [self.stiffness, 0.0, 0.0]
        joint.damping, joint.armature = [0.03 * self.stiffness, 0.0, 0.0], 0.05
        shape = {"contype": 1, "conaffinity": 1, "friction": [self.friction, 0.0, 0.0]}
        box, ball = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_SPHERE
        plate.add_geom(type=box, size=[3.0, 3.0, 0.5], pos=[0.0, 0.0, -0.5], mass=0.05, **shape)
        load, size = spec.body("hidden_load"), [self.radius, 0.0, 0.0]
        load.add_geom(type=ball, size=size, pos=self.tip, mass=0.0, **shape)


@dataclass(frozen=True, eq=False)
class Mechanics:
    """Errors, compliances and backlashes of the true machine.

    ``theta`` are its geometry and load (P,), ``gravity`` is in the axes of the nominal world (3,)
    [m/s²], ``compliance`` of each driven joint (J,) [rad/(N·m)], 0 for sliding ones; ``mass`` are
    factors on bodies by name, ``drive`` errors between reported joint values and where the drives
    are, ``backlash`` by index of joint, ``clearance`` radial by name of pin [m]. The base leans
    about two axes by ``lean`` (2,) [rad/(N·m)], the first at ``heading`` [rad] in its plane; the
    tool's root, ``root`` [m] above the sensor, bends about x and y by ``bend`` (2,) [rad/(N·m)];
    ``mount`` is the sensor's rotation vector on its flange (3,) [rad].
    """

    theta: np.ndarray
    gravity: np.ndarray
    compliance: np.ndarray
    mass: Mapping[str, float] = field(default_factory=dict)
    drive: tuple[Drive, ...] = ()
    backlash: Mapping[int, Backlash] = field(default_factory=dict)
    clearance: Mapping[str, float] = field(default_factory=dict)
    lean: np.ndarray = field(default_factory=lambda: np.zeros(2))
    heading: float = 0.0
    bend: np.ndarray = field(default_factory=lambda: np.zeros(2))
    root: float = 0.0
    mount: np.ndarray = field(default_factory=lambda: np.zeros(3))
    devices: tuple[LoosePart | Hose | Pad, ...] = ()

    def driven(self, q: np.ndarray) -> np.ndarray:
        """True positions of the drives (T, J) when the robot reports q (T, J)."""
        return np.asarray(q + sum((error(q) for error in self.drive), np.zeros_like(q)))


def build(robot: SimulatedRobot, truth: Mechanics, step: float) -> mujoco.MjModel:
    """Compile a model of ``robot`` with ``truth`` that is integrated in steps of ``step`` [s]."""
    spec = robot.spec(truth.theta)
    _strip(spec)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.timestep = step
    spec.option.gravity = truth.gravity
    for body in spec.bodies:
        body.mass *= truth.mass.get(body.name, 1.0)
    for k, joint in enumerate(robot.joints):
        _joint(spec, truth, k, joint.name, step)
    for name, radius in truth.clearance.items():
        _pin(spec, name, radius)
    _base(spec, truth, step)
    _tool(spec, truth, step)
    for device in truth.devices:
        device.attach(spec)
    model = spec.compile()
    if model.ntree == 1:  # constraints on one tree are one island: nobody has to look for it
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return model


def _strip(spec: mujoco.MjSpec) -> None:
    """Delete all but bodies, joints, loops, sites and wrench, such as pictures and servos."""
    for kind in (spec.actuators, spec.keys, spec.geoms, spec.cameras, spec.lights):
        for element in list(kind):
            spec.delete(element)
    for body in spec.bodies:
        body.gravcomp = 0
    for joint in spec.joints:
        joint.limited = False
        if joint.type == _HINGE:
            joint.damping = [_BEARING, 0.0, 0.0]


def _joint(spec: mujoco.MjSpec, truth: Mechanics, k: int, name: str, step: float) -> None:
    """Add to joint ``name``, of index k, a drive, and behind it the gear's backlash and spring."""
    drive = spec.joint(name)
    drive.armature, drive.damping = ARMATURE, [0.0, 0.0, 0.0]
    body, axis = drive.parent, list(drive.axis)
    if k in truth.backlash:
        backlash = truth.backlash[k]
        gap = body.add_joint(name=f"hidden_backlash_{name}", type=_HINGE, axis=axis, pos=drive.pos)
        gap.limited, gap.range = True, [-0.5 * backlash.width, 0.5 * backlash.width]
        gap.solref_limit, gap.solimp_limit = [2.0 * step, 1.0], [0.99, 0.999, 1e-4, 0.5, 2.0]
        damping = _BACKLASH_DAMPING[len(list(spec.equalities)) > 0]
        gap.armature, gap.damping, gap.frictionloss = 0.5, [damping, 0.0, 0.0], backlash.friction
    if drive.type == _HINGE and truth.compliance[k] > _LEAST_COMPLIANCE:
        spring = body.add_joint(name=f"hidden_spring_{name}", type=_HINGE, axis=axis, pos=drive.pos)
        _spring(spring, 1.0 / truth.compliance[k], step)


def _spring(joint: "mujoco.MjsJoint", stiffness: float, step: float) -> None:
    joint.limited = False
    joint.stiffness = [stiffness, 0.0, 0.0]
    joint.damping = [_DAMPING_S * stiffness, 0.0, 0.0]
    joint.armature = 0.01 + stiffness * step**2 / _STIFFEST


def _pin(spec: mujoco.MjSpec, name: str, radius: float) -> None:
    """Give pin ``name``, which closes a loop, a clearance: a hole wider by ``radius`` [m]."""
    loop = spec.equality(name)
    end = spec.site(loop.name2)
    seat = end.parent.add_body(name=f"hidden_seat_{name}", pos=end.pos)
    seat.mass, seat.ipos, seat.explicitinertial = 1e-3, [0.0, 0.0, 0.0], True
    seat.inertia = [1e-8, 1e-8, 1e-8]
    for axis in np.eye(3)[1:]:  # five-bars lie in y and z
        slide = seat.add_joint(name=f"hidden_{name}_{axis.argmax()}", type=_SLIDE, axis=axis)
        slide.limited, slide.range = True, [-radius, radius]
        slide.solref_limit, slide.solimp_limit = [2e-3, 1.0], [0.99, 0.9999, 1e-6, 0.5, 2.0]
        slide.armature, slide.damping = 0.5, [_PIN_DAMPING, 0.0, 0.0]
    seat.add_site(name=f"hidden_seat_{name}")
    loop.name2 = f"hidden_seat_{name}"


def _base(spec: mujoco.MjSpec, truth: Mechanics, step: float) -> None:
    """Add to the base's body a sprung hinge about each of two axes that are compliant
    (``truth.lean``), turned by ``truth.heading``; it suits an integration step ``step`` [s]."""
    c, s = np.cos(truth.heading), np.sin(truth.heading)
    for name, axis, compliance in zip("xy", ([c, s, 0.0], [-s, c, 0.0]), truth.lean, strict=True):
        if compliance > _LEAST_COMPLIANCE:
            hinge = spec.body("base").add_joint(name=f"hidden_lean_{name}", type=_HINGE, axis=axis)
            _spring(hinge, 1.0 / compliance, step)


def _tool(spec: mujoco.MjSpec, truth: Mechanics, step: float) -> None:
    """Hang the load on the sensor by compliant hinges (``truth.bend``) that suit a ``step`` [s]."""
    tool = spec.body("tool")
    rotation = Rotation.from_quat(tool.quat, scalar_first=True) * Rotation.from_rotvec(truth.mount)
    tool.quat = rotation.as_quat(scalar_first=True)
    load = tool.add_body(name="hidden_load")
    load.mass, load.ipos, load.fullinertia = tool.mass, tool.ipos, tool.fullinertia
    load.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    load.explicitinertial = True
    tool.mass, tool.ipos = 1e-9, [0.0, 0.0, 0.0]
    tool.fullinertia = [np.nan] * 6
    tool.inertia = [1e-12, 1e-12, 1e-12]
    swing = load.mass * float(np.sum((np.asarray(load.ipos) - [0, 0, truth.root]) ** 2)) + 1e-4
    for name, axis, compliance in zip("xy", np.eye(3)[:2], truth.bend, strict=True):
        if compliance > _LEAST_COMPLIANCE:
            hinge = load.add_joint(
                name=f"hidden_bend_{name}", type=_HINGE, axis=axis, pos=[0.0, 0.0, truth.root]
            )
            k = 1.0 / compliance
            hinge.limited, hinge.stiffness = False, [k, 0.0, 0.0]
            hinge.armature = max(0.0, k * step**2 / _STIFFEST - swing)
            inertia = swing + hinge.armature
            hinge.damping = [2.0 * _BEND_RATIO * float(np.sqrt(k * inertia)), 0.0, 0.0]


@dataclass(frozen=True, eq=False)
class Ride:
    """Motion and load of the robot at each of T instants of a commanded path: load on the sensor in
    its true axes (T, 6) [N, N·m], R_world_sensor (T, 3, 3), the sensor's place (T, 3) [m], and true
    gravity in the nominal world's axes (3,) [m/s²]."""

    path: DrivePath
    load: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    gravity: np.ndarray

    def in_sensor(self, vector: np.ndarray) -> np.ndarray:
        """A vector (T, 3) or (3,) of the world in sensor axes (T, 3)."""
        each = np.broadcast_to(vector, self.position.shape)
        return np.asarray(np.einsum("tij,ti->tj", self.rotation, each))


def ride(robot: SimulatedRobot, truth: Mechanics, path: DrivePath) -> Ride:
    """Simulate a machine along a path; return its motion and load at each instant, a
    `ParameterError` if the simulation diverged."""
    h = STEP_S["dynamic" if path.moving else "static"]
    model = build(robot, truth, h)
    data, drives = mujoco.MjData(model), [model.joint(joint.name) for joint in robot.joints]
    position_of, speed = (
        np.array([getattr(j, address)[0] for j in drives]) for address in ("qposadr", "dofadr")
    )
    every = [model.joint(k) for k in range(model.njnt)]
    robots_own = [j.qposadr[0] for j in every if not j.name.startswith("hidden")]
    q, qd, qdd = _driven(truth, path)
    count = len(path.t)
    load, rotation, position = np.empty((count, 6)), np.empty((count, 9)), np.empty((count, 3))
    steps = np.maximum(1, np.round(np.diff(path.t, append=path.t[-1] + h) / h)).astype(int)
    push = ARMATURE * qdd
    qpos, qvel, applied = data.qpos, data.qvel, data.qfrc_applied
    site = model.site("ft").id
    of_site, at_site = data.site_xmat[site], data.site_xpos[site]
    force, torque = data.sensor("force").data, data.sensor("torque").data
    read, ignored = model.opt.disableflags, mujoco.mjtDisableBit.mjDSBL_SENSOR
    for i, further in enumerate((steps - 1).tolist()):
        if i in path.placed:
            qpos[:], qvel[:], applied[:] = model.qpos0, 0.0, 0.0  # loops closed, hinges straight
            qpos[robots_own] = robot.qpos(q[i][None], truth.theta)[0]
            mujoco.mj_step(model, data, round(_SEAT_S / h))
        qpos[position_of], qvel[speed], applied[speed] = q[i], qd[i], push[i]
        mujoco.mj_step(model, data)
        load[i, :3], load[i, 3:] = force, torque
        rotation[i], position[i] = of_site, at_site
        if further:  # nobody reads the sensors between instants
            model.opt.disableflags = read | ignored
            mujoco.mj_step(model, data, further)
            model.opt.disableflags = read
    load *= -1.0
    if not np.isfinite(load).all() or np.abs(load).max() > 1e4:
        raise ParameterError("the simulation diverged: the faults are too large for the machine")
    return Ride(path, load, rotation.reshape(-1, 3, 3), position, truth.gravity)


def _driven(truth: Mechanics, path: DrivePath) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True positions, speeds and accelerations of the drives (T, J), with the drives' errors."""
    eps = 1e-4
    q0 = truth.driven(path.q)
    if not truth.drive:
        return q0, path.qd, path.qdd
    ahead = truth.driven(path.q + eps * path.qd)
    behind = truth.driven(path.q - eps * path.qd)
    qd = (ahead - behind) / (2 * eps)
    curvature = (ahead - 2 * q0 + behind) / eps**2
    slope = np.where(np.abs(path.qd) > 1e-6, qd / np.where(path.qd == 0, 1, path.qd), 1.0)
    return q0, qd, slope * path.qdd + curvature


Change = Callable[[Ride, np.ndarray], np.ndarray]
"""Makes another signal (T, 6) [N, N·m] of one, over the instants of a ride."""
RowFault = RowChange[Callable[[np.ndarray], np.ndarray]]
"""Change of single rows; it shakes the base by accelerations (n, 3) at times (n,) [s], world axes
[m/s²]."""


def about(rng: Rng, value: float, spread: float = 0.2) -> float:
    """Draw a log-normal value around ``value`` with a relative spread."""
    return float(value * np.exp(spread * np.clip(rng.standard_normal(), -2.0, 2.0)))


def direction(rng: Rng) -> np.ndarray:
    """Draw a unit vector (3,)."""
    v = rng.standard_normal(3)
    return np.asarray(v / np.linalg.norm(v))


def touched(rng: Rng) -> np.ndarray:
    """Draw weights (6,) of one, two or all channels, or forces or torques; largest ±1."""
    few = int(rng.choice([1, 2, 3, 6], p=[0.45, 0.2, 0.15, 0.2]))
    chosen = np.zeros(6, dtype=bool)
    if few == 3:
        chosen[:3] = rng.uniform() < 0.5
        chosen[3:] = not chosen[0]
    else:
        chosen[rng.choice(6, few, replace=False)] = True
    weight = chosen * rng.uniform(0.4, 1.0, 6) * rng.choice([-1.0, 1.0], 6)
    return np.asarray(weight / np.abs(weight).max())


@dataclass(frozen=True, eq=False)
class RefereeFault(Fault):
    """Fault of the referee's robot; ``true`` has its numbers as a diagnosis publishes them, SI.

    ``body`` changes the mechanics, which are then simulated anew; ``change`` changes readings (T,
    6) at a ``stage`` (`LOAD` … `CLOCK`, in this order); ``rows`` changes the scatter of rows.
    ``size`` is in multiples of the typical one.
    """

    body: Callable[[Mechanics], Mechanics] | None = None
    change: Change | None = None
    stage: int = 0
    rows: RowFault | None = None
    size: float = 0.0


def shifted(true: dict[str, float], shift: np.ndarray) -> RefereeFault:
    """Fault of a sensor's zero that shifts by (6,), or at T instants by (T, 6) [N, N·m]; ``true``
    holds its numbers by name."""
    return RefereeFault(true, change=lambda ride, y: y + shift, stage=ZERO)


def misshapen(
    setting: RefereeSetting, true: dict[str, float], errors: dict[str, float]
) -> RefereeFault:
    """Fault by ``errors`` of robot parameters (geometry, load), by name, and ``true`` numbers."""
    shift = np.zeros(len(setting.theta))
    for name, value in errors.items():
        shift[setting.robot.parameters.index(name)] = value
    return RefereeFault(true, lambda m: replace(m, theta=m.theta + shift))


def not_as_drawn(setting: RefereeSetting, errors: dict[str, float]) -> RefereeFault:
    """Fault of links by ``errors`` of parameters by name; no diagnosis publishes such numbers."""
    return misshapen(setting, {f"length.{k}": v for k, v in errors.items()}, errors)


def heavier(setting: RefereeSetting, error: float) -> RefereeFault:
    """Fault of a tool that is heavier than stated by ``error`` [kg]."""
    return RefereeFault({"mass": error}, lambda m: _loaded(setting, m, error, np.zeros(3)))


def off(setting: RefereeSetting, error: np.ndarray) -> RefereeFault:
    """Fault of a tool whose centre of gravity is off by (3,) [m]."""
    return RefereeFault(by_axis(error, "cog."), lambda m: _loaded(setting, m, 0.0, error))


def _loaded(setting: RefereeSetting, m: Mechanics, mass: float, cog: np.ndarray) -> Mechanics:
    """The machine with a tool heavier by ``mass`` [kg] and its CoG moved by ``cog`` (3,) [m]."""
    tool = setting.robot.tool(m.theta)
    centre = (np.asarray(tool.cog) + cog).tolist()
    theta = setting.robot.theta_of_tool(m.theta, float(tool.mass) + mass, centre)
    return replace(m, theta=theta)


def signal(ride: Ride, faults: Sequence[RefereeFault]) -> np.ndarray:
    """Sensor's reading at every instant (T, 6) [N, N·m] with faults, without noise and range."""
    y = ride.load
    for fault in sorted(faults, key=lambda f: f.stage):
        if fault.change is not None:
            y = fault.change(ride, y)
    return y
