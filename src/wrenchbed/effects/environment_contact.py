"""Effect ``environment.contact``: the tool's tip touches something."""

from itertools import product

import numpy as np

from wrenchbed.effects.base import (
    LoadEffect,
    MjSpec,
    Pose,
    Residual,
    Values,
    Variant,
    alike,
    direction,
    sides,
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.rotations import apply, cross, sphere
from wrenchbed.physics.taylor_jets import value
from wrenchbed.robots.base import Robot

LENGTH = 0.01
"""Reference depth [m] of the law of contact, by definition."""
SHARES = (0.05, 0.15, 0.35)
"""Shares of rows in contact where a search begins: it bridges steps of two to three."""
NORMAL = ("normal.x", "normal.y", "normal.z")
SLIDE = ("slide.x", "slide.y", "slide.z")
WAYS = 400
"""Number of normals over a sphere that a scan tries: 10° apart."""
DEPTHS = (0.04, 0.08, 0.12, 0.18, 0.25, 0.35)
"""Shares of rows in contact that a scan tries: steps of 1.5, which a refit bridges."""
ASIDE = ("aside.x", "aside.y", "aside.z")
SHAPE = ("depth", *NORMAL, *SLIDE, *ASIDE, "power", "reach")
PLAIN = dict.fromkeys((*SLIDE, *ASIDE), 0.0) | {"power": 1.0, "reach": 1.0}
"""A spring that pushes the tip itself, without drag."""


class EnvironmentContact(LoadEffect):
    """F = k l (x/l)₊ᵐ (n + s), x = d − n·p, at the tip p: the plane n·p = d pushes back.

    k is the stiffness, l = 1 cm, the ``power`` m = 1 of a spring, 3/2 of a ball on a half space
    (Hertz); n is the normal; s drags along the plane, always the same way.

    The tip is that of the robot's model, else twice as far from the sensor as the CoG; what touches
    may lie nearer, farther (``reach``) or ``aside``.

    Seen in: poses inside and outside the region that is touched; it acts on one side only.
    """

    name = "environment.contact"
    title = "the tool's tip touches something"
    rough = True
    form_error = 0.2
    size_error = 0.15
    zero_is_convention = True
    source = "skin, gel and foam 100–2000 N/m: estimate"
    numbers = (
        *alike(("stiffness",), "N/m", 500.0, 1e6, "of what is touched"),
        Parameter("reach", 1.0, "1", 0.2, 0.1, 5.0, "of what touches, over the tip's"),
        Parameter("power", 1.0, "1", 0.2, 0.3, 4.0, "of the depth"),
        *alike(("depth",), "m", 0.02, 10.0, "of the plane: n·p = d"),
        *alike(NORMAL[:2], "1", 0.1, 2.0, "out of the plane, world"),
        Parameter(NORMAL[2], 1.0, "1", 0.1, -2.0, 2.0, "out of the plane, world"),
        *alike(SLIDE, "1", 0.1, 2.0, "drag over push, world"),
        *alike(ASIDE, "m", 0.01, 1.0, "of what touches, from there"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed:
            return ()
        rotation, position = scene.pose
        at = (value(position) + apply(value(rotation), scene.tip))[scene.held]
        result = []
        for way in (w for w in product((-1.0, 0.0, 1.0), repeat=3) if any(w)):
            normal = np.array(way) / np.linalg.norm(way)
            for share in SHARES:
                depth = float(np.quantile(at @ normal, share))
                begin = dict(zip(NORMAL, map(float, normal), strict=True)) | {"depth": depth}
                begin |= PLAIN
                result.append(_from(normal, begin, 1.0))
        return tuple(result)

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Variants with planes that explain a residual best by their depth, as a force along n."""
        if not scene.jointed:
            return ()
        rotation, position = (value(x)[residual.rows] for x in scene.pose)
        lever = scene.tip
        at = position + apply(rotation, lever)
        force = np.swapaxes(rotation, 1, 2)  # of a unit push along each world axis
        arm = np.broadcast_to(lever, at.shape)
        torque = np.stack([cross(arm, force[:, :, i]) for i in range(3)], axis=2)
        columns = np.concatenate([force, torque], axis=1) / residual.noise[:, None]
        moment = np.einsum("rci,rc->ri", columns, residual.value)
        each = np.einsum("rci,rcj->rij", columns, columns).reshape(-1, 9)
        ways = sphere(WAYS)
        height = at @ ways.T
        candidates: list[tuple[float, int, float, np.ndarray]] = []
        for share in DEPTHS:
            depth = np.quantile(height, share, axis=0)
            x = np.maximum(depth - height, 0.0)  # (R, ways)
            score = x.T @ moment
            normal = (x.T**2 @ each).reshape(-1, 3, 3) + 1e-12 * np.eye(3)
            push = np.linalg.solve(normal, score[:, :, None])[:, :, 0]
            gain = np.where((push * ways).sum(axis=1) > 0, (score * push).sum(axis=1), 0.0)
            candidates += [
                (float(gain[k]), k, float(depth[k]), push[k]) for k in np.argsort(-gain)[:2]
            ]
        candidates.sort(key=lambda t: -t[0])
        result: list[Variant] = []
        for _, k, depth, push in candidates[:3]:
            n = ways[k]
            drag = np.clip(push / float(push @ n) - n, -1.0, 1.0)
            begin = dict(zip((*NORMAL, *SLIDE), map(float, [*n, *drag]), strict=True))
            begin = PLAIN | begin | {"depth": depth}
            result.append(_from(n, begin, 0.1))
        return tuple(result)

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        rotation, lever = value(pose.rotation), touching(scene, p)
        push = p["stiffness"] * pressed(_depth(scene, pose, p), p["power"])
        way = direction(p, NORMAL) + vector(p, SLIDE)
        force = push[:, None] * (np.swapaxes(rotation, -1, -2) @ way)
        return np.concatenate([force, cross(np.broadcast_to(lever, force.shape), force)], axis=1)

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Add a plane that pushes the tip as a linear spring; other laws, drag stay closed form."""
        from wrenchbed.simulation.springs import plane

        if p["stiffness"] and p["power"] == 1.0 and not any(p[n] for n in SLIDE):
            q = robot.sample(1, np.random.default_rng(0))
            still = Scene(robot, theta, np.zeros(3), q, np.zeros(1), np.ones(1, dtype=bool))
            normal = direction(p, NORMAL)
            point = [float(x) for x in touching(still, p)]
            plane(spec, self.name, point, normal, p["depth"], p["stiffness"])


def _from(normal: np.ndarray, begin: Values, weight: float) -> Variant:
    """Variant of a contact plane with a normal (3,), other shape values ``begin``, and a weight."""
    side = sides(normal)
    return Variant(f"from {side}", ("stiffness",), begin, SHAPE, {"side": side}, weight)


def _depth(scene: Scene, pose: Pose, p: Values) -> np.ndarray:
    """Depth (M,) [m] of the contact point behind the plane of values p; negative before it."""
    at = value(pose.position) + apply(value(pose.rotation), touching(scene, p))
    return np.asarray(p["depth"] - at @ direction(p, NORMAL))


def pressed(x: np.ndarray, power: float) -> np.ndarray:
    """Compression l (x/l)₊ᵐ [m] at depths x (M,) [m], with l = 1 cm, and m the exponent
    ``power``."""
    return np.asarray(LENGTH * (np.maximum(0.0, x) / LENGTH) ** power)


def touching(scene: Scene, p: Values) -> np.ndarray:
    """Contact point of the tool in sensor axes (3,) [m]."""
    return p["reach"] * scene.tip + vector(p, ASIDE)


EFFECT = EnvironmentContact()
