"""Effect ``cable.pull``: a cable or hose pulls on the tool."""

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
    vector,
)
from wrenchbed.effects.scene import Scene
from wrenchbed.physics.model_parameters import Parameter
from wrenchbed.physics.rotations import apply, cross, sphere
from wrenchbed.physics.taylor_jets import value
from wrenchbed.robots.base import Robot

PULL, ANCHOR, POINT = (tuple(f"{stem}.{a}" for a in "xyz") for stem in ("pull", "anchor", "point"))
REACHES = (0.6, 1.3)
"""Distances of anchors from the middle of the recorded positions where a search begins [m]: within
an arm's reach, and at its column."""
SCANNED_REACHES, WAYS = (0.4, 0.8, 1.5, 2.5), 40
"""Distances [m] and number of directions of the anchors that a scan tries: steps of two, and of
30°, which a refit bridges."""
ROWS_AT_ONCE = 20_000
"""Rows of all anchors together that are scanned at once: what a processor's cache holds."""
SLACKS = (0.0, 0.25, 0.5, 0.75)
"""Shares of rows with a slack cable that a scan tries: quarters, which a refit bridges."""
_TURNS = np.array([
    [[0, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[0, 0, -1], [0, 0, 0], [1, 0, 0]],
    [[0, 1, 0], [-1, 0, 0], [0, 0, 0]],
])  # fmt: skip
"""Torque a of a force f held at p: Σ _TURNS[a, p, f] p f, the vector product."""


class CablePull(LoadEffect):
    """F = k (a − p)(1 − L/|a − p|)₊ + f₀: force at a point p of the tool, slack within length L.

    k is the stiffness, a the anchor. ``pull`` is f₀: with L = 0 the force is linear in k and
    f₀ = k a, whatever the anchor.

    Seen in: many positions, also at like orientations: the pull follows position. A run with the
    cable unplugged settles it.
    """

    name = "cable.pull"
    title = "a cable or hose pulls on the tool"
    rough = True
    size_error = 0.1
    zero_is_convention = True
    source = "0.2–3 N, estimate"
    numbers = (
        *alike(("stiffness",), "N/m", 2.0, 1e4, "of the cable"),
        *alike(PULL, "N", 1.0, 200.0, "at the base"),
        *alike(ANCHOR, "m", 0.5, 5.0, "in the world"),
        Parameter("length", 0.0, "m", 0.3, 0.0, 5.0, "at which it becomes taut"),
        *alike(POINT, "m", 0.03, 1.0, "where it holds, sensor axes"),
    )

    def variants(self, scene: Scene) -> tuple[Variant, ...]:
        if not scene.jointed:
            return ()
        free = ("stiffness", *PULL)
        held = dict(zip(POINT, map(float, scene.tool.cog), strict=True))
        taut = Variant("always taut", free, held, POINT, weight=4.0)
        shape = (*ANCHOR, "length")
        position = value(scene.pose[1])[scene.held]
        middle = position.mean(axis=0)
        slack = []
        for x, y, z in product((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0), (0.0, 1.0)):
            direction = np.array([x, y, z])
            if not direction.any():
                continue
            for reach, taut_share in product(REACHES, (0.3, 0.7)):
                anchor = middle + reach * direction / float(np.linalg.norm(direction))
                far = np.linalg.norm(position - anchor, axis=1)
                length = float(np.quantile(far, taut_share))
                at = dict(zip(shape, (*map(float, anchor), length), strict=True)) | held
                slack.append(Variant("slack in part", ("stiffness",), at, (*shape, *POINT)))
        return (taut, *slack)

    def scan(self, scene: Scene, residual: Residual) -> tuple[Variant, ...]:
        """Variants whose cable anchors, slack lengths and points p of attack explain a residual
        best: force u along the cable and torque p × u are linear in stiffness k and in k p."""
        if not scene.jointed:
            return ()
        rotation, origin = (value(x)[residual.rows] for x in scene.pose)
        holder = origin + apply(rotation, scene.tool.cog)
        middle = holder.mean(axis=0)
        candidates: list[tuple[float, np.ndarray, float, np.ndarray]] = []
        anchors = np.concatenate([middle + reach * sphere(WAYS) for reach in SCANNED_REACHES])
        for some in np.array_split(anchors, max(1, len(anchors) * len(holder) // ROWS_AT_ONCE)):
            line = some[:, None] - holder  # (anchors, R, 3)
            far = np.linalg.norm(line, axis=2)
            way = (line / far[:, :, None])[:, :, None] @ rotation
            lengths = np.quantile(far, SLACKS, axis=1)  # (slacks, anchors)
            stretched = np.maximum(far - lengths[:, :, None], 0.0)
            gain, point = _gains(way[:, :, 0] * stretched[..., None], residual)
            candidates += [
                (float(gain[k, a]), some[a], float(lengths[k, a]), point[k, a])
                for a in range(len(some))
                for k in range(len(SLACKS))
            ]
        candidates.sort(key=lambda t: -t[0])
        result: list[Variant] = []
        for _, anchor, length, point in candidates[:3]:
            held = np.clip(point, -0.3, 0.3)
            names = (*ANCHOR, "length", *POINT)
            at = dict(zip(names, map(float, (*anchor, length, *held)), strict=True))
            result.append(Variant("slack in part", ("stiffness",), at, names, {}, 0.1))
        return tuple(result)

    def pull(self, scene: Scene, pose: Pose, load: np.ndarray, p: Values) -> np.ndarray:
        rotation = np.swapaxes(value(pose.rotation), -1, -2)
        lever = vector(p, POINT)
        position = value(pose.position) + apply(value(pose.rotation), lever)
        to_anchor = vector(p, ANCHOR) - position
        far = np.maximum(np.linalg.norm(to_anchor, axis=-1, keepdims=True), 1e-9)
        pull = vector(p, PULL)
        force = pull + p["stiffness"] * to_anchor * np.maximum(0.0, 1.0 - p["length"] / far)
        local = apply(rotation, force)
        return np.concatenate([local, cross(np.broadcast_to(lever, local.shape), local)], axis=-1)

    def edit_spec(self, spec: MjSpec, robot: Robot, theta: np.ndarray, p: Values) -> None:
        """Add a tendon to the anchor, and one to a far point for the constant pull."""
        from wrenchbed.simulation.springs import cable, pull

        point = tuple(p[n] for n in POINT)
        anchor = [p[n] for n in ANCHOR]
        if p["stiffness"]:
            cable(spec, self.name, point, anchor, p["stiffness"], p["length"])
        pull(spec, self.name, point, vector(p, PULL))


def _gains(pulls: np.ndarray, residual: Residual) -> tuple[np.ndarray, np.ndarray]:
    """Squared residual (…), over noise, that cable pulls explain, and each one's best point on the
    tool (…, 3) [m]; ``pulls``: force (…, R, 3) per stiffness, whose mean over rows is subtracted.
    """
    away = pulls - pulls.mean(axis=-2, keepdims=True)
    square = np.swapaxes(away, -1, -2) @ away  # (…, 3, 3)
    along = np.swapaxes(away, -1, -2) @ (residual.value / residual.noise)  # (…, 3, 6)
    weight = 1.0 / residual.noise**2
    normal = np.zeros((*pulls.shape[:-2], 4, 4))
    score = np.zeros((*pulls.shape[:-2], 4))
    normal[..., 0, 0] = np.einsum("...aa,a->...", square, weight[:3])
    both = np.einsum("apf,aqg,a->fgpq", _TURNS, _TURNS, weight[3:])
    normal[..., 1:, 1:] = np.tensordot(square, both, 2)
    score[..., 0] = np.einsum("...aa->...", along[..., :3])
    score[..., 1:] = np.tensordot(along[..., 3:], _TURNS.transpose(2, 0, 1), 2)
    ridge = 1e-9 * np.einsum("...ii->...", normal)
    size = np.linalg.solve(normal + ridge[..., None, None] * np.eye(4), score[..., None])[..., 0]
    gain = np.where(size[..., 0] > 0, (score * size).sum(axis=-1), 0.0)
    return gain, size[..., 1:] / (size[..., :1] + 1e-12)


EFFECT = CablePull()
