"""Figures of joint efforts: measured and predicted, their residual, and each joint's friction."""

import numpy as np

from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.pages.chart import Axis, Chart, Kind, Panel, Role, Series, thinned

_SHOWN_S = 15.0
"""Time of a motion that is shown [s]: several reversals of each joint are in view."""
_PREDICTED: tuple[tuple[str, str, Role], ...] = (
    ("calibrated", "calibrated", "before"), ("with_effects", "with the effects", "after"),
)  # fmt: skip
_BINS = 24
"""Of speed, in which friction is averaged."""
_FRICTION: tuple[tuple[str, Kind, Role], ...] = (
    ("measured", "points", "measured"), ("stated", "line", "before"),
    ("with the effects", "line", "after"),
)  # fmt: skip


def charts(findings: EffortFindings) -> list[Chart]:
    """Efforts over time, then the friction of the joints that matter most."""
    return [_efforts(findings), *(_friction(findings, j) for j in _joints(findings))]


def _joints(findings: EffortFindings) -> list[int]:
    """Joints whose friction is shown, from 0: named ones, else the one with the largest gap."""
    keys = (cause.part.key for cause in findings.verdict.causes)
    named = [j - 1 for name, j in keys if j is not None and name.startswith("drive.")]
    if named or findings.diagnosis.verdict == "none":
        return list(dict.fromkeys(named))[:2]
    gaps = [v["before"] for v in findings.diagnosis.gap.per_channel.values()]
    return [int(np.argmax(gaps[: findings.d.scene.joints]))]


def _efforts(findings: EffortFindings) -> Chart:
    """Efforts of all joints on held-out rows over a stretch of time, beside what predictions
    leave."""
    scene, std = findings.d.scene, np.array([n.std for n in findings.d.noise])
    kept = scene.kept()
    t, measured = scene.signals.t[kept], scene.thin(scene.signals.effort)
    rows = np.abs(t - 0.5 * (t[0] + t[-1])) <= 0.5 * _SHOWN_S
    panels, note = [], ""
    for j, joint in enumerate(scene.robot.joints[: scene.joints]):
        efforts, residuals = [Series("measured", "line", t[rows], measured[rows, j])], []
        for name, label, role in _PREDICTED:
            if name in findings.held_out.left:
                left = findings.held_out.left[name][rows, j]
                predicted = measured[rows, j] - std[j] * left
                efforts.append(Series(label, "line", t[rows], predicted, role=role))
                residuals.append(Series(label, "line", t[rows], left, role=role))
        units = (f"joint {j + 1}", joint.own("N·m")), (f"joint {j + 1}, residual", "noise")
        for (label, unit), series in zip(units, (efforts, residuals), strict=True):
            some, note = thinned(series, what="rows")
            axis = Axis(label, unit)
            panels.append(Panel(Axis("time", "s"), axis, some, zero=unit == "noise", height=0.8))
    caption = (
        "On the left efforts, on the right measured minus predicted in units of the noise of a "
        "row. Predictions are by fits that did not see the rows."
    )
    return Chart("efforts", "Measured and predicted efforts", tuple(panels), 2, True, caption, note)


def _friction(findings: EffortFindings, j: int) -> Chart:
    """What speed makes of a joint's effort: measured, stated and with the effects.

    What links and load of the whole arm add by the fit is no friction.
    """
    d, scene, std = findings.d, findings.d.scene, findings.d.noise[j].std
    speed = scene.q.d[scene.kept(), j]
    stated = scene.thin(scene.friction[:, j])
    body = d.arm[:, j] @ findings.held_out.fit.x[d.joint < 0]
    measured = stated + d.y[:, j] - body
    efforts = [speed, measured, stated]
    if "with_effects" in findings.held_out.left:
        efforts.append(measured - std * findings.held_out.left["with_effects"][:, j])
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1)))
    at = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    x, *means = (np.bincount(at, values) / np.bincount(at) for values in efforts)
    series = [
        Series(name, kind, x, y, role=role)
        for y, (name, kind, role) in zip(means, _FRICTION, strict=False)
    ]
    unit = scene.robot.joints[j].own
    up = Axis("effort less rigid body", unit("N·m"))
    panel = Panel(Axis("speed", unit("rad/s")), up, tuple(series), zero=True)
    caption = "Means over bins of speed; what depends on angle or load alone averages out."
    return Chart(f"friction-{j + 1}", f"Friction of joint {j + 1}", (panel,), caption=caption)
