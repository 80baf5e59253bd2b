"""Tracking errors of position servos as joint torques kp (u(t − T) − q), command u, joint value q.

Stiffness kp and delay T are stated or fitted. So effects that change torques are named from
commands too; a wrong stiffness appears as a drive constant, a late servo as a lag of its command.
"""

from dataclasses import replace

import numpy as np

from wrenchbed.data.recording import COMMAND, Recording
from wrenchbed.diagnosis.efforts.scene import COMMANDED
from wrenchbed.diagnosis.efforts.stated_drives import Drives
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.diagnosis.prepare.scenes import at_rows
from wrenchbed.drives.servo import DELAY, SERVO, STIFFNESS, calibrate_servos, pieces_of
from wrenchbed.drives.signals import encoder_noise
from wrenchbed.errors import CalibrationError, DiagnosisError


def as_efforts(recording: Recording, drives: Drives) -> tuple[Recording, Drives, Material]:
    """Convert the longest piece of commands to a recording of joint torques. Return it, the drives'
    values that predict it, and one row's encoder noise as a torque, which counts as a gap of 1.

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
    first = int(np.searchsorted(recording.t, piece.signals.t[0]))
    rows = at_rows(recording, slice(first, first + len(target)))
    columns = {k: v for k, v in rows.columns.items() if not k.startswith(COMMAND)}
    for j, kp in enumerate(stiffness):
        columns[f"tau{j + 1}"] = kp * (target[:, j] - q[:, j])
        columns[f"{COMMANDED}{j + 1}"] = kp * target[:, j]
    noise = [encoder_noise(x, piece.signals.rate) for x in piece.signals.effort.T]
    counts = float(np.median(stiffness * noise))
    value = {**drives.value, "drive.constant": stiffness}
    std = {**drives.std, "drive.constant": drives.std[STIFFNESS]}
    known = replace(drives, value=value, std=std)
    return replace(rows, columns=columns), known, Material(counts, counts)


def _fitted(recording: Recording, drives: Drives) -> Drives:
    """Copy of ``drives`` with servo stiffness and delay fitted to the recording itself."""
    fit = calibrate_servos(recording, (SERVO,))
    kinds, many = (STIFFNESS, DELAY), range(1, len(recording.joints) + 1)
    value = {k: np.array([fit[f"{k}.{j}"].value for j in many]) for k in kinds}
    return replace(drives, value={**drives.value, **value})
