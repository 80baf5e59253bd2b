"""The arm under its controller: one motion at a time within the joints' limits, force_mode, and the
wrench at the tool as the controller reports it.

That wrench is in base axes and positive where the surroundings push the tool: measured load minus
weight of the payload that the controller was told. The CB3 states the torque about the TCP, the
e-Series about the flange's centre.
"""

from dataclasses import dataclass

import numpy as np

from robot_emulators.plant import Payload, Plant
from robot_emulators.ur.kinematics import NO_TOOL, Kinematics, UnreachableError, cross, matrix
from robot_emulators.ur.motions import ArmMotion, Braking, Servo

GRAVITY = np.array([0.0, 0.0, -9.80665])
_YIELDING = np.array([6e-4] * 3 + [0.02] * 3)
"""Admittance of force_mode's axes: speed per missing force [m/(s·N)] and torque [rad/(s·N·m)]."""
SAFE_DECELERATION = 15.0
"""Deceleration of the joints when the safety system stops the arm [rad/s²]."""
_SLACK = 1.02


class WrenchEstimate:
    """Computes the wrench that the controller reports from the load that the robot measures.

    Args:
        payload: load of the tool at power-up, as the robot's installation states it.
        at_tcp: whether torques are about the TCP, else about the flange's centre.
    """

    def __init__(self, payload: Payload, at_tcp: bool) -> None:
        self._installed, self._at_tcp = payload, at_tcp
        self.restart()

    def restart(self) -> None:
        """Reset payload and gravity to those of the installation, and the zero offset to none."""
        self.payload = self._installed
        self.gravity = GRAVITY.copy()
        self._zero = np.zeros(6)
        self.wrench = np.zeros(6)

    def carry(self, mass: float, cog: np.ndarray, inertia: np.ndarray | None = None) -> None:
        """Set the payload: mass [kg], CoG (3,) [m], inertia (6,) xx yy zz xy xz yz [kg·m²] (None:
        unchanged); on an e-Series a CoG of zeros keeps the old CoG."""
        keep = not self._at_tcp and not cog.any()
        self.payload = Payload(
            mass,
            self.payload.cog if keep else cog,
            self.payload.inertia if inertia is None else inertia,
        )

    def zero(self) -> None:
        """Zero the reported wrench: subtract its present value from now on."""
        self._zero = self._zero + self.wrench
        self.wrench = np.zeros(6)

    def update(self, load: np.ndarray, rotation: np.ndarray, tcp: np.ndarray) -> None:
        """Compute the reported wrench (6,) [N, N·m], in axes of the base, as attribute ``wrench``.

        Args:
            load: load measured on the flange, in its axes (6,) [N, N·m].
            rotation: rotation of the flange in axes of the base (3, 3).
            tcp: pose of the TCP in flange axes (6,); only its position, tcp[:3] [m], is used.
        """
        weight = self.payload.mass * self.gravity
        force = rotation @ load[:3] - weight
        torque = rotation @ load[3:] - cross(rotation @ self.payload.cog, weight)
        if self._at_tcp:
            torque = torque - cross(rotation @ tcp[:3], force)
        self.wrench = np.concatenate([force, torque]) - self._zero


@dataclass(frozen=True, eq=False)
class ForceMode:
    """Arguments of URScript's force_mode of type 2, whose task frame is not transformed.

    Attributes:
        frame: pose of the task frame in the base (6,), x y z [m] and rotation vector [rad].
        selection: 1 for each compliant axis, else 0 (6,).
        wrench: wrench that the robot shall exert, in task axes (6,) [N, N·m].
        limits: highest speed of each compliant axis (6,) [m/s, rad/s].
    """

    frame: np.ndarray
    selection: np.ndarray
    wrench: np.ndarray
    limits: np.ndarray

    def twist(self, measured: np.ndarray, scaling: float) -> np.ndarray:
        """TCP velocity (6,) [m/s, rad/s] for a measured wrench (6,) [N, N·m], both in base axes;
        ``scaling`` is the gain of force_mode_set_gain_scaling."""
        rotation, _ = matrix(self.frame)
        exerted = np.concatenate([rotation.T @ measured[:3], rotation.T @ measured[3:]])
        limits = np.abs(self.limits)
        speed = np.clip(scaling * _YIELDING * (self.wrench + exerted), -limits, limits)
        speed = speed * (self.selection != 0)
        return np.concatenate([rotation @ speed[:3], rotation @ speed[3:]])


class ControlledArm:
    """Steps a robot along its active motion, within the joints' limits, and updates its wrench."""

    def __init__(self, plant: Plant, estimate: WrenchEstimate) -> None:
        self.plant, self.estimate = plant, estimate
        self.due = 0.0
        """When the next cycle is due (`time.monotonic`) [s]; 0: as soon as it is run."""
        self.load = np.zeros(6)
        self.kinematics = Kinematics(plant.arm)
        self.q = np.array(plant.arm.home)
        self.qd = np.zeros(6)
        self.qdd = np.zeros(6)
        self.force: ForceMode | None = None
        self.motion: ArmMotion | None = None
        """Motion that moves the arm now."""
        self._interrupted: ArmMotion | None = None
        self._plain = self.q.copy()
        self._frozen = False
        self.restart()

    def restart(self) -> None:
        """Reset TCP, speed slider and force mode's gain to power-up values; nothing moves."""
        self.tcp = NO_TOOL.copy()
        self.slider = self.force_scaling = 1.0

    @property
    def moving(self) -> bool:
        return bool(np.abs(self.qd).max() > 1e-4)

    def moves_by(self, motion: ArmMotion) -> bool:
        """Whether this motion moves the arm now, or will once a safety stop is over."""
        return motion is (self._interrupted if self._frozen else self.motion)

    def start(self, motion: ArmMotion) -> None:
        """Make a motion the active one; during a safety stop, the one that follows the stop."""
        if self._frozen:
            self._interrupted = motion
            return
        motion.begin(self._plain, self.qd)
        self.motion = motion

    def brake(self, deceleration: float, seconds: float | None = None) -> Braking:
        """Brake all joints in place of the active motion; return the braking motion.

        Args:
            deceleration: deceleration of the fastest joint [rad/s²].
            seconds: time to rest, which replaces the deceleration; None: the deceleration decides.
        """
        braking = Braking(deceleration, seconds)
        if self._frozen:
            self._interrupted = None
        braking.done = self._frozen or self.motion is None  # the target stands still already
        if not braking.done:
            self.start(braking)
        return braking

    def release(self, motion: ArmMotion | None) -> None:
        """Brake if this motion still moves the arm; do not resume it after a stop."""
        if motion is not None and motion is self.motion and not motion.done:
            self.brake(SAFE_DECELERATION / 3)
        if motion is not None and motion is self._interrupted:
            self._interrupted = None

    def freeze(self) -> None:
        """Brake for a safety stop or pause; the interrupted motion is kept until `thaw`."""
        if not self._frozen:
            self._interrupted, self._frozen = self.motion, True
            self.motion = Braking(SAFE_DECELERATION)
            self.motion.begin(self._plain, self.qd)

    def thaw(self, go_on: bool) -> None:
        """End a safety stop or pause: continue the interrupted motion (``go_on``) or drop it."""
        if not self._frozen:
            return
        self._frozen = False
        waiting, self._interrupted = self._interrupted, None
        if go_on and waiting is not None:
            self.start(waiting)

    def end_force_mode(self) -> None:
        """Leave force_mode: all axes are position-controlled again, where they are."""
        self.force = None
        self._plain = self.q.copy()
        if self.motion is not None:
            self.motion.begin(self._plain, self.qd)

    def cycle(self) -> str | None:
        """Move for one control cycle; return the reason for a safety stop, None without one."""
        dt = self.plant.cycle
        violation = None
        try:
            following = self._next(dt)
        except UnreachableError as error:
            following, violation = self._emergency_step(dt), str(error)
        violation = violation or self._objection(following, dt)
        if violation is not None and not self._frozen:
            following = self._emergency_step(dt)
        self._take(following, dt)
        return violation

    def _next(self, dt: float) -> np.ndarray:
        plain = self._plain
        if self.motion is not None:
            plain = self.motion.step(plain, dt * self.slider if self.motion.scaled else dt)
            if self.motion.done:
                self.motion = None
        offset = self.q - self._plain
        self._next_plain = plain
        if self.force is not None and not self._frozen:
            twist = self.force.twist(self.estimate.wrench, self.force_scaling)
            offset = offset + self.kinematics.rates(self.q, self.tcp, twist) * dt
        return np.asarray(plain + offset)

    def _objection(self, following: np.ndarray, dt: float) -> str | None:
        top = self.kinematics.speed
        if not np.isfinite(following).all():
            return "a target is not a number"
        if isinstance(self.motion, Servo) and not self._frozen:
            reach = top * max(self.motion.lag, dt)
            if (self.motion.distance(self.q) > _SLACK * reach).any():
                return "a target is farther away than the joints' speed allows"
        if (np.abs(following - self.q) > _SLACK * top * dt).any():
            return "a joint would be faster than its limit"
        speed = (following - self.q) / dt
        stopped = following + speed * np.abs(speed) / (2.0 * SAFE_DECELERATION)
        if not self.kinematics.within(following) or not self.kinematics.within(stopped):
            return "a joint would leave its range"
        return None

    def _emergency_step(self, dt: float) -> np.ndarray:
        """Start an emergency braking; return the joint values (6,) after its first ``dt`` [s]."""
        self.freeze()
        assert self.motion is not None
        self._next_plain = self.motion.step(self._plain, dt)
        return np.asarray(self._next_plain + (self.q - self._plain))

    def _take(self, following: np.ndarray, dt: float) -> None:
        speed = (following - self.q) / dt
        self.qdd = (speed - self.qd) / dt
        self.q, self.qd, self._plain = following, speed, self._next_plain
        self.plant.step(self.q, self.due)
        rotation, _ = self.kinematics.flange(self.plant.q)
        self.load = self.plant.wrench()
        self.estimate.update(self.load, rotation, self.tcp)
