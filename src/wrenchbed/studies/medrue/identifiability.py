"""What the wrench identifies: rank, named redundancies, and how arbitrary the elimination is.

Then measurements beyond the tool's weight. Each is a Jacobian by all 49 parameters in standard
deviations; its own unknowns (the pose of a plane, the place of a fixed point) are projected out.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.accuracy import tip_jacobian
from wrenchbed.calibration.observability import Observability, analyse, null_space
from wrenchbed.data.recording import TOUCH_STD
from wrenchbed.pages.document import Figure, Section, Table
from wrenchbed.pages.plots import lines
from wrenchbed.physics.rotations import cross
from wrenchbed.planning.criteria import observability_indices
from wrenchbed.planning.exchange import Elimination, eliminate
from wrenchbed.robots.medrue import workspace
from wrenchbed.robots.medrue.robot import MedRUE
from wrenchbed.studies.medrue import setting as published
from wrenchbed.studies.medrue.setting import PoseDesign, StudySetting

_UNITS = {
    "m": {"m": 1.0, "mm": 1e-3},
    "rad": {"rad": 1.0, "°": np.pi / 180},
    "kg": {"kg": 1.0, "g": 1e-3},
}  # fmt: skip
TOUCHES = 40
_STEP = 1e-30
_CENTRE = np.array([0.4, 0.44, -0.18])
_PULL = (20.0, 0.0, 0.0)
"""Known force at the tip [N]."""
_SQUARE = 0.1 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
"""Corners of the artefact [m]."""


@dataclass(frozen=True, eq=False)
class Identifiable:
    """Rank and null directions of all 49, and the paper's elimination in many conventions."""

    observability: Observability
    ranks: dict[str, int]
    eliminations: dict[str, Elimination]


def examine(setting: StudySetting, chosen: np.ndarray, truth: np.ndarray) -> Identifiable:
    """Rank at nominal and actual parameters from 100 configurations to the whole pool."""
    model = setting.model
    columns = model.parameters.select(setting.robot.candidates)
    names = [model.parameters.names[c] for c in columns]
    scale = model.parameters.tolerance[list(columns)]
    own = len(setting.robot.parameters)
    ranks = {}
    jacobian = np.zeros((0, 6, len(columns)))
    for label, theta in (("nominal", setting.theta), ("Table 1's robot", truth)):
        for n in sorted({100, 1000, len(setting.q)}):
            rows = chosen if n == 100 else np.linspace(0, len(setting.q) - 1, n).astype(int)
            each = model.jacobian(setting.q[rows], theta, columns)
            flat = (each * scale).reshape(-1, len(columns))
            norm = np.linalg.norm(flat, axis=0)
            active = norm > 1e-13 * norm.max()
            ranks[f"{label}, {n:,} configurations"] = null_space(flat[:, active])[0]
            if label == "nominal" and n == 100:
                jacobian = each
    flat = jacobian.reshape(-1, len(columns))
    observability = analyse(flat, names, scale, setting.robot.symmetries(setting.theta[:own]))
    units = [model.parameters[c].unit for c in columns]
    return Identifiable(observability, ranks, _eliminations(jacobian, names, units))


def _eliminations(
    jacobian: np.ndarray, names: list[str], units: list[str]
) -> dict[str, Elimination]:
    """32 conventions: units of length, angle, mass and torque, columns scaled or not."""
    result = {}
    for length, a in _UNITS["m"].items():
        for angle, b in _UNITS["rad"].items():
            for mass, c in _UNITS["kg"].items():
                factor = np.array([{"m": a, "rad": b, "kg": c}[u] for u in units])
                for torque, d in (("N·m", 1.0), ("N·mm", 1e3)):
                    rows = np.array([1.0, 1.0, 1.0, d, d, d])[:, None]
                    flat = (jacobian * factor * rows).reshape(-1, len(names))
                    norm = np.linalg.norm(flat, axis=0)
                    scaled = flat / np.where(norm > 1e-13 * norm.max(), norm, 1.0)
                    name = f"{length}, {angle}, {mass}, {torque}"
                    result[name] = eliminate(flat, names)
                    result[f"{name}, unit columns"] = eliminate(scaled, names)
    return result


def section(
    setting: StudySetting, identifiable: Identifiable, designs: dict[str, PoseDesign]
) -> Section:
    """Rank, redundancies, the elimination, and the choice of configurations."""
    observed = identifiable.observability
    silent = observed.no_effect
    same = [len(published.ELIMINATED & set(e.dropped)) for e in identifiable.eliminations.values()]
    counted = Counter(n for e in identifiable.eliminations.values() for n in e.dropped)
    ranks = Table.of(
        "Rank of the wrench's Jacobian by 49 parameters", ("parameters and data", "rank"),
        list(identifiable.ranks.items()),
        f"{len(silent)} parameters without effect at nominal: {', '.join(silent)}.",
    )  # fmt: skip
    redundancies = Table.of(
        "What enters only together", ("redundancy", "parameters"),
        [(r.sentence, len(r.names)) for r in observed.redundancies],
        f"49 − {len(silent)} − {len(observed.redundancies)} = {observed.rank}. The paper says 29 "
        "identifiable, prints 29 without a star, and freezes two of these.",
    )  # fmt: skip
    dropped = Table.of(
        "Dropped by the paper's elimination, in how many of 32 conventions of units",
        ("parameter", "dropped in", "paper dropped it"),
        [(n, k, "yes" if n in published.ELIMINATED else "") for n, k in counted.most_common()],
        f"The paper's 8 choices: {min(same)} to {max(same)} of them come out, whichever units one "
        "takes. As long as the Jacobian is rank-deficient its condition number is rounding error.",
    )  # fmt: skip
    return Section(
        "What the wrench can determine",
        "Rank and null space decide what can be identified; the tool names each null direction "
        "from the robot's symmetries where the data confirm them.",
        (ranks, redundancies, dropped, *_choice(setting, designs)),
    )


def _choice(setting: StudySetting, designs: dict[str, PoseDesign]) -> tuple[Table, Figure]:
    rows = []
    for d in designs.values():
        indices = observability_indices(setting.in_table_units[d.chosen])
        value = indices.get(d.name, d.value)
        if d.certificate is not None:
            share = d.value / d.certificate.bound
            rows.append((d.name, value, value / share, 100 * share))
        elif np.isfinite(d.value):
            rows.append((d.name, value, np.nan, np.nan))
    table = Table.of(
        "100 configurations chosen by exchange",
        ("criterion", "value", "no choice exceeds", "certified [%]"),
        rows,
        "In the paper's units (mm, °, kg; N, N·m); target: 1/m², ±1 N as 3σ. The bound is that of "
        "the best continuous design with no configuration used twice. O2 and O4 are not concave "
        "and O3 is not smooth: no useful bound.",
    )
    root = np.sqrt(len(designs["O1"].chosen))
    course = [h / root for h in designs["O1"].history]
    figure = Figure(
        "figure4", "Figure 4: O1 while configurations are exchanged",
        lines({"O1": (range(len(course)), course)}, "accepted exchange", "O1"),
    )  # fmt: skip
    return table, figure


@dataclass(frozen=True, eq=False)
class Added:
    """A kind of measurement: its name, how many, and their whitened Jacobian (M, 49)."""

    name: str
    count: int
    jacobian: np.ndarray


def kinds(setting: StudySetting, chosen: np.ndarray, std: np.ndarray, seed: int) -> list[Added]:
    """Gravity alone, then each addition to it.

    Args:
        chosen: configurations under gravity.
        std: of a configuration's mean wrench (6,).
    """
    robot, theta = setting.robot, setting.theta
    columns = setting.model.parameters.select(robot.candidates)
    q = setting.q[chosen]
    gravity = setting.model.jacobian(q, theta, columns) / std[:, None]

    def load(force: Sequence[float]) -> np.ndarray:
        """Readings with the tool's weight and a known force (3,) [N] at its tip."""
        return gravity + _load(robot, q, theta, columns, np.asarray(force)) / std[:, None]

    def touch(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        each = -(-3 * TOUCHES // len(points))
        joints, which = workspace.touch_poses(robot, points, seed, each)
        pick = np.random.default_rng(seed).permutation(len(joints))[:TOUCHES]
        return tip_jacobian(robot, joints[pick], theta, columns) / TOUCH_STD, points[which[pick]]

    def free(touches: np.ndarray, unknown: np.ndarray) -> np.ndarray:
        """Touches (T, r, 49) with their own unknowns (T, r, U) projected out."""
        flat = touches.reshape(-1, len(columns))
        basis, _ = np.linalg.qr(unknown.reshape(len(flat), -1))
        return flat - basis @ (basis.T @ flat)

    fixed, _ = touch(_CENTRE[None])
    on_plane, spots = touch(_CENTRE + _level_grid())
    square, corners = touch(_CENTRE + _SQUARE)
    known, _ = touch(workspace.default_points())
    same = np.tile(np.eye(3), (TOUCHES, 1, 1))
    n = len(chosen)
    everything = [
        ("gravity", n, [gravity]),
        ("+ 2 kg hung from the tip", n, [load((0.0, 0.0, -2.0 * 9.81))]),
        ("+ 20 N pull along x at the tip", n, [load(_PULL)]),
        ("+ one unknown fixed point", TOUCHES, [free(fixed, same)]),
        ("+ an unknown plane", TOUCHES, [free(on_plane[:, 2:], _plane(spots))]),
        ("+ corners of a known square, anywhere", TOUCHES, [free(square, _rigid(corners))]),
        ("+ that pull and a fixed point", n + TOUCHES, [load(_PULL), free(fixed, same)]),
        ("+ known points of the world", TOUCHES, [known]),
    ]
    return [
        Added(name, k, np.concatenate([r.reshape(-1, len(columns)) for r in rows]))
        for name, k, rows in everything
    ]


def _load(
    robot: MedRUE, q: np.ndarray, theta: np.ndarray, columns: Sequence[int], force: np.ndarray
) -> np.ndarray:
    """Derivative (N, 6, K) of the wrench that a known force (3,) [N] at the tip adds."""
    own = len(robot.parameters)
    result = np.empty((len(q), 6, len(columns)))
    for k, c in enumerate(columns):
        shifted = theta[:own].astype(complex)
        shifted[c] += 1j * _STEP
        rotation, _ = robot.sensor_pose(q, shifted)
        p = robot.values(shifted)
        f = np.swapaxes(rotation, -1, -2) @ force
        lever = np.broadcast_to(np.array([p["xT"], p["yT"], p["zT"]]), f.shape)
        result[:, :, k] = np.concatenate([f, cross(lever, f)], axis=-1).imag / _STEP
    return result


def _plane(points: np.ndarray) -> np.ndarray:
    """Height and two slopes of a nearly level plane (T, 1, 3)."""
    return np.stack([points[:, 0], points[:, 1], np.ones(len(points))], axis=-1)[:, None]


def _rigid(points: np.ndarray) -> np.ndarray:
    """Derivatives of points (T, 3, 6) by an artefact's position and rotation."""
    arm = points - _CENTRE
    turn = np.stack([cross(np.broadcast_to(e, arm.shape), arm) for e in np.eye(3)], axis=-1)
    return np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), turn], axis=-1)


def _level_grid() -> np.ndarray:
    x, y = np.meshgrid(np.linspace(-0.15, 0.15, 5), np.linspace(-0.15, 0.15, 5))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)


def in_reach(added: list[Added], prior: np.ndarray) -> list[tuple[Added, int, np.ndarray]]:
    """Rank (of 49) and posterior covariance (49, 49) for gravity and each addition to it.

    Args:
        prior: standard deviation (49,) of each parameter before any measurement.
    """
    gravity = added[0].jacobian
    rows = []
    for kind in added:
        both = gravity if kind is added[0] else np.concatenate([gravity, kind.jacobian])
        scaled = both * prior
        norm = np.linalg.norm(scaled, axis=0)
        unit = scaled / np.where(norm > 1e-13 * norm.max(), norm, np.inf)
        covariance = np.linalg.inv(np.eye(len(prior)) + scaled.T @ scaled) * np.outer(prior, prior)
        rows.append((kind, null_space(unit)[0], covariance))
    return rows
