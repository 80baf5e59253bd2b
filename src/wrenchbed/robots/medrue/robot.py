"""MedRUE as a plug-in: its moving bodies, and its parameters written into its MJCF.

Masses and centres of gravity are those of ``models/medrue/medrue.xml``: estimates
(``models/medrue/README.md``), the paper has none.
"""

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from wrenchbed.physics.gravity_torques import BodyMass
from wrenchbed.physics.rotations import (
    apply,
    euler,
    euler_rates,
    rot_x,
    rot_x_of,
    rot_y,
    rot_y_of,
    rot_z,
    rot_z_of,
)
from wrenchbed.physics.taylor_jets import Value, atan2, jet_sqrt, stack_jets
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.base import (
    LOAD,
    GoalSets,
    Joint,
    SimulatedRobot,
    Values,
    inertia_matrix,
    sample_until,
)
from wrenchbed.robots.compiled.statics import Packed
from wrenchbed.robots.medrue import inverse_kinematics
from wrenchbed.robots.medrue.kinematics import (
    IDENTIFIED,
    PAPER,
    PARAMETERS,
    FiveBar,
    dot,
    elbow,
    failures,
    solved,
)
from wrenchbed.robots.mjspec_edits import bare, place, rotate_body, write_load

JOINTS = ("q1", "q2", "b1", "q3", "d1", "q6", "beta", "alpha", "slide", "q4", "b2", "q5", "d2")
"""The MJCF's joints in the order of MuJoCo's ``qpos``."""


def write(mjcf: Path, p: Values, tool: Tool, ref: np.ndarray) -> mujoco.MjSpec:
    """Return MedRUE's MJCF spec with parameters p and load ``tool``, its joints `JOINTS` at ``ref``
    (13,), where the loops close."""
    spec = bare(mjcf)
    at = dict(zip(JOINTS, (float(r) for r in ref), strict=True))
    for joint, value in at.items():
        spec.joint(joint).ref = value
    spec.key("home").qpos = ref
    place(spec, "base", [p["x0"], p["y0"], p["z0"]], _turn(p, "0"))
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
    place(spec, "tool", [p["xS"], p["yS"], p["zS"]], _turn(p, "S"))
    write_load(spec, tool)
    tcp = spec.site("tcp")
    tcp.pos = [p["xT"], p["yT"], p["zT"]]
    rotate_body(tcp, _turn(p, "T"))
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


class MedRUE(SimulatedRobot):
    """The robot MedRUE: two five-bars on a linear guide carry the probe (Joubair et al. 2016)."""

    name = "medrue"
    title = "MedRUE, six-axis medical robot of two five-bars, ATI Mini40"
    sensor = "ati-mini40"
    parameters = PARAMETERS
    gravity = (0.0, 0.0, -9.81)  # the paper's
    load = LOAD | {"mTool", "xG", "yG", "zG"}
    free = tuple(IDENTIFIED)
    candidates = PAPER.names
    unobservable = ("xT", "yT", "zT", "alphaT", "betaT", "gammaT", "d31", "d32")
    gear_ratio = ()  # unknown
    broadcasts = True
    compiled = "medrue"
    carrier = JOINTS.index("alpha")
    zero_names = ("dq1", "dq2", "dq3", "dq4", "dq5", "dq6")
    joints = (
        Joint("q1", "m", -0.5, 1.1, 0.25),
        Joint("q2", "rad", 1.658, 4.887, 1.0),
        Joint("q3", "rad", 0.785, 3.403, 1.0),
        Joint("q4", "rad", 1.658, 4.887, 1.0),
        Joint("q5", "rad", 0.785, 3.403, 1.0),
        Joint("q6", "rad", -6.283, 12.566, 1.0),
    )

    @cached_property
    def bodies(self) -> tuple[BodyMass, ...]:  # type: ignore[override]
        """Mass [kg] and CoG [m], in body axes, of the MJCF's moving bodies in order of `JOINTS`."""
        spec = bare(self.mjcf)
        every = (spec.joint(joint).parent for joint in JOINTS)
        return tuple(BodyMass(b.name, float(b.mass), tuple(b.ipos.tolist())) for b in every)

    @property
    def eye(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return (1.9, -0.8, 1.1), (0.35, 0.3, 0.2)

    @property
    def home(self) -> np.ndarray:
        return np.array([0.0, 2.932153143, 2.373647784, 2.932153143, 2.373647784, 4.714624603])

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        """R_world_sensor (…, N, 3, 3) and the sensor's origin (…, N, 3) [m] (Equation 1)."""
        p = self.values(theta)
        loops, base, mount = solved(p, q), _turn(p, "0"), _turn(p, "S")
        wrist = loops.wrist
        inner = loops.origin + apply(wrist, _place(p, "S"))
        return base @ wrist @ mount, _place(p, "0") + apply(base, inner)

    def tool_pose(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_world_tool (…, N, 3, 3) and position (…, N, 3) [m] of the probe, in the world."""
        p, (rotation, origin) = self.values(theta), self.sensor_pose(q, theta)
        return rotation @ _turn(p, "T"), origin + apply(rotation, _place(p, "T"))

    def link_frames(self, q: Value, theta: np.ndarray) -> list[tuple[Value, Value]]:
        p = self.values(theta)
        loops, base, x = solved(p, q), _turn(p, "0"), q[..., 0] + p["dq1"]
        roll = rot_x_of(*loops.gamma)
        yoke = roll @ rot_y_of(*loops.beta)
        wrist = yoke @ rot_z_of(*loops.alpha)
        one = _bars(p, 1, x - p["d41"] - p["d31"], loops.bars[0])
        two = _bars(p, 2, x + p["d42"] + p["d32"], loops.bars[1])
        inner = [(np.eye(3), stack_jets([x, 0.0, 0.0])), *one, (roll, loops.e1), (yoke, loops.e1),
                 (wrist, loops.origin), (wrist, loops.e2), *two]  # fmt: skip
        return [(base @ turn, apply(base, at) + _place(p, "0")) for turn, at in inner]

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        """Gravity in sensor axes (…, N, 3), from world axes (3,), by turning it angle by angle:
        half the cost of a pose."""
        p = self.values(theta)
        loops, mount = solved(p, q), _turn(p, "S")
        x, y, z = np.moveaxis(gravity @ _turn(p, "0"), -1, 0)
        for turn in (loops.gamma, loops.beta, loops.alpha):  # about x, y, z: each axis comes first
            x, y, z = x, turn.c * y + turn.s * z, turn.c * z - turn.s * y
            x, y, z = y, z, x
        seen = np.stack(np.broadcast_arrays(x, y, z), axis=-1)
        return np.asarray(seen @ (mount if mount.ndim == 2 else mount[..., 0, :, :]))

    def packed(self, theta: np.ndarray, gravity: np.ndarray) -> Packed:
        """Constants for `compiled.statics`: d41 + d42, L14, dq6, and eleven of each five-bar."""
        p = self.values(theta)
        numbers = [p["d41"] + p["d42"], p["L14"], p["dq6"]]
        for i in (1, 2):
            ay, az, cy, cz = p[f"A{i}y"], p[f"A{i}z"], p[f"C{i}y"], p[f"C{i}z"]
            l1, l2, l3, l4 = (p[f"L{i}{k}"] for k in (1, 2, 3, 4))
            base = np.sqrt((ay - cy) * (ay - cy) + (az - cz) * (az - cz))
            numbers += [base / 2, l1, l3, l4 * l4 - l2 * l2, l4 * l4, (ay - cy) / base,
                    (cz - az) / base, (ay + cy) / 2, (az + cz) / 2,
                    p[f"dq{2 * i}"], p[f"dq{2 * i + 1}"]]  # fmt: skip
        return Packed(gravity @ _turn(p, "0"), _turn(p, "S"), np.stack(numbers, axis=-1))

    def tool(self, theta: np.ndarray) -> Tool:
        p = self.values(theta)
        mount = _turn(p, "S")
        lever = stack_jets([p[f"{a}G"] - p[f"{a}S"] for a in "xyz"])
        cog = apply(np.swapaxes(mount, -1, -2), lever)
        return Tool(p["mTool"], cog, inertia_matrix(p), p["sensor.mass"])

    def base_origin(self, theta: np.ndarray) -> np.ndarray:
        return np.array([self.values(theta)[f"{a}0"] for a in "xyz"])

    def theta_of_tool(self, theta: np.ndarray, mass: float, cog: Sequence[float]) -> np.ndarray:
        p = self.values(theta)
        mount = _turn(p, "S")
        centre = np.array([p["xS"], p["yS"], p["zS"]]) + mount @ np.asarray(cog, dtype=float)
        values = {"mTool": mass, "xG": centre[0], "yG": centre[1], "zG": centre[2]}
        return self.parameters.vector({k: float(v) for k, v in values.items()}, start=theta)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self.outside_limits(q) | failures(self.values(theta), q)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        def draw(count: int) -> np.ndarray:
            poses = inverse_kinematics.random_poses(count, rng)
            return inverse_kinematics.reachable(self, *poses)[0]

        return sample_until(n, draw, lambda q: np.ones(len(q), dtype=bool))

    def pool(self, n: int, seed: int) -> np.ndarray:
        return inverse_kinematics.pool(self, n, seed)

    def target(self) -> np.ndarray:
        return inverse_kinematics.target(self)

    def goal_sets(self, pool: int, points: np.ndarray | None, seed: int) -> GoalSets:
        known = inverse_kinematics.default_points() if points is None else points
        touch, which = inverse_kinematics.touch_poses(self, known, seed)
        return GoalSets(self.pool(pool, seed), touch, known[which], self.target())

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        """The MJCF's 13 joint coordinates (…, N, 13), depth first, at q; real parameters only."""
        p = self.values(theta)
        loops = solved(p, q)
        (left, right), span = loops.bars, loops.e2 - loops.e1
        return stack_jets(
            [
                q[..., 0],
                q[..., 1], elbow(left.direction, q[..., 1] + p["dq2"], left.E - left.B),
                q[..., 2], elbow(left.direction, q[..., 2] + p["dq3"], left.E - left.D),
                q[..., 5], atan2(loops.beta.s, loops.beta.c), atan2(loops.alpha.s, loops.alpha.c),
                jet_sqrt(dot(span, span)),
                q[..., 3], elbow(right.direction, q[..., 3] + p["dq4"], right.E - right.B),
                q[..., 4], elbow(right.direction, q[..., 4] + p["dq5"], right.E - right.D),
            ]
        )  # fmt: skip

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        ref = self.qpos(self.home[None], theta)[0]
        return write(self.mjcf, self.values(theta), self.tool(theta), ref)

    def symmetries(self, theta: np.ndarray) -> dict[str, dict[str, float]]:
        p = {k: float(v) for k, v in self.values(theta).items()}
        anchors = [f"{a}{i}" for a in "AC" for i in (1, 2)]
        shift = {axis: {f"{a}{axis}": 1.0 for a in anchors} for axis in "yz"}
        scale = {f"{a}{axis}": p[f"{a}{axis}"] for a in anchors for axis in "yz"}
        scale |= {f"L{i}{k}": p[f"L{i}{k}"] for i in (1, 2) for k in (1, 2, 3, 4)}
        scale |= {"d41": p["d41"], "d42": p["d42"]}
        turn = {f"{a}y": -p[f"{a}z"] for a in anchors} | {f"{a}z": p[f"{a}y"] for a in anchors}
        spin = euler_rates(p["alpha0"], p["beta0"], p["gamma0"])
        against = np.linalg.solve(spin, [-1.0, 0.0, 0.0])
        base = _turn(p, "0")
        upright = np.linalg.solve(base @ spin, [0.0, 0.0, 1.0])
        tilt = ("alpha0", "beta0", "gamma0")
        return {
            "a common shift of all anchors along y": shift["y"],
            "a common shift of all anchors along z": shift["z"],
            "a turn of the base about the vertical": dict(zip(tilt, upright, strict=True)),
            "a rotation of all anchors about x0 against the base's tilt": turn
            | dict(zip(tilt, against, strict=True)),
            "the overall scale of anchors, links and d41 + d42": scale,
        }


def _turn(p: Values, of: str) -> Value:
    """Rotation matrix of the frame ``of``: base 0, sensor S or tool T, in the frame before it."""
    return euler(*(p[f"{angle}{of}"] for angle in ("alpha", "beta", "gamma")))


def _place(p: Values, of: str) -> Value:
    """Origin [m] of the frame ``of``: base 0, sensor S or tool T, in the frame before it."""
    return stack_jets([p[f"{axis}{of}"] for axis in "xyz"])


def _bars(p: Values, i: int, x: Value, bar: FiveBar) -> list[tuple[Value, Value]]:
    """Frames (rotation, origin [m]) of links A–B, B–E, C–D, D–E of five-bar i in its plane at ``x``
    [m], in base axes, y along each link."""
    bars = []
    for k, (anchor, middle) in enumerate((("A", bar.B), ("C", bar.D))):
        start = stack_jets([p[f"{anchor}{i}y"], p[f"{anchor}{i}z"]])
        for n, (near, far) in enumerate(((start, middle), (middle, bar.E))):
            along = (far - near) * (1.0 / p[f"L{i}{2 * k + n + 1}"])
            turn = rot_x_of(along[..., 0], along[..., 1])
            bars.append((turn, stack_jets([x, near[..., 0], near[..., 1]])))
    return bars
