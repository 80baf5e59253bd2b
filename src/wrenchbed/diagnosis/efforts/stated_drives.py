"""Stated values of an arm's drives: from the recording's metadata, or from an earlier fit.

They also make torques of commands: tracking errors kp (u(t − T) − q) of position servos, command u,
joint value q, with stiffness kp and delay T stated or fitted. So effects that change torques are
named from commands too; a wrong stiffness appears as a drive constant, a late servo as a lag.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import COMMAND, EFFORT_UNITS, Recording
from wrenchbed.diagnosis.prepare.configured_simulator import LOAD
from wrenchbed.diagnosis.prepare.scenes import at_rows
from wrenchbed.drives.effort_fit import BY_ERRORS
from wrenchbed.drives.servo import DELAY, SERVO, SETPOINT, STIFFNESS, calibrate_servos, pieces_of
from wrenchbed.drives.signals import encoder_noise
from wrenchbed.errors import CalibrationError, DiagnosisError
from wrenchbed.files import checked

KINDS = ("drive.coulomb", "drive.viscous", "drive.offset", "drive.inertia", "drive.constant",
         STIFFNESS, DELAY, SETPOINT)  # fmt: skip
COMMANDED = "commanded"
"""Column prefix of targets of servos times their stiffness [N·m]."""
_ANOTHER_MOTION = 1.3
"""What another motion of a healthy robot leaves over what its fit left: 95 % of the joints of 20
arms with a servo law of their own (1.6: 99 %)."""
FIELD = "configured"
"""Metadata field of stated drive values: by name, ``drive.coulomb.2``, or lists over joints."""


@dataclass(frozen=True, eq=False)
class Drives:
    """Stated values of the drives of J joints, with uncertainties.

    Attributes:
        value, std: stated values (NaN where unknown) and their standard uncertainties (J,), SI, by
            name of the parameter, such as ``drive.coulomb`` or ``servo.delay``.
        load: mass [kg] and CoG [m] of the tool fitted with them, and their std (2, 4), or None.
        left: rms (J,) that their fit left on rows that it did not see [N·m; of commands rad].
        least: least noise of a row (J,) [N·m], as no drive obeys its law exactly.
        scale: relative std of fitted constants, the median of joints: torques of currents and
            commands, and sizes that they measure, scale with them.
        by_errors: change (H,) of each fitted value by ordinary errors (`DriveFit.by_errors`), by
            its name, such as ``drive.offset.2``; empty if it is not known.
    """

    value: Mapping[str, np.ndarray]
    std: Mapping[str, np.ndarray]
    load: np.ndarray | None = None
    left: np.ndarray | float = 0.0
    least: np.ndarray | float = 0.0
    scale: float = 0.0
    by_errors: Mapping[str, np.ndarray] = field(default_factory=dict)

    def beyond(self, per_unit: np.ndarray, least: float = 0.0) -> "Drives":
        """Copy whose noise is at least ``least`` [N·m] and what the healthy fit left, where one
        unit of ``left`` is ``per_unit`` (J,) [N·m]."""
        return replace(self, least=np.maximum(least, _ANOTHER_MOTION * per_unit * self.left))

    def known(self, kind: str) -> np.ndarray:
        """Whether each joint (J,) has a stated value of parameter ``kind`` (`KINDS`), boolean."""
        return np.asarray(np.isfinite(self.value[kind]))

    def of(self, kind: str) -> np.ndarray:
        """Stated values (J,), SI, of the drive parameter ``kind`` (`KINDS`), 0 where unknown."""
        return np.nan_to_num(self.value[kind])


def stated_drives(recording: Recording, path: str | Path | None = None) -> Drives:
    """Stated values from the metadata, replaced by those fitted to a recording without faults.

    ``path``: file of ``wrenchbed calibrate`` on joint efforts, or ``drives.json``, if any; the
    metadata of ``recording`` may state ``configured``.

    Raises:
        DiagnosisError: a field is no number, or the fit is of another robot or of wrenches.
    """
    joints = len(recording.joints)
    value = {k: np.full(joints, np.nan) for k in KINDS}
    std = {k: np.zeros(joints) for k in KINDS}
    where, raw = f"{recording.name}: metadata ", recording.metadata.extra.get(FIELD, {})
    _state(value, checked.Fields(raw, where, DiagnosisError, FIELD))
    if path is None:
        return Drives(value, std)
    return _from_fit(recording, Path(path), value, std)


def with_tool(recording: Recording, drives: Drives) -> Recording:
    """Recording with the tool of an earlier fit, if its metadata state none."""
    if drives.load is None or recording.metadata.tool.mass is not None:
        return recording
    mass, *cog = drives.load[0].tolist()
    tool = ToolInfo(mass, tuple(cog))
    return replace(recording, metadata=replace(recording.metadata, tool=tool))


def _state(value: Mapping[str, np.ndarray], stated: checked.Fields) -> None:
    """Write the fields ``stated`` of a file, drive values by name or as lists over joints, into
    ``value`` (J,) by `KINDS`."""
    for kind, values in value.items():
        if (every := stated.numbers(kind, len(values))) is not None:
            values[:] = every
        for j in range(len(values)):
            if (name := f"{kind}.{j + 1}") in stated.raw:
                values[j] = stated.stated_number(name)


def _from_fit(
    recording: Recording, path: Path, value: dict[str, np.ndarray], std: dict[str, np.ndarray]
) -> Drives:
    """Stated values by those of a fit's file, else ``value`` and ``std`` (J,) by kind."""
    raw = checked.load(path, DiagnosisError)
    fields = checked.Fields(raw, f"{path}: ", DiagnosisError)
    if FIELD in fields.raw:  # of an earlier diagnosis
        _state(value, fields.part(FIELD))
        return Drives(value, std)
    channels = "command" if recording.only_commanded else "effort"
    if fields.raw.get("channels") != channels:
        raise fields.error("channels", f"must be {channels!r}: give a fit of such a recording")
    if fields.raw.get("robot") != recording.metadata.robot:
        raise fields.error("robot", f"must be {recording.metadata.robot!r}, as in the recording")
    constants = value["drive.constant"]
    constants[:] = fields.numbers("constants", len(constants)) or constants
    known, by_errors, scale = _parameters(fields)
    for kind, values in value.items():
        for j in range(len(values)):
            if (name := f"{kind}.{j + 1}") in known:
                values[j], std[kind][j] = known[name]
    load = [known[name] for name in LOAD if name in known]
    left = np.array([part.stated_number("held_out") for part in fields.parts("joints")])
    whole = len(load) == len(LOAD) and load[0][0] > 0.0
    if fields.raw.get("unit") == EFFORT_UNITS["i"]:
        left = left * np.nan_to_num(constants)
    moved = len(left) == len(constants) and "poses" not in fields.raw  # else friction's sign is new
    of_tool = whole and recording.metadata.tool.mass is None  # else the fit's tool predicts nothing
    named = {*LOAD, *(f"{kind}.{j + 1}" for kind in KINDS for j in range(len(constants)))}
    changes = {name: x for name, x in by_errors.items() if name in named} if of_tool else {}
    return Drives(
        value, std, np.array(load).T if whole else None, left if moved else 0.0,
        scale=scale, by_errors=changes,
    )  # fmt: skip


def _parameters(
    fields: checked.Fields,
) -> tuple[dict[str, tuple[float, float]], dict[str, np.ndarray], float]:
    """Values of a fit's parameters, without undetermined ones, with standard uncertainties beside
    known ordinary errors, their changes by these errors, and relative std of its constants
    (`Drives.by_errors`, `Drives.scale`), from its file."""
    parameters, errors = fields.part("parameters"), fields.part(BY_ERRORS)
    size = errors.number("size", "", nonnegative=True) or 0.0
    result, by_errors = dict[str, tuple[float, float]](), dict[str, np.ndarray]()
    scales = []
    for name in parameters.raw:
        if name in LOAD or name.startswith(KINDS):
            entry = parameters.part(name)
            number, spread = entry.number("value", ""), entry.number("std", "", nonnegative=True)
            if number is not None and spread is not None:
                alone = spread
                if isinstance(changes := errors.raw.get(name), list):
                    by_errors[name] = np.array(errors.stated_numbers(name, len(changes)))
                    all_of_one = float(np.linalg.norm(by_errors[name]))
                    alone = float(np.sqrt(max(spread**2 - (size * all_of_one) ** 2, 0.0)))
                    spread = float(np.hypot(alone, (size or 1.0) * all_of_one))
                if name.startswith(("drive.constant", STIFFNESS)) and number:
                    scales.append(spread / abs(number))
                result[name] = number, alone
    return result, by_errors, float(np.median(scales)) if scales else 0.0


def as_efforts(recording: Recording, drives: Drives) -> tuple[Recording, Drives]:
    """Convert the longest piece of commands to a recording of joint torques. Return it, and the
    drives' values that predict it. Their noise is at least one row's encoder noise.

    Raises:
        DiagnosisError: the servos' stiffness is not stated and cannot be fitted.
    """
    try:
        piece = max(pieces_of(recording), key=lambda p: len(p.signals.t))
        drives = drives if drives.known(STIFFNESS).all() else _fitted(recording, drives)
    except CalibrationError as error:
        raise DiagnosisError(str(error)) from error
    stiffness = drives.of(STIFFNESS)
    target, q = piece.held(drives.of(DELAY)), piece.signals.effort
    speed = piece.speed(drives.of(DELAY))
    target = target - drives.of(SETPOINT) * speed * np.abs(speed)
    first = int(np.searchsorted(recording.t, piece.signals.t[0]))
    rows = at_rows(recording, slice(first, first + len(target)))
    columns = {k: v for k, v in rows.columns.items() if not k.startswith(COMMAND)}
    for j, kp in enumerate(stiffness):
        columns[f"tau{j + 1}"] = kp * (target[:, j] - q[:, j])
        columns[f"{COMMANDED}{j + 1}"] = kp * target[:, j]
    noise = [encoder_noise(x, piece.signals.rate) for x in piece.signals.effort.T]
    value = {**drives.value, "drive.constant": stiffness}
    std = {**drives.std, "drive.constant": drives.std[STIFFNESS]}
    known = replace(drives, value=value, std=std)
    least = float(np.median(stiffness * noise))
    return replace(rows, columns=columns), known.beyond(stiffness, least)


def _fitted(recording: Recording, drives: Drives) -> Drives:
    """Copy of ``drives`` with servo stiffness and delay fitted to the recording itself."""
    fit = calibrate_servos(recording, (SERVO,))
    kinds, many = (STIFFNESS, DELAY, SETPOINT), range(1, len(recording.joints) + 1)
    value = {k: np.array([fit[f"{k}.{j}"].value for j in many]) for k in kinds}
    return replace(drives, value={**drives.value, **value})
