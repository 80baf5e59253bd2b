"""Figures of a diagnosis of joint efforts: measured and predicted, and each joint's friction."""

import numpy as np
from scipy.stats import binned_statistic

from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.pages.chart import Axis, Chart, Kind, Panel, Role, Series, thinned

_SHOWN_S = 15.0
"""Time of a motion that is shown [s]: several reversals of each joint are in view."""
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
    named = [c.key[1] - 1 for c in findings.verdict.causes
           if c.key[1] is not None and c.key[0].startswith("drive.")]  # fmt: skip
    if named:
        return list(dict.fromkeys(named))[:2]
    gaps = [v["before"] for v in findings.diagnosis.gap.per_channel.values()][
        : findings.d.scene.joints
    ]
    return [int(np.argmax(gaps))] if findings.diagnosis.verdict != "none" else []


def _efforts(findings: EffortFindings) -> Chart:
    """Measured and predicted efforts of all joints on held-out rows, over a stretch of time."""
    scene, std = findings.d.scene, np.array([n.std for n in findings.d.noise])
    kept = scene.kept()
    t, measured = scene.signals.t[kept], scene.thin(scene.signals.effort)
    middle = 0.5 * (t[0] + t[-1])
    rows = np.abs(t - middle) <= 0.5 * _SHOWN_S
    panels, note = [], ""
    for j in range(scene.joints):
        series = [Series("measured", "line", t[rows], measured[rows, j], role="measured")]
        roles = (("calibrated", "before"), ("with_effects", "after"))
        for name, role in roles:
            if name in findings.held_out.left:
                made = measured[:, j] - std[j] * findings.held_out.left[name][:, j]
                label = name.replace("_", " the ")
                series.append(Series(label, "line", t[rows], made[rows], role=role))  # type: ignore[arg-type]
        some, note = thinned(series, what="rows")
        effort = Axis(f"joint {j + 1}", scene.robot.joints[j].own("N·m"))
        panels.append(Panel(Axis("time", "s"), effort, some, height=0.8))
    caption = "Predictions are by fits that did not see the rows."
    return Chart("efforts", "Measured and predicted efforts", tuple(panels), 2, True, caption, note)


def _friction(findings: EffortFindings, j: int) -> Chart:
    """What speed makes of a joint's effort: measured, stated and with the effects."""
    scene, std = findings.d.scene, findings.d.noise[j].std
    speed = scene.q.d[scene.kept(), j]
    stated = scene.thin(scene.friction[:, j])
    measured = stated + findings.d.y[:, j]
    efforts = [speed, measured, stated]
    if "with_effects" in findings.held_out.left:
        efforts.append(measured - std * findings.held_out.left["with_effects"][:, j])
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1)))
    x, *means = np.asarray(binned_statistic(speed, efforts, "mean", edges).statistic)
    series = [
        Series(name, kind, x, y, role=role)
        for y, (name, kind, role) in zip(means, _FRICTION, strict=False)
    ]
    own_unit = scene.robot.joints[j].own
    panel = Panel(Axis("speed", own_unit("rad/s")), Axis("effort less rigid body", own_unit("N·m")),
                  tuple(series), zero=True)  # fmt: skip
    caption = "Means over bins of speed; what depends on angle or load alone averages out."
    return Chart(f"friction-{j + 1}", f"Friction of joint {j + 1}", (panel,), caption=caption)
