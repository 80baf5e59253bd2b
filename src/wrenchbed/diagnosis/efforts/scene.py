"""Motion of an arm while joint efforts were recorded, and the stated robot's prediction of them.

Columns of every cause are made at the recording's rate and thinned as the efforts are.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy  # which loads its slow submodules when they are first used

from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.efforts.stated_drives import COMMANDED, Drives
from wrenchbed.drives.identify import FRICTION, arm_of, calibrate_efforts
from wrenchbed.drives.identify_at_rest import CONSTANT
from wrenchbed.drives.signals import DriveSignals, efforts_of, motion_signals
from wrenchbed.effects.drives.operators import direction, moving
from wrenchbed.errors import CalibrationError, DiagnosisError
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS, UNITS, Tool
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.robots.inverse_dynamics import rotor_torque, torque_regressor
from wrenchbed.robots.mjspec_edits import LinkInertias, link_inertias
from wrenchbed.simulation.closed_form import Model

MOST_ROWS = 12_000
"""Most rows of the analysis, 1.5 min at 125 Hz: time and memory grow, evidence is enough before."""
_RATE = 125.0
"""Rate that is enough for reversals and cogging [Hz]: the slowest at which UR controllers log."""
_PER_CUTOFF = 2.5
"""Rate of kept rows of commands, over the motion's cutoff frequency: above the cutoff encoders'
noise, twice differentiated, is larger than all else."""
_PASS = 0.8
"""Edge of the low-pass before rows are left out, over the new Nyquist frequency: usual value."""
_ORDER = 6
"""Order of the Butterworth low-pass before thinning, run forwards and backwards."""
_END_S = 1.0
"""Time left out at both ends of a recording [s]: two periods of the slowest filter."""
_STATE = (
    'state them all in [recording] of the column map: configured = { "drive.constant" = [ … ] } '
    "[N·m/A; N/A]"
)
_LEAST_ROWS = 400
"""Fewest rows of an analysis after some are left out: twenty blocks of twenty."""


@dataclass(frozen=True, eq=False)
class EffortScene:
    """A recording of joint efforts (N rows, J joints) with the stated robot's prediction.

    Attributes:
        recording: what was recorded.
        robot, model, theta: the stated arm, its simulator and its parameters (P,).
        inertias: stated inertial parameters of its links and motors.
        signals: kinematics (N, J) and effort, as torques.
        body: torque of the rigid body (N, J) [N·m, of slides N].
        friction: torque of stated friction, or of fitted Coulomb and viscous friction, which every
            arm has (N, J) [N·m or N].
        levels: Coulomb friction, viscous friction and offset of ``friction`` (3, J), SI.
        regressor: torques per unit of each inertial parameter of L links (N, J, 10 L).
        drives: stated values of the drives.
        currents: whether currents were recorded and turned into torques.
        step: number of rows from one kept row to the next.
        wrench: measured (N, 6) [N, N·m] where used as evidence too, else None.
        displaced: displacement of the tool's CoG (3,) [m] at which changes of its first moment are
            exact, since inertia grows with its square; 0 before it is fitted.
        turned: gravity of ``model``, about which all columns are made, less the stated one (3,)
            [m/s²]; 0 unless the efforts follow a far other one than is stated.
    """

    recording: Recording
    robot: SimulatedRobot
    model: Model
    theta: np.ndarray
    inertias: LinkInertias
    signals: DriveSignals
    body: np.ndarray
    friction: np.ndarray
    levels: np.ndarray
    regressor: np.ndarray
    drives: Drives
    currents: bool
    step: int
    wrench: np.ndarray | None = None
    displaced: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turned: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def commanded(self) -> bool:
        """Whether efforts are tracking errors of position servos times their stiffness."""
        return f"{COMMANDED}1" in self.recording.columns

    @property
    def joints(self) -> int:
        """Number of joints."""
        return self.body.shape[1]

    @property
    def tool(self) -> Tool:
        """Tool as stated."""
        return self.robot.tool(self.theta)

    @property
    def q(self) -> Jet:
        """Joint values, speeds and accelerations (N, J)."""
        return self.signals.q

    @property
    def total(self) -> np.ndarray:
        """Predicted effort (N, J) [N·m, of slides N]."""
        return self.body + self.friction

    @property
    def measured(self) -> np.ndarray:
        """Readings (N, C): efforts [N·m, of slides N], then the wrench if any."""
        efforts = self.signals.effort
        return efforts if self.wrench is None else np.hstack([efforts, self.wrench])

    @property
    def residual(self) -> np.ndarray:
        """Measured less predicted readings (N, C), with the stated gravity: efforts, then the
        wrench if any."""
        predicted = np.hstack([self.total, self.load])
        return (
            self.measured - predicted + (self.by_gravity(self.turned) if self.turned.any() else 0.0)
        )

    def by_gravity(self, more: np.ndarray) -> np.ndarray:
        """Change of the readings (N, C) by additional gravity (3,) [m/s²]."""
        held = -self.robot.gravity_torque(self.q.v, self.theta, more)
        return np.hstack([held, self.sensed(self.theta, more) - self.load])

    @cached_property
    def load(self) -> np.ndarray:
        """Predicted wrench (N, 6) [N, N·m]; (N, 0) without a measured one."""
        return self.sensed(self.theta)

    def sensed(self, theta: np.ndarray, pull: np.ndarray | float = 0.0) -> np.ndarray:
        """Predicted wrench (N, 6) with robot parameters ``theta`` (P,) and gravity changed by
        ``pull`` (3,) [m/s²]; (N, 0) if no wrench was measured."""
        if self.wrench is None:
            return np.zeros((len(self.signals.t), 0))
        whole = self.model.configured(self.recording.metadata)
        whole[: len(theta)] = theta
        gravity = tuple((np.asarray(self.model.gravity) + pull).tolist())
        return replace(self.model, gravity=gravity).predict(self.q, whole)

    @property
    def channels(self) -> tuple[tuple[str, str, str], ...]:
        """Name, column, unit of each channel: ``joint 1``, ``tau1``, ``N·m`` …, then ``fx`` …."""
        prefix, joints = self.recording.effort, self.robot.joints[: self.joints]
        named = ((f"joint {j}", f"{prefix}{j}", x.own("N·m")) for j, x in enumerate(joints, 1))
        wrench = () if self.wrench is None else zip(CHANNELS, CHANNELS, UNITS, strict=True)
        return (*named, *wrench)

    @cached_property
    def speeds(self) -> np.ndarray:
        """Speeds (N, C) that select rows to use: each joint's; for the wrench the fastest one's."""
        arm = np.abs(self.q.d).max(axis=1, keepdims=True)
        return np.hstack([self.q.d, np.repeat(arm, self.load.shape[1], axis=1)])

    def thin(self, columns: np.ndarray) -> np.ndarray:
        """Values (N, …) of all rows at kept rows (M, …), low-pass filtered if rows are left out."""
        if self.step > 1:
            sections = scipy.signal.butter(_ORDER, _PASS / self.step, output="sos")
            columns = scipy.signal.sosfiltfilt(sections, columns, axis=0)
        return np.asarray(columns[self.kept()])

    def moving(self) -> np.ndarray:
        """Mask (M, C) of kept rows to use by channel: of joints those clear of rest, else all."""
        use = [moving(v, self.signals.rate) for v in self.q.d.T]
        use += [np.ones(len(self.q.d), dtype=bool)] * (len(self.channels) - self.joints)
        return np.stack(use, axis=-1)[self.kept()]

    def kept(self) -> slice:
        """Slice of the rows that are kept: one in `step`, without the ends."""
        rows = len(self.signals.t)
        edge = min(round(_END_S * self.signals.rate), rows // 10)
        return slice(edge, rows - edge, self.step)


def effort_scene(recording: Recording, drives: Drives, *, wrench: bool = False) -> EffortScene:
    """Prepare a recording of joint efforts for analysis, with its wrench if ``wrench``.

    Raises:
        RecordingError, CalibrationError: no efforts, an uneven clock, nothing moves.
        NotFoundError: the robot's model has no links.
        DiagnosisError: the motion is too short, or there is no wrench.
    """
    if wrench and not recording.has_wrench:
        raise DiagnosisError(
            f"{recording.name}: has no wrench fx … tz: use --channels effort, which needs none"
        )
    robot, turned = arm_of(recording), np.zeros(3)
    prefix, effort = efforts_of(recording)
    stated = prefix == "i" and drives.known(CONSTANT).all()
    constants = drives.of(CONSTANT).tolist() if stated else None
    with suppress(CalibrationError):  # what cannot be fitted follows no other gravity
        fit = calibrate_efforts(recording, constants=constants, force=True)
        if fit.gravity is not None:
            turned = np.subtract(fit.gravity, Model.of(robot, recording.metadata).gravity)
            metadata = replace(recording.metadata, gravity=fit.gravity)
            recording = replace(recording, metadata=metadata)
    signals = motion_signals(recording.name, recording.t, recording.q, effort)
    rows = len(signals.t)
    enough = _PER_CUTOFF * signals.cutoff if f"{COMMANDED}1" in recording.columns else _RATE
    step = max(1, int(signals.rate / enough + 0.5), -(-rows // MOST_ROWS))
    if rows < step * _LEAST_ROWS:
        raise DiagnosisError(
            f"{recording.name}: {rows} rows follow each other: a diagnosis of joint efforts needs "
            f"{step * _LEAST_ROWS} rows or more of one motion; calibrate takes shorter pieces"
        )
    currents = prefix == "i"
    if currents:
        known = _constants(recording, drives)
        signals = replace(signals, effort=signals.effort * known)
    if f"{COMMANDED}1" not in recording.columns:
        drives = drives.beyond(np.ones(effort.shape[1]))
    model = Model.of(robot, recording.metadata)
    theta = robot.robot_theta(model.configured(recording.metadata))
    inertias = link_inertias(robot, theta)
    rotor = np.where(drives.known("drive.inertia"), drives.of("drive.inertia"), inertias.rotor)
    inertias = replace(inertias, rotor=rotor)
    y = torque_regressor(robot, theta, signals.q, np.asarray(model.gravity))
    body = y @ inertias.phi.ravel() + rotor_torque(robot, theta, inertias, signals.q)
    friction, levels = _friction(drives, signals.q.d, signals.effort - body)
    return EffortScene(
        recording, robot, model, theta, inertias, signals, body, friction, levels, y, drives,
        currents, step, np.asarray(recording.wrench, dtype=float) if wrench else None,
        turned=turned,
    )  # fmt: skip


def _constants(recording: Recording, drives: Drives) -> np.ndarray:
    """Drive constants (J,) [N·m/A, of slides N/A]: stated, else fitted with ordinary friction."""
    known, stated = drives.known("drive.constant"), drives.of("drive.constant")
    if known.all():
        return stated
    fit = calibrate_efforts(recording, (*FRICTION, CONSTANT), force=True)
    fitted = [fit[f"{CONSTANT}.{j + 1}"] for j in range(len(known))]
    if untold := [j + 1 for j, p in enumerate(fitted) if p.std is None and not known[j]]:
        raise DiagnosisError(
            f"{recording.name}: this motion does not tell the drive constant of joint {untold[0]}, "
            f"which carries too little: {_STATE}"
        )
    constants = np.array([p.value for p in fitted])
    wrong = np.flatnonzero(~known & ~(np.isfinite(constants) & (constants > 0.0)))
    if wrong.size:
        joint = int(wrong[0]) + 1
        raise DiagnosisError(
            f"{recording.name}: the drive constant of joint {joint} comes out negative: map "
            f"i{joint} with sign = -1, or {_STATE}"
        )
    return np.where(known, stated, constants)


def _friction(
    drives: Drives, speeds: np.ndarray, residual: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Friction (N, J) at speeds (N, J) and its levels (3, J); what is not stated is fitted to the
    residual (N, J) of the rigid body by least squares."""
    friction, levels = np.zeros_like(speeds), np.zeros((3, speeds.shape[1]))
    for j, speed in enumerate(speeds.T):
        columns = np.column_stack([direction(speed), speed, np.ones_like(speed)])
        stated = [drives.value[k][j] for k in ("drive.coulomb", "drive.viscous", "drive.offset")]
        known = np.isfinite(stated[0])
        fit = stated if known else np.linalg.lstsq(columns, residual[:, j], rcond=None)[0]
        levels[:, j] = np.nan_to_num(fit)
        friction[:, j] = columns @ levels[:, j]
    return friction, levels
