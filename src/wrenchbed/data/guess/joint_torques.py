"""The map of a table with joint values and joint torques or currents, by the names of its columns.

Names decide: a torque of a joint is never read as a force of a sensor.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.data.guess.column_readings import joints
from wrenchbed.data.guess.column_roles import Sheet
from wrenchbed.data.guess.convention import gather
from wrenchbed.data.guess.user_facts import Stated
from wrenchbed.errors import MapError

_USUAL = {"tau": "N·m", "i": "A"}
"""Unit of joint torques and of motor currents where no name states one."""


def by_names(sheet: Sheet, stated: Stated, mode: str | None) -> tuple[dict[str, Any], str] | None:
    """Map of a table with named joint torques or currents, and a sentence on it; else None. A
    `MapError` if no robot is stated, or one with another number of joints."""
    kind = next((k for k in _USUAL if f"{k}1" in sheet.roles), None)
    if kind is None or "q1" not in sheet.roles:
        return None
    efforts = {t: c for t, c in sheet.roles.items() if t.rstrip("0123456789") == kind}
    what = f"joint {'torques' if kind == 'tau' else 'currents'}"
    if stated.robot is None:
        raise MapError(
            f"{sheet.path}: {len(efforts)} joint values and {what}, and no wrench: --robot NAME "
            "says whose they are"
        )
    robot = registry.load("robots", stated.robot)
    reading = next(joints(sheet, robot.name, robot.joint_names), None)
    if reading is None or len(efforts) != len(robot.joints):
        raise MapError(
            f"{sheet.path}: {len(efforts)} {what}; {stated.robot} has {len(robot.joints)} joints"
        )
    clock = sheet.clock
    q = sheet.block(reading.names).astype(float)
    rows = gather(None if clock is None else clock.t, q, np.zeros((len(sheet), 6)))
    unit = next((u for c in efforts.values() if (u := sheet.units.get(c))), None)
    columns: dict[str, Mapping[str, Any]] = {}
    if clock is not None:
        columns["t"] = {"column": clock.column, "unit": clock.unit}
    for joint, (target, column) in zip(robot.joints, reading.targets.items(), strict=True):
        size = reading.unit if joint.unit == "rad" else "m"
        columns[target] = {"column": column, "unit": size}
    columns |= {t: {"column": c, "unit": unit or _USUAL[kind]} for t, c in efforts.items()}
    recording: dict[str, Any] = {"robot": stated.robot, "mode": mode or rows.mode}
    if stated.tool_mass is not None:
        recording["tool"] = {"mass": stated.tool_mass}
    taken = "" if unit else ", as no name states a unit"
    sentence = f"{reading.kind}, {what} in {unit or _USUAL[kind]}{taken}, no wrench: by the names"
    if clock is None and recording["mode"] == "static":
        sentence += "; no clock: each row is a pose at rest, else state mode and rate_hz in the map"
    return {"recording": recording, "file": [{"match": "*", "columns": columns}]}, sentence
