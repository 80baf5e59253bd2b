"""Effect ``tool.loose``: a part of the tool is loose and falls to one side or the other."""

from itertools import product

import numpy as np

from wrenchbed.effects.base import (
    LoadEffect,
    MjSpec,
    Pose,
    Residual,
    Sizes,
    Values,
    Variant,
    alike,
    direction,
    sides,
)
from wrenchbed.effects.drives.operators import stop
from wrenchbed.effects.scene import Scene, held_on
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.rotations import cross, sphere
from wrenchbed.physics.wrench import wrench
from wrenchbed.robots.base import Robot

WAY = ("way.x", "way.y", "way.z")
SHAPE = (*WAY, "lean", "grip")
SOFT = 0.05
"""Share of the load along the way at which the part leaves the middle: small, so that it nearly
jumps."""
GRIP = 0.3
"""Share of the load along the way below which a part that sticks stays where it was: a friction of
0.3."""
SLIDE_S = 0.02
"""Time of half a part's way in motion where a fit begins [s]: 1 cm against 5 N·s/m of 1 kg."""
WAYS = 200
"""Ways over a half sphere that a scan tries: 10° apart, which a refit bridges."""
GRIPS, LEANS = (0.0, 0.08, 0.16, 0.24, 0.32), (-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6)
"""Grips and leans that a scan tries: frictions up to 0.3, and springs or slopes up to half the
weight, in steps that a refit bridges."""


class ToolLoose(LoadEffect):
    """c → c + s n sgn(n·F/|F| − l): the tool's CoG jumps by 2 s along a direction n; torque δc × F.

    The sign is tanh(…/0.05), l leans to one side; with a ``grip`` it turns only once n·F/|F| is
    that far beyond l. In motion viscous drag may hold it up: ``slide`` is the time of half its way
    under its weight. What flows along the load has no torque; along one axis it is tool.flexure.

    Seen in: orientations that tip the tool to either side, and back.
    """

    name = "tool.loose"
    title = "a part of the tool is loose and falls to one side or the other"
    rough = True
    form_error = 0.2
    size_error = 0.1
    source = "CoG jumps of 0.5–5 mm: estimate"
    numbers = (
        *alike(("shift",), "m", 1e-3, 1.0, "half the jump of the tool's CoG"),
        *alike(WAY[:2], "1", 0.1, 2.0, "of the jump"),
        Parameter(WAY[2], 1.0, "1", 0.1, -2.0, 2.0, "of the jump"),
        *alike(("lean",), "1", 0.05, 0.9, "share of the load at which it jumps"),
        Parameter("grip", 0.0, "1", 0.1, 0.0, 0.9, "share of the load that moves it"),
        Parameter("slide", 0.0, "s", 0.01, 0.0, 1.0, "time of half its way under its weight"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        result, drag = [], {"slide": SLIDE_S} if scene.moving else {}
        for way in product((-1.0, 0.0, 1.0), repeat=3):
            if way > (0.0, 0.0, 0.0):  # one of each two opposite ways
                along = np.array(way) / np.linalg.norm(way)
                at = dict(zip(WAY, map(float, along), strict=True)) | {"lean": 0.0} | drag
                for grip, text, shape in ((0.0, "falls", SHAPE[:-1]), (GRIP, "sticks", SHAPE)):
                    label, shape = f"{text} along {sides(along)}", (*shape, *drag)
                    result.append(Variant(label, ("shift",), at | {"grip": grip}, shape))
        return tuple(result)

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Variants whose directions, grips, leans fit a residual's torques best: a jump s = ±1 by
        a lever δ adds the torque s δ × F, linear in δ, so that sums of s Fᵀ × T suffice."""
        force = scene.tool_force(wrench(*scene.pose, scene.tool, scene.gravity))
        towards = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
        fitted = force[residual.rows]
        levers = np.stack(
            [cross(np.broadcast_to(e, fitted.shape), fitted) for e in np.eye(3)], axis=2
        )
        levers = levers / residual.noise[3:, None]  # (R, 3 torques, 3 levers)
        moment = np.einsum("rti,rt->ri", levers, residual.value[:, 3:])
        normal = np.einsum("rti,rtj->ij", levers, levers) + 1e-9 * np.eye(3)
        ways = sphere(2 * WAYS)[:WAYS]
        along = towards @ ways.T  # (M, ways)
        candidates = []
        for grip in GRIPS:
            for lean in LEANS:
                away = along - lean
                to, fro = (away > grip).view(np.int8), (away < -grip).view(np.int8)
                side = held_on(to - fro)
                at = side[residual.rows]
                at = at - at.mean(axis=0)
                score = at.T @ moment  # (ways, 3)
                lever = np.linalg.solve(normal, score.T).T
                gain = (score * ways).sum(axis=1) * np.abs((lever * ways).sum(axis=1))
                candidates += [
                    (abs(float(gain[k])), k, grip, lean) for k in np.argsort(-abs(gain))[:2]
                ]
        candidates.sort(reverse=True)
        result, drag = list[Variant](), {"slide": SLIDE_S} if scene.moving else {}
        for _, k, grip, lean in candidates[:4]:
            begin = dict(zip(WAY, map(float, ways[k]), strict=True)) | {"lean": lean, "grip": grip}
            text = f"{'sticks' if grip else 'falls'} along {sides(ways[k])}"
            shape = (*(SHAPE if grip else SHAPE[:-1]), *drag)
            result.append(Variant(text, ("shift",), begin | drag, shape, {}, 0.05))
        return tuple(result)

    def size(self, scene: Scene, variant: Variant, p: Values) -> Sizes:
        return {"jump": (2.0 * abs(p["shift"]), "m")}

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        force = scene.tool_force(load)
        towards = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
        way = direction(p, WAY)
        lever = p["shift"] * _side(towards @ way - p["lean"], scene.t, p)[:, None] * way
        return np.concatenate([np.zeros_like(force), cross(lever, force)], axis=1)

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Let the tool's mass slide between stops, with friction and a bias, but no drag."""
        from wrenchbed.simulation.springs import Spring, slide

        weight = float(robot.tool(theta).mass) * float(np.linalg.norm(spec.option.gravity))
        half = p["shift"]
        if half and not p["slide"]:
            way, soft = [*map(float, direction(p, WAY))], SOFT * weight / half
            friction, bias = p["grip"] * weight, -p["lean"] * weight
            spring = Spring(soft, abs(half), friction=friction, bias=bias)
            slide(spec, self.name, "shift", way, spring)


def _side(along: np.ndarray, t: np.ndarray, p: Values) -> np.ndarray:
    """Position (M,), −1 … 1, of a part at times t (M,) [s]; ``along``: load along its path."""
    grip, slide = p["grip"], p["slide"]
    if slide:
        beyond = along - np.clip(along, -grip, grip)
        steps = np.concatenate([[0.0, 2.0 * np.sign(beyond[0])], beyond[:-1] * np.diff(t) / slide])
        return stop(np.cumsum(steps), 1.0)[1:]
    if not grip:
        return np.tanh(along / SOFT)
    return held_on(np.where(np.abs(along) > grip, np.sign(along), 0.0)[:, None])[:, 0]


EFFECT = ToolLoose()
