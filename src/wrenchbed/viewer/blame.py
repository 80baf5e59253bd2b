"""Which part of the robot a diagnosis blames, and how much."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco

from wrenchbed.robots.base import Robot
from wrenchbed.viewer.colours import heat

_NUMBERED = re.compile(r"\.[a-z]*(\d+)$")
"""Names as ``offset.q3`` and ``twist.2``."""
_STANDS_OUT = 3.0
"""Standard uncertainties beyond which an amplitude is one."""


def blame(diagnosis: Mapping[str, Any]) -> dict[str, float]:
    """Posterior share (0 … 1) of each part, from a diagnosis as the contract has it.

    Joints that a cause names have their own part, ``joint 2``. Rivals share what their class has.
    """
    told: dict[str, float] = {}
    known = diagnosis["probabilities"]
    for cause in diagnosis["which"]:
        names = [cause["effect"], *cause["rivals"]]
        weights = [max(float(known.get(n, 0.0)), 1e-9) for n in names]
        for name, weight in zip(names, weights, strict=True):
            share = float(cause["probability"]) * weight / sum(weights)
            part = str(name).split(".")[0]
            own = numbers(cause) if part in ("joint", "link") and name == names[0] else []
            for place in [f"{part} {k}" for k in own] or [part]:
                told[place] = min(1.0, told.get(place, 0.0) + share)
    return told


def numbers(cause: Mapping[str, Any]) -> list[int]:
    """Joints or links that a cause is about: as it says, else whose amplitudes stand out."""
    values = cause["parameters"]
    joint = values.get("joint", {}).get("value")
    if isinstance(joint, int):
        return [joint]
    found = set()
    for name, told in values.items():
        match = _NUMBERED.search(name)
        size, std = told.get("value"), told.get("std")
        if match and std and abs(float(size)) > _STANDS_OUT * float(std):
            found.add(int(match[1]))
    return sorted(found)


def painted(
    model: mujoco.MjModel, robot: Robot, shares: Mapping[str, float]
) -> dict[int, tuple[int, ...]]:
    """Colour of each geom of the robot, by its number."""
    parts = part_of(model, robot, "environment" in shares)
    return {g: tuple(int(c) for c in heat(_share(names, shares))) for g, names in parts.items()}


def part_of(model: mujoco.MjModel, robot: Robot, shown_world: bool) -> dict[int, Sequence[str]]:
    """Parts that each geom of the robot stands for; of bench and floor on request.

    A geom without a name belongs to the named one before it in the same body.
    """
    carried = _carriers(model, robot)
    sensor = int(model.geom("sensor").bodyid[0])
    tool = model.body("tool").id
    found: dict[int, Sequence[str]] = {}
    name, body = "", -1
    for g in range(model.ngeom):
        own = int(model.geom_bodyid[g])
        name = model.geom(g).name or (name if own == body else "")
        body = own
        if own == 0:
            if shown_world:
                found[g] = ("environment",)
        elif own in (sensor, tool):
            if name.startswith("sensor_cable"):
                found[g] = ("cable",)
            else:
                found[g] = ("sensor",) if own != tool or name.startswith("sensor") else ("tool",)
            if name == "sensor_rim":
                found[g] = ("mount", "sensor")
        else:
            found[g] = carried.get(own, ("base",))
    return found


def _carriers(model: mujoco.MjModel, robot: Robot) -> dict[int, Sequence[str]]:
    """Of each body that an actuated joint moves: that joint and its link; passive ones: links."""
    number = {int(model.joint(j.name).bodyid[0]): k for k, j in enumerate(robot.joints, start=1)}
    found: dict[int, Sequence[str]] = {}
    for b in range(1, model.nbody):
        if b in number:
            found[b] = (f"joint {number[b]}", "joint", f"link {number[b]}", "link")
        elif model.body_parentid[b] in found:
            found[b] = ("link",)
        else:
            found[b] = ("base",)
    return found


def _share(names: Sequence[str], shares: Mapping[str, float]) -> float:
    return max((shares.get(n, 0.0) for n in names), default=0.0)
