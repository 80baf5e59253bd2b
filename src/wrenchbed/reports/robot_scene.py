"""Probability that each part of a robot is to blame for the gap; and the robot of a diagnosis as a
page draws it, coloured by these, with loads and residuals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.diagnosis.result import Diagnosis
from wrenchbed.pages import numbers
from wrenchbed.pages.chart import Role
from wrenchbed.pages.scene import Arrows, Part, Scene
from wrenchbed.physics.rotations import matrix
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.claim import joints, joints_or
from wrenchbed.reports.compared_readings import HeldOutReadings, along
from wrenchbed.reports.effort_answer import residuals_of, shown_rows
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.simulation.mujoco_wrench import Simulation
from wrenchbed.simulation.triangle_meshes import bodies, geoms_of, motion, triangles

MOST_MOMENTS = 150
"""Most moments of a robot on a page: as a plan has poses, or ten a second of a short motion."""
NOISE_M = 0.01
"""Length of an arrow as large as the noise of a row [m]: equal on every page."""
LONGEST_M = 0.5
"""Longest arrow [m]: a residual beyond 50 times the noise is cut, to stay in view."""
FORCE_M = 0.01
"""Length of the arrow of a load of 1 N [m]."""
_ROLES: tuple[Role, ...] = ("before", "after")
_TENTHS = 4
"""Decimals to which positions [m] are rounded on a page: tenths of a millimetre."""


def blame(diagnosis: Mapping[str, Any]) -> dict[str, float]:
    """Probability (0 … 1) that each part is a cause, by name, from the JSON of a diagnosis.

    Joints that a cause or rival names, or whose drives it names, are parts of their own, ``joint
    2``. Indistinguishable rivals have their shares of the probability of their group.
    """
    shares: dict[str, float] = {}
    for cause in diagnosis["which"]:
        others = [(rival, float(rival["probability"])) for rival in cause["rivals"]]
        first = max(float(cause["probability"]) - sum(p for _, p in others), 0.0)
        for entry, p in ((cause, first), *others):
            part = str(entry["effect"]).split(".")[0].replace("drive", "joint")
            blamed = joints(entry) if part in ("joint", "link") else []
            share = p / len(blamed) if joints_or(entry) and blamed else p  # one of them
            for place in [f"{part} {k}" for k in blamed] or [part]:
                shares[place] = min(1.0, shares.get(place, 0.0) + share)
    return shares


def part_of(simulation: Simulation, shown_world: bool) -> dict[int, Sequence[str]]:
    """Geom's index → names of the parts of the robot that it shows; with ``shown_world`` also bench
    and floor.

    A geom without a name belongs to the named one before it in the same body.
    """
    model, carried = simulation.model, _carriers(simulation)
    tool = int(model.body("tool").id)
    bodies = {model.geom(g).name: int(b) for g, b in enumerate(model.geom_bodyid)}
    sensor = bodies.get("sensor", tool)
    whole = ("sensor",) if "sensor_rim" in bodies else ("sensor", "mount")
    parts: dict[int, Sequence[str]] = {}
    name, before = "", -1
    for g, body in enumerate(map(int, model.geom_bodyid)):
        name = model.geom(g).name or (name if body == before else "")
        before = body
        if body == 0:
            parts |= {g: ("environment",)} if shown_world else {}
        elif body not in (sensor, tool):
            parts[g] = carried[body]
        elif name.startswith("sensor_cable"):
            parts[g] = ("cable",)
        elif name == "sensor_rim":
            parts[g] = ("mount", "sensor")
        else:
            parts[g] = whole if body != tool or name.startswith("sensor") else ("tool",)
    return parts


def _carriers(simulation: Simulation) -> dict[int, Sequence[str]]:
    """Body's index → names of the parts that it shows: its joint and link if an actuated joint
    moves it, else its link."""
    model, joints = simulation.model, simulation.robot.joints
    number = {int(model.joint(j.name).bodyid[0]): k for k, j in enumerate(joints, start=1)}
    parts: dict[int, Sequence[str]] = {}
    for b in range(1, model.nbody):
        if b in number:
            parts[b] = (f"joint {number[b]}", "joint", f"link {number[b]}", "link")
        else:
            parts[b] = ("link",) if int(model.body_parentid[b]) in parts else ("base",)
    return parts


def wrench_scene(e: HeldOutReadings) -> Scene | None:
    """Drawing of the robot at the observations of a wrench; None without joints or a model."""
    p, robot = e.prepared, e.prepared.robot
    if not isinstance(robot, SimulatedRobot) or not p.scene.jointed:
        return None
    held, arrows = p.scene.held, list[Arrows]()
    residuals = e.residuals
    rms = np.sqrt((residuals[e.first] ** 2).mean(axis=1))
    if e.names[:6] == CHANNELS:
        arrows.append(Arrows("load", "box", FORCE_M * p.scene.load[held][:, :3]))
        for k, part in ((0, "force"), (3, "torque")):
            for role, name in zip(_ROLES, residuals, strict=False):
                vectors = _limited(residuals[name][:, k : k + 3])
                arrows.append(Arrows(f"{part}, {name}", role, vectors, 1 + k // 3))
    at, axis = along(p)
    times = [f"{x:.2f} s" if axis.unit else f"pose {x:.0f}" for x in at]
    d, q = e.findings.diagnosis, p.scene.joints[held]
    return _scene(d, Simulation(robot, p.scene.theta), q, e.ids, times, rms, arrows)


def effort_scene(f: EffortFindings) -> Scene:
    """Drawing of the robot in the stretch of a motion whose efforts the page draws."""
    scene, shown = f.d.scene, shown_rows(f)
    residual = np.ma.masked_invalid(residuals_of(f)["calibrated"][shown])
    times = [f"{x:.2f} s" for x in scene.signals.t[scene.kept()][shown]]
    q = scene.q.v[scene.kept()][shown]
    rms = np.ma.sqrt((residual**2).mean(axis=1)).filled(np.nan)
    return _scene(f.diagnosis, Simulation(scene.robot, scene.theta), q, shown, times, rms)


def _limited(residual: np.ndarray) -> np.ndarray:
    """Arrows (K, 3) [m] of residuals (K, 3) [noise of a row], cut at `LONGEST_M`."""
    length = NOISE_M * np.linalg.norm(residual, axis=1, keepdims=True)
    shorter = np.minimum(1.0, LONGEST_M / np.maximum(length, 1e-9))
    return np.asarray(NOISE_M * residual * shorter)


def _scene(
    d: Diagnosis, simulation: Simulation, q: np.ndarray, ids: np.ndarray, times: Sequence[str],
    rms: np.ndarray, arrows: Sequence[Arrows] = (),
) -> Scene:  # fmt: skip
    """Drawing of the robot at evenly spread ones of K moments and at that with the largest
    residual: joint values q (K, J), numbers of observations ``ids`` (K,), ``times`` in words,
    residual ``rms`` (K,) [noise of a row], NaN where no joint counts, ``arrows`` at all K."""
    worst, counted = int(np.argmax(np.nan_to_num(rms))), np.isfinite(rms)
    rows = np.linspace(0, len(q) - 1, min(len(q), MOST_MOMENTS)).astype(int)
    rows = np.union1d(rows, [worst])
    seen, shares = motion(simulation, q[rows]), blame(d.to_json())
    turns = np.stack([matrix(x) for x in np.roll(seen.quaternion, 1, axis=-1).reshape(-1, 4)])
    frames = np.concatenate([turns.reshape(*seen.position.shape, 3), seen.position[..., None]], -1)
    sensor = np.concatenate([seen.rotation, seen.sensor[..., None]], axis=-1)
    parts = _parts(simulation, shares)
    arrows = [replace(a, vectors=a.vectors[rows].round(_TENTHS)) for a in arrows]
    labels = [f"{times[k]}, residual {numbers.gap(float(rms[k]))} × noise" if counted[k]
              else f"{times[k]}, hardly any joint moves" for k in rows]  # fmt: skip
    eye = np.subtract(*simulation.robot.eye)
    frames = np.concatenate([frames, sensor[:, None]], axis=1).round(_TENTHS)
    return Scene(
        "robot", "The robot, coloured by blame", parts, frames, arrows, labels, ids[rows],
        int(np.searchsorted(rows, worst)), eye, _caption(shares, parts, arrows),
        f"{len(rows)} of {len(q):,} moments." if len(rows) < len(q) else "",
    )  # fmt: skip


def _parts(simulation: Simulation, shares: Mapping[str, float]) -> list[Part]:
    """Drawn parts: the geoms of one body that show one part; ``shares``: part → probability of
    blame."""
    model, merged = simulation.model, dict[tuple[int, str, float], list[np.ndarray]]()
    known = part_of(simulation, "environment" in shares)
    for k, body in enumerate(bodies(model).values()):
        for g in map(int, geoms_of(model, body)):
            if g in known:
                name = max(known[g], key=lambda n: shares.get(n, 0.0))
                key = k, name, shares.get(name, 0.0)
                merged.setdefault(key, []).append(triangles(model, g))
    parts = []
    for (k, name, share), surfaces in merged.items():
        corners = np.concatenate(surfaces).reshape(-1, 3).round(_TENTHS)
        places, faces = np.unique(corners, axis=0, return_inverse=True)
        parts.append(Part(name, k, share, places, faces.reshape(-1, 3)))
    return parts


def _caption(shares: Mapping[str, float], parts: Sequence[Part], arrows: Sequence[Arrows]) -> str:
    """Text on the colours (``shares``: part → probability that it is to blame) and the arrows."""
    named = ", ".join(f"{part} {numbers.chance(p)}" for part, p in shares.items())
    text = f"Probability that the cause is there: {named}." if named else "No part is named."
    drawn = {part.name for part in parts}
    if missing := [part for part in shares if part not in drawn]:
        text += f" Not to be seen on the robot: {', '.join(missing)}."
    if arrows:
        text += (
            f" At the sensor: its axes, x red, y green, z blue; the load, {1e3 * FORCE_M:g} mm a "
            f"newton; the residual of force and torque, {1e3 * NOISE_M:g} mm for the noise of a "
            f"row, at most {1e3 * LONGEST_M:g} mm."
        )
    return f"{text} Still picture: the moment that differs most."
