"""What the wrench can tell: rank, named redundancies, and how arbitrary the elimination is."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from wrenchbed.observability import Observability, analyse, null_space
from wrenchbed.selection.criteria import observability_indices
from wrenchbed.selection.elimination import Elimination, eliminate
from wrenchbed.study.medrue import published
from wrenchbed.study.medrue.setting import Design, Setting
from wrenchbed.study.page import Figure, Section, Table
from wrenchbed.study.plots import lines

_UNITS = {
    "m": {"m": 1.0, "mm": 1e-3},
    "rad": {"rad": 1.0, "°": np.pi / 180},
    "kg": {"kg": 1.0, "g": 1e-3},
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Identifiable:
    """Rank and null directions of all 49, and the paper's elimination in many conventions."""

    observability: Observability
    ranks: dict[str, int]
    eliminations: dict[str, Elimination]


def examine(setting: Setting, chosen: np.ndarray, truth: np.ndarray) -> Identifiable:
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
    told = analyse(
        jacobian.reshape(-1, len(columns)),
        names,
        scale,
        setting.robot.symmetries(setting.theta[:own]),
    )
    units = [model.parameters[c].unit for c in columns]
    return Identifiable(told, ranks, _eliminations(jacobian, names, units))


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


def section(setting: Setting, found: Identifiable, designs: dict[str, Design]) -> Section:
    """Rank, redundancies, the elimination, and the choice of configurations."""
    told = found.observability
    same = [len(published.ELIMINATED & set(e.dropped)) for e in found.eliminations.values()]
    counted = Counter(n for e in found.eliminations.values() for n in e.dropped)
    ranks = Table.of(
        "Rank of the wrench's Jacobian by 49 parameters", ("parameters and data", "rank"),
        list(found.ranks.items()),
        f"{len(told.no_effect)} parameters without effect at nominal: {', '.join(told.no_effect)}.",
    )  # fmt: skip
    redundancies = Table.of(
        "What enters only together", ("redundancy", "parameters"),
        [(r.sentence, len(r.names)) for r in told.redundancies],
        f"49 − {len(told.no_effect)} − {len(told.redundancies)} = {told.rank}. The paper says 29 "
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
        "What the wrench can tell",
        "Rank and null space decide what can be identified; the tool names each null direction "
        "from the robot's symmetries where the data confirm them.",
        (ranks, redundancies, dropped, *_choice(setting, designs)),
    )


def _choice(setting: Setting, designs: dict[str, Design]) -> tuple[Table, Figure]:
    rows = []
    for d in designs.values():
        told = observability_indices(setting.in_table_units[d.chosen])
        value = told.get(d.name, d.value)
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
