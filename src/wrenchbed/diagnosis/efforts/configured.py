"""What is stated of an arm's drives: in the recording's metadata, or by an earlier fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.data.metadata import ToolInfo
from wrenchbed.data.recording import Recording
from wrenchbed.errors import DiagnosisError
from wrenchbed.files import checked

KINDS = ("drive.coulomb", "drive.viscous", "drive.offset", "drive.inertia", "drive.constant")
LOAD = ("tool.mass", "tool.cog.x", "tool.cog.y", "tool.cog.z")
FIELD = "configured"
"""Field of the metadata: values by name, ``drive.coulomb.2``, or lists of one a joint."""


@dataclass(frozen=True)
class FittedTool:
    """Tool that an earlier fit found, with the standard uncertainty of mass [kg] and CoG [m].

    The other values of that fit hold beside this tool, so it goes with them.
    """

    tool: ToolInfo
    mass_std: float
    cog_std: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Drives:
    """Stated values of drives by kind (J,) with their standard uncertainty; NaN where unknown.

    Attributes:
        value, std: by kind (J,).
        tool: that of the fit they are from, if one has it.
    """

    value: Mapping[str, np.ndarray]
    std: Mapping[str, np.ndarray]
    tool: FittedTool | None = None

    def known(self, kind: str) -> np.ndarray:
        """Which joints (J,) have a stated value of a drive parameter, boolean."""
        return np.asarray(np.isfinite(self.value[kind]))

    def of(self, kind: str) -> np.ndarray:
        """Stated values (J,) of a drive parameter, zero where unknown."""
        return np.nan_to_num(self.value[kind])


def stated_drives(recording: Recording, path: str | Path | None = None) -> Drives:
    """Values of the metadata, replaced by those of a fit of a healthy recording.

    Args:
        recording: its metadata may state ``configured``.
        path: of the output of ``wrenchbed calibrate`` on joint efforts, or of ``drives.json`` of a
            diagnosis, if any.

    Raises:
        DiagnosisError: a field is no number, or the fit is of another robot or of wrenches.
    """
    joints = len(recording.joints)
    value = {k: np.full(joints, np.nan) for k in KINDS}
    std = {k: np.zeros(joints) for k in KINDS}
    raw = recording.metadata.extra.get(FIELD, {})
    where = f"{recording.name}: metadata {FIELD}"
    if not isinstance(raw, Mapping):
        raise DiagnosisError(f"{where}: must be values by name, as drive.coulomb.2")
    for kind in KINDS:
        if kind in raw:
            value[kind][:] = _numbers(raw[kind], joints, f"{where}.{kind}")
        for j in range(joints):
            if (name := f"{kind}.{j + 1}") in raw:
                value[kind][j] = _numbers([raw[name]], 1, f"{where}.{name}")[0]
    tool = None if path is None else _from_fit(recording, Path(path), value, std)
    return Drives(value, std, tool)


def with_tool(recording: Recording, drives: Drives) -> Recording:
    """The recording with the tool of an earlier fit, where its metadata state none."""
    if drives.tool is None or recording.metadata.tool.mass is not None:
        return recording
    return replace(recording, metadata=replace(recording.metadata, tool=drives.tool.tool))


def _numbers(raw: Any, count: int, where: str) -> np.ndarray:
    try:
        found = np.asarray(raw, dtype=float)
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise DiagnosisError(f"{where}: must be {count} finite number{'s' * (count > 1)}")
    return found


def _from_fit(
    recording: Recording, path: Path, value: dict[str, np.ndarray], std: dict[str, np.ndarray]
) -> FittedTool | None:
    """Fill in a fit's values, and return its tool."""
    raw = checked.load(path, DiagnosisError)
    fields = checked.Fields(raw, f"{path}: ", DiagnosisError)
    if FIELD in fields.raw:  # of an earlier diagnosis
        for name, known in fields.part(FIELD).raw.items():
            kind, _, number = str(name).rpartition(".")
            if kind in value and number.isdigit() and 1 <= int(number) <= len(value[kind]):
                value[kind][int(number) - 1] = _numbers([known], 1, f"{path}: {FIELD}.{name}")[0]
        return None
    if fields.raw.get("channels") != "effort":
        raise fields.error("channels", "must be 'effort': give a fit of joint efforts")
    if fields.raw.get("robot") != recording.metadata.robot:
        raise fields.error("robot", f"must be {recording.metadata.robot!r}, as in the recording")
    if "constants" in fields.raw:
        many = len(value["drive.constant"])
        value["drive.constant"][:] = _numbers(fields.raw["constants"], many, f"{path}: constants")
    for name, entry in fields.part("parameters").raw.items():
        kind, _, number = str(name).rpartition(".")
        if kind not in value or not number.isdigit() or not 1 <= int(number) <= len(value[kind]):
            continue
        entries = checked.Fields(entry, f"{path}: parameters.{name}.", DiagnosisError)
        found, spread = entries.number("value", ""), entries.number("std", "", nonnegative=True)
        if found is not None and spread is not None:  # without one, that motion did not tell it
            value[kind][int(number) - 1] = found
            std[kind][int(number) - 1] = spread
    return _tool(fields.part("parameters"), path)


def _tool(parameters: checked.Fields, path: Path) -> FittedTool | None:
    """Tool of a fit; None where it tells no mass or no centre of gravity."""

    def known(names: Sequence[str]) -> list[tuple[float, float]]:
        entries = [parameters.raw.get(name) for name in names]
        found = [
            (entry.number("value", ""), entry.number("std", "", nonnegative=True))
            for name, raw in zip(names, entries, strict=True)
            if raw is not None
            for entry in [checked.Fields(raw, f"{path}: parameters.{name}.", DiagnosisError)]
        ]
        return [(v, s) for v, s in found if v is not None and s is not None]

    load = known(LOAD)
    if len(load) != len(LOAD) or load[0][0] <= 0.0:
        return None
    cog, cog_std = zip(*load[1:], strict=True)
    return FittedTool(ToolInfo(load[0][0], cog), load[0][1], cog_std)
