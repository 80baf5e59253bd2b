"""MedRUE's parameters written into its MJCF."""

from pathlib import Path

import mujoco
import numpy as np

from wrenchbed.frames import euler, rot_x, rot_y, rot_z
from wrenchbed.mjcf import place, turn, write_load
from wrenchbed.robots.base import Values
from wrenchbed.wrench import Tool

JOINTS = ("q1", "q2", "b1", "q3", "d1", "q6", "beta", "alpha", "slide", "q4", "b2", "q5", "d2")
"""The MJCF's joints in the order of MuJoCo's ``qpos``."""


def write(mjcf: Path, p: Values, tool: Tool, ref: np.ndarray) -> mujoco.MjSpec:
    """The MJCF with every parameter in it, standing with its loops closed at ``ref`` (13,)."""
    spec = mujoco.MjSpec.from_file(str(mjcf))
    at = dict(zip(JOINTS, (float(r) for r in ref), strict=True))
    for joint, value in at.items():
        spec.joint(joint).ref = value
    spec.key("home").qpos = ref
    place(spec, "base", [p["x0"], p["y0"], p["z0"]], euler(p["alpha0"], p["beta0"], p["gamma0"]))
    place(spec, "carriage", [p["dq1"] + at["q1"], 0.0, 0.0])
    for i in (1, 2):
        _write_five_bar(spec, p, i, at)
    place(spec, "roll", [p["d31"], p["L14"], 0.0], rot_x(p["dq6"] + at["q6"]))
    place(spec, "yoke", [0.0, 0.0, 0.0], rot_y(at["beta"]))
    reach = np.array([p["d41"] + p["d5"], 0.0, 0.0])
    swing = rot_z(at["alpha"])
    place(spec, "wrist", swing @ reach, swing)
    spec.joint("alpha").pos = -reach
    place(spec, "slider", [at["slide"] - reach[0], 0.0, 0.0])
    _write_tool(spec, p, tool)
    return spec


def _write_five_bar(spec: mujoco.MjSpec, p: Values, i: int, at: dict[str, float]) -> None:
    side = -1.0 if i == 1 else 1.0
    pin = p[f"d3{i}"]
    plane = side * (p[f"d4{i}"] + pin)
    theta = np.arctan2(p[f"A{i}y"] - p[f"C{i}y"], p[f"C{i}z"] - p[f"A{i}z"]) - np.pi / 2
    arms = (("a", "b", 2 * i, "L%d1", "L%d2"), ("c", "d", 2 * i + 1, "L%d3", "L%d4"))
    for near, far, k, near_link, far_link in arms:
        anchor = near.upper() + str(i)
        angle = rot_x(theta + p[f"dq{k}"] + at[f"q{k}"])
        place(spec, f"proximal_{near}{i}", [plane, p[anchor + "y"], p[anchor + "z"]], angle)
        place(spec, f"distal_{far}{i}", [0.0, p[near_link % i], 0.0], rot_x(at[f"{far}{i}"]))
        spec.site(f"e_{far}{i}").pos = [-side * pin, p[far_link % i], 0.0]


def _write_tool(spec: mujoco.MjSpec, p: Values, tool: Tool) -> None:
    mount = euler(p["alphaS"], p["betaS"], p["gammaS"])
    place(spec, "tool", [p["xS"], p["yS"], p["zS"]], mount)
    write_load(spec, tool)
    tcp = spec.site("tcp")
    tcp.pos = [p["xT"], p["yT"], p["zT"]]
    turn(tcp, euler(p["alphaT"], p["betaT"], p["gammaT"]))
