"""Effect ``joint.clearance``: passive joints have clearance."""

from functools import lru_cache

import numpy as np

from wrenchbed.effects.base import JointEffect, MjSpec, Pose, Published, Values, Variant, has_loops
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter, ParameterSet
from wrenchbed.physics.rotations import apply, euler, exp
from wrenchbed.physics.taylor_jets import STEP
from wrenchbed.physics.wrench import wrench
from wrenchbed.robots.base import Robot
from wrenchbed.robots.medrue.kinematics import five_bar

SEAT = 0.5
"""Force in a distal link at which it leaves the middle of its clearance [N]: the weight of 50 g."""
DISTAL = ("L12", "L14", "L22", "L24")
"""Names of the lengths of the distal links, which carry the five-bar linkages' tips."""
MOMENT = 0.05
"""Moment on a serial arm's last bearing at which it leaves the middle of its clearance [N·m]: the
force `SEAT` at 0.1 m."""


class JointClearance(JointEffect):
    """Five-bar i: tip E moves by δE. A serial arm: its last bearing tilts.

    ``play.i`` lets the universal joint at E sag along gravity, no link turns: δE = p ĝ in the
    five-bar's plane. ``slack.Li2`` and ``slack.Li4`` lengthen a distal link under tension and
    shorten it under pressure, e·δE = s tanh(N/N₀) for both links' directions e; N is the push of
    all weights along the link, by virtual work. Both are given as what the joints would have to
    turn, J δq = δE, and q6 as much as the wrist's roll then differs. N₀ and M₀ are small. ``tilt``:
    R → R Exp(t M/√(M² + M₀²)), M the moment of the tool's load across the sensor's z.

    Seen in: poses between which the force in a link changes its sign.
    """

    name = "joint.clearance"
    title = "passive joints have clearance"
    size_error = 0.15
    source = "10–50 µm: estimate"
    amplitude = "play"
    also_at = ("pose",)

    def parameters(self, robot: Robot) -> ParameterSet:
        if not has_loops(robot):
            text = "half clearance of the last bearing"
            return ParameterSet((Parameter("tilt", 0.0, "rad", 2e-4, -0.1, 0.1, text),))
        texts = {f"play.{i}": "of the universal joint at a tip" for i in (1, 2)}
        texts |= {f"slack.{link}": "half clearance of a distal link" for link in DISTAL}
        return ParameterSet(
            tuple(Parameter(n, 0.0, "m", 3e-5, -0.01, 0.01, text) for n, text in texts.items())
        )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed:
            return ()
        if not has_loops(scene.robot):
            return (Variant("last bearing", ("tilt",)),)
        every = tuple(f"slack.{link}" for link in DISTAL)
        single = [Variant(f"link {link}", (f"slack.{link}",)) for link in DISTAL]
        pairs = [Variant(f"links of five-bar {i}", every[2 * i - 2 : 2 * i]) for i in (1, 2)]
        # tip 2 shows as tip 1 does, with the other sign: see `publish`
        tips = Variant("tips", ("play.1",))
        return (tips, *single, *pairs, Variant("links of both five-bars", every))

    def displace(self, scene: Scene, p: Values) -> np.ndarray:
        dq = np.zeros_like(scene.joints)
        if not has_loops(scene.robot):
            return dq
        theta = scene.robot.values(scene.theta)
        base = euler(theta["alpha0"], theta["beta0"], theta["gamma0"])
        down = (base.T @ scene.gravity)[1:]
        down = down / np.linalg.norm(down)
        for i in (1, 2):
            first, second = scene.joints[:, 2 * i - 1], scene.joints[:, 2 * i]
            bar = five_bar(theta, i, first, second)
            near, far = bar.E - bar.B, bar.E - bar.D
            links = np.stack([near, far], axis=-2)
            links = links / np.linalg.norm(links, axis=-1, keepdims=True)  # rows: directions
            slack = _moved(scene, links, {f"L{i}{k}": p[f"slack.L{i}{k}"] for k in (2, 4)})
            by = [
                five_bar(theta, i, first + 1j * STEP, second),
                five_bar(theta, i, first, second + 1j * STEP),
            ]
            turned = apply(np.linalg.inv(_rates([b.E for b in by])), slack + p[f"play.{i}"] * down)
            dq[:, 2 * i - 1 : 2 * i + 1] = turned
            if i == 1:  # this five-bar's second distal link carries the wrist's roll
                across = np.stack([-links[:, 1, 1], links[:, 1, 0]], axis=-1)
                with_joints = apply(_rates([b.E - b.D for b in by]), turned)
                dq[:, 5] = (across * (slack - with_joints)).sum(axis=-1) / theta["L14"]
        return dq

    def pose(self, scene: Scene, pose: Pose, p: Values) -> Pose:
        if has_loops(scene.robot):
            return pose
        moment = wrench(pose.rotation, pose.position, scene.tool, scene.gravity)[:, 3:5]
        size = np.sqrt((moment**2).sum(axis=1, keepdims=True) + MOMENT**2)
        turn = scene.in_motion(p["tilt"] * moment / size)
        tilt = exp(turn[..., 0], turn[..., 1], 0.0 * turn[..., 0])
        return Pose(pose.rotation @ tilt, pose.position)

    def publish(self, robot: Robot, variant: Variant, values: Values, std: Values) -> Published:
        """Parameters to publish, by name; a negative ``play.1`` becomes a positive ``play.2``."""
        result = super().publish(robot, variant, values, std)
        if "play.1" in result and result["play.1"]["value"] < 0.0:
            play = result.pop("play.1")
            return {"play.2": play | {"value": -play["value"]}} | result
        return result

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Add the last bearing's round clearance; clearance in loops acts through joint values."""
        from wrenchbed.simulation.springs import ROUND, Spring, hinge

        half = p.get("tilt", 0.0)
        if half:
            for axis, way in zip("xy", np.eye(3), strict=False):
                part, spring = f"tilt.{axis}{ROUND}", Spring(MOMENT / half, abs(half))
                hinge(self.name, part, spec.body("tool"), [*map(float, way)], spring)


def _moved(scene: Scene, links: np.ndarray, slack: Values) -> np.ndarray:
    """Shift δE (M, 2) [m] of a five-bar's tip by clearances ``slack`` [m], by name, of ``links``
    (M, 2, 2), whose rows are unit vectors along them."""
    longer = np.zeros(links.shape[:2])
    for k, (name, half) in enumerate(slack.items()):
        if half:
            longer[:, k] = half * np.tanh(_push(scene, name) / SEAT)
    return np.asarray(np.linalg.solve(links, longer[..., None])[..., 0])


@lru_cache(maxsize=16)
def _push(scene: Scene, link: str) -> np.ndarray:
    """Axial force (M,) [N] along a link by the weight of everything, positive in tension."""
    length = scene.robot.parameters.index(link)
    return scene.robot.push_along(scene.q, scene.theta, scene.gravity, length)


def _rates(points: list[np.ndarray]) -> np.ndarray:
    """A point's planar velocity per joint speed (M, 2, 2), from ``points`` with complex steps."""
    return np.stack([p.imag / STEP for p in points], axis=-1)


EFFECT = JointClearance()
