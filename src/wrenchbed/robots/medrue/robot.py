"""MedRUE as a plug-in."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wrenchbed.physics.rotations import apply, euler, euler_rates
from wrenchbed.physics.time_derivatives import Value, stack_jets
from wrenchbed.physics.wrench import Tool
from wrenchbed.robots.base import (
    LOAD,
    GoalSets,
    Joint,
    SimulatedRobot,
    inertia_matrix,
    sample_until,
)
from wrenchbed.robots.medrue import bodies, kinematics, workspace
from wrenchbed.robots.medrue.jacobian import gravity_slopes
from wrenchbed.robots.medrue.kinematics import IDENTIFIED, PAPER, PARAMETERS

if TYPE_CHECKING:
    import mujoco


class MedRUE(SimulatedRobot):
    """Two five-bars on a linear guide carry the probe: Joubair et al. 2016, 10.3390/s16060798."""

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
    joints = (
        Joint("q1", "m", -0.5, 1.1, 0.25),
        Joint("q2", "rad", 1.658, 4.887, 1.0),
        Joint("q3", "rad", 0.785, 3.403, 1.0),
        Joint("q4", "rad", 1.658, 4.887, 1.0),
        Joint("q5", "rad", 0.785, 3.403, 1.0),
        Joint("q6", "rad", -6.283, 12.566, 1.0),
    )

    @property
    def home(self) -> np.ndarray:
        return np.array([0.0, 2.932153143, 2.373647784, 2.932153143, 2.373647784, 4.714624603])

    def sensor_pose(self, q: Value, theta: np.ndarray) -> tuple[Value, Value]:
        return kinematics.sensor_pose(self.values(theta), q)

    def tool_pose(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_world_tool (…, N, 3, 3) and the probe's position in the world (…, N, 3) [m]."""
        return kinematics.tool_pose(self.values(theta), q)

    def gravity_seen(self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray) -> np.ndarray:
        return kinematics.gravity_in_sensor(self.values(theta), q, gravity)

    def gravity_slopes(
        self, q: np.ndarray, theta: np.ndarray, gravity: np.ndarray, names: Sequence[str]
    ) -> np.ndarray:
        return gravity_slopes(self.values(theta), q, gravity, names)

    def tool(self, theta: np.ndarray) -> Tool:
        p = self.values(theta)
        mount = euler(p["alphaS"], p["betaS"], p["gammaS"])
        lever = stack_jets([p[f"{a}G"] - p[f"{a}S"] for a in "xyz"])
        cog = apply(np.swapaxes(mount, -1, -2), lever)
        return Tool(p["mTool"], cog, inertia_matrix(p), p["sensor.mass"])

    def links(self, q: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return bodies.links(self.values(theta), q)

    def base_origin(self, theta: np.ndarray) -> np.ndarray:
        return bodies.base_origin(self.values(theta))

    def theta_of_tool(self, theta: np.ndarray, mass: float, cog: Sequence[float]) -> np.ndarray:
        p = self.values(theta)
        mount = euler(p["alphaS"], p["betaS"], p["gammaS"])
        centre = np.array([p["xS"], p["yS"], p["zS"]]) + mount @ np.asarray(cog, dtype=float)
        values = {"mTool": mass, "xG": centre[0], "yG": centre[1], "zG": centre[2]}
        return self.parameters.vector({k: float(v) for k, v in values.items()}, start=theta)

    def infeasible(self, q: np.ndarray, theta: np.ndarray) -> dict[int, str]:
        return self._outside_limits(q) | kinematics.failures(self.values(theta), q)

    def sample(self, n: int, rng: np.random.Generator) -> np.ndarray:
        p = self.values(self.parameters.nominal)

        def draw(count: int) -> np.ndarray:
            return workspace.joints(p, *workspace.random_poses(count, rng))

        def good(q: np.ndarray) -> np.ndarray:
            ok = np.isfinite(q).all(axis=1)
            ok[np.flatnonzero(ok)[list(self.infeasible(q[ok], self.parameters.nominal))]] = False
            return ok

        return sample_until(n, draw, good)

    def pool(self, n: int, seed: int) -> np.ndarray:
        return workspace.pool(self, n, seed)

    def target(self) -> np.ndarray:
        return workspace.target(self)

    def goal_sets(self, pool: int, points: np.ndarray | None, seed: int) -> GoalSets:
        known = workspace.default_points() if points is None else points
        touch, which = workspace.touch_poses(self, known, seed)
        return GoalSets(
            workspace.pool(self, pool, seed), touch, known[which], workspace.target(self)
        )

    def qpos(self, q: Value, theta: np.ndarray) -> Value:
        return kinematics.qpos(self.values(theta), q)

    def spec(self, theta: np.ndarray) -> "mujoco.MjSpec":
        ref = self.qpos(self.home[None], theta)[0]
        return bodies.write(self.mjcf, self.values(theta), self.tool(theta), ref)

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
        base = euler(p["alpha0"], p["beta0"], p["gamma0"])
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
