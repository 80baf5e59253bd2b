"""Stated values of an arm's drives: from the recording's metadata, or from an earlier fit."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.prepare.configured_simulator import LOAD
from wrenchbed.errors import DiagnosisError
from wrenchbed.files import checked

KINDS = ("drive.coulomb", "drive.viscous", "drive.offset", "drive.inertia", "drive.constant",
         "servo.stiffness", "servo.delay")  # fmt: skip
FIELD = "configured"
"""Metadata field of stated drive values: by name, ``drive.coulomb.2``, or lists over joints."""


@dataclass(frozen=True, eq=False)
class Drives:
    """Stated values of the drives of J joints, with uncertainties.

    Attributes:
        value, std: stated values (NaN where unknown) and their standard uncertainties (J,), SI, by
            name of the parameter, such as ``drive.coulomb`` or ``servo.delay``.
        load: mass [kg] and CoG [m] of the tool fitted with them, and their std (2, 4), or None.
    """

    value: Mapping[str, np.ndarray]
    std: Mapping[str, np.ndarray]
    load: np.ndarray | None = None

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
    load = None if path is None else _from_fit(recording, Path(path), value, std)
    return Drives(value, std, load)


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
) -> np.ndarray | None:
    """Write a fit's file into ``value`` and ``std`` (J,) by kind; return `Drives.load` from it."""
    raw = checked.load(path, DiagnosisError)
    fields = checked.Fields(raw, f"{path}: ", DiagnosisError)
    if FIELD in fields.raw:  # of an earlier diagnosis
        _state(value, fields.part(FIELD))
        return None
    channels = "command" if recording.only_commanded else "effort"
    if fields.raw.get("channels") != channels:
        raise fields.error("channels", f"must be {channels!r}: give a fit of such a recording")
    if fields.raw.get("robot") != recording.metadata.robot:
        raise fields.error("robot", f"must be {recording.metadata.robot!r}, as in the recording")
    constants = value["drive.constant"]
    constants[:] = fields.numbers("constants", len(constants)) or constants
    known = _parameters(fields.part("parameters"))
    for kind, values in value.items():
        for j in range(len(values)):
            if (name := f"{kind}.{j + 1}") in known:
                values[j], std[kind][j] = known[name]
    load = [known[name] for name in LOAD if name in known]
    return np.array(load).T if len(load) == len(LOAD) and load[0][0] > 0.0 else None


def _parameters(parameters: checked.Fields) -> dict[str, tuple[float, float]]:
    """Values and standard uncertainties of a fit's parameters, without undetermined ones."""
    result = {}
    for name in parameters.raw:
        if name in LOAD or name.startswith(KINDS):
            entry = parameters.part(name)
            number, spread = entry.number("value", ""), entry.number("std", "", nonnegative=True)
            if number is not None and spread is not None:
                result[name] = number, spread
    return result
