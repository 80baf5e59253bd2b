"""Figures of a cause over its own variable, and of the residual where no cause is claimed.

An effect states the variable that it is drawn over (`Effect.shown`), for a loop, a spring line, a
wave. Other effects are drawn by `figures.of_cause`: measured and simulated over the rows, sorted by
the effect's prediction.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.effects.scene import Scene
from wrenchbed.pages.chart import Axis, Chart, Matrix, Panel, Scale, Series, thinned
from wrenchbed.pages.numbers import minus
from wrenchbed.physics.taylor_jets import value
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.reports.compared_readings import Cause, HeldOutReadings, joint_axis, largest

STEP = 1e-5
"""Step of a joint's value in a difference quotient [rad or m]."""
LEAST_SLOPE = 0.2
"""Share of the largest slope below which a row is left out: it says little about a joint's value.
"""
ROUNDING = 1e-9
"""Added reading per unit of load that counts as 0: rounding of doubles."""
SMOOTH_S = 0.5
"""Window of the moving average of a motion's rows [s]: slower changes belong to the motion."""
MOST_ROWS = 200
"""Most points in each of many panels."""
_CROSS = Scale("change of the reading [noise of one row]", -30.0, 30.0, (-30.0, 0.0, 30.0),
               diverging=True)  # fmt: skip
_OF_UNIT = {"N": "force", "N·m": "torque", "s": "time", "K": "temperature"}


def own_chart(e: HeldOutReadings, c: Cause, name: str) -> Chart | None:
    """Chart ``name`` of cause c over its own variable (torque, angle, …); None if it has none."""
    draw = None if c.active is None else _OWN.get(c.active.effect.shown)
    chart = None if draw is None or c.active is None else draw(e, c, c.active)
    return None if chart is None else replace(chart, name=name)


def curve_chart(entry: Mapping[str, Any], name: str) -> Chart | None:
    """Chart ``name`` of the curve ± std of a cause (``entry`` of ``which`` in diagnosis.json) that
    was estimated without a formula; None if it has none."""
    curve = entry.get("curve")
    if not curve:
        return None
    x, y, std = (np.asarray(curve[k], dtype=float) for k in ("x", "y", "std"))
    across = Axis(_OF_UNIT.get(str(curve["x_unit"]), "variable"), str(curve["x_unit"]))
    series = [Series("estimated curve", "points", x, y, std, "after")]
    caption = "A curve without an assumed formula; upright lines: one standard uncertainty."
    title, up = f"{entry['effect']}: estimated curve", Axis("what it adds", str(curve["y_unit"]))
    return replace(_over(title, across, up, series, caption), name=name)


def _over(title: str, x: Axis, y: Axis, series: Sequence[Series], caption: str) -> Chart:
    """Chart with one panel: series over x, thinned if they have too many points."""
    kept, note = thinned(series)
    panel = Panel(x, y, kept, zero=True, height=1.4)
    return Chart("", title, (panel,), caption=caption, note=note)


# ---- a joint's own error ------------------------------------------------------------------


def _joint(e: HeldOutReadings, c: Cause, active: ActiveEffect) -> Chart | None:
    """Error of a joint at each row, for the ``active`` effect of cause c, against the torque on the
    joint or its own value: a spring shows as a line over the torque of weight, a gear as a wave
    over the angle."""
    scene = e.prepared.scene
    moved = value(active.effect.displace(scene, active.values)) if scene.jointed else 0.0
    if np.ndim(moved) < 2:
        return None
    shift = np.asarray(moved)[scene.held]
    k, rows, error, std = _joint_error(e, c, shift)
    joint = scene.robot.joints[k]
    own, factor = joint_axis(joint, k + 1)
    across, x = own, factor * scene.joints[scene.held][:, k]
    if active.effect.shown == "torque":
        x = scene.joint_torque[scene.held][:, k]
        unit = joint.own("N·m")
        across = Axis(f"{_OF_UNIT[unit]} of weight on joint {k + 1}", unit)
    order = np.argsort(x, kind="stable")
    series = [
        Series("simulated effect", "line", x[order], factor * shift[order, k], role="after"),
        Series("measured", "points", x[rows], factor * error, factor * std, ids=e.ids[rows]),
    ]
    caption = "What each row's readings say of the joint's true value, less the reported one, by "
    caption += "least squares."
    if few := len(x) - len(rows):
        caption += f" {few} of {len(x)} rows give too little information and are not drawn."
    y = Axis(f"error of joint {k + 1}", own.unit)
    return _over(f"{c.name}: {y.label} against {across.label}", across, y, series, caption)


def _joint_error(
    e: HeldOutReadings, c: Cause, shift: np.ndarray
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """Error of a joint, by least squares, for a cause that shifts joints by ``shift`` (H, J): index
    of the most shifted joint; rows that show it (R,); errors (R,) [rad or m]; standard
    uncertainties (R,)."""
    scene = replace(e.prepared.scene, theta=c.rest.robot_theta)
    slopes = [_slope(e.prepared, scene, c, k) / e.std for k in range(shift.shape[1])]
    sizes = [float(((s * shift[:, [k]]) ** 2).sum()) for k, s in enumerate(slopes)]
    k = int(np.argmax(sizes))
    others = sum(s * shift[:, [j]] for j, s in enumerate(slopes) if j != k)
    residual = c.measured / e.std - others
    weight = (slopes[k] ** 2).sum(axis=1)
    rows = np.flatnonzero(weight > LEAST_SLOPE**2 * weight.max())
    error = (slopes[k] * residual).sum(axis=1)[rows] / weight[rows]
    return k, rows, error, np.sqrt(float(e.prepared.noise.mean()) / weight[rows])


def _slope(p: Prepared, scene: Scene, c: Cause, joint: int) -> np.ndarray:
    """Derivative of the readings (H, C) by joint number ``joint`` (from 0) [1/rad or 1/m],
    simulated without cause c."""
    step = STEP * np.eye(scene.joints.shape[1])[joint]
    up, down = (p.read(replace(scene, q=scene.q + s), c.rest.active) for s in (step, -step))
    return np.asarray((up - down)[scene.held] / (2.0 * STEP))


# ---- what the sensor makes of its load ------------------------------------------------------


def _load(e: HeldOutReadings, c: Cause, active: ActiveEffect) -> Chart:
    """Chart of the channel that shows a cause most over its load; for a loop, points of rising
    loads have another mark than those of falling ones."""
    scene, k = e.prepared.scene, largest(c.effect / e.std)
    channel, unit, at = CHANNELS[k], UNITS[k], np.flatnonzero(scene.held)
    load = scene.load[:, k]
    came = load[at] - load[np.maximum(at - 1, 0)]
    branches = {"": np.ones(len(at), dtype=bool)}
    caption = f"Measured minus the simulator without {c.name}."
    if active.effect.shown == "loop":
        branches = {", rising": came >= 0.0, ", falling": came < 0.0}
        caption += " Rising: the load was smaller before. A sensor that remembers has a loop."
    series = []
    for word, chosen in branches.items():
        first, rows = word != ", falling", np.flatnonzero(chosen)
        x, ids = load[at][rows], e.ids[rows]
        std = np.full(len(rows), e.std[k] * np.sqrt(e.prepared.noise[k]))
        series += [
            Series(f"measured{word}", "points", x, c.measured[rows, k], std,
                   mark="dot" if first else "ring", ids=ids),
            Series(f"simulated effect{word}", "points", x, c.effect[rows, k], role="after",
                   mark="diamond" if first else "ring", ids=ids),
        ]  # fmt: skip
    across, up = Axis(f"simulated load {channel}", unit), Axis(f"{channel} minus simulator", unit)
    return _over(f"{c.name}: {channel} against its load", across, up, series, caption)


def _matrix(e: HeldOutReadings, c: Cause, active: ActiveEffect) -> Chart:
    """Chart of the matrix (6, 6) of what an effect adds to each channel per unit load in each
    one."""
    scene, read, p = e.prepared.scene, active.effect.read, active.values
    plain = read(scene, scene.load, p)
    steps = [read(scene, scene.load + d, p) - plain - d for d in np.eye(6)]
    response = np.stack([step.mean(axis=0) for step in steps], axis=1)  # (6, 6): shows, of
    span = np.ptp(scene.load[scene.held], axis=0)
    texts = tuple(tuple(_cross(i, j, float(v)) for j, v in enumerate(row))
                  for i, row in enumerate(response))  # fmt: skip
    matrix = Matrix(CHANNELS, CHANNELS, response * span / e.std[:, None], _CROSS, texts)
    caption = (
        "Down: the channel that shows it. Numbers: % between like channels, mm of torque from "
        "force, N per N·m of force from torque. Colours: its change over the loads of this "
        "recording, in units of the noise of one row."
    )
    panel = Panel(Axis("of the load of"), Axis(""), matrix=matrix)
    return Chart("", f"{c.name}: what each channel shows of another", (panel,), caption=caption)


def _cross(i: int, j: int, v: float) -> str:
    if abs(v) < ROUNDING:
        return "0"
    if (i < 3) == (j < 3):
        return minus(f"{100 * v:.2f} %")
    return minus(f"{1e3 * v:.2f}" if i >= 3 else f"{v:.3f}")


_OWN: Mapping[str, Callable[[HeldOutReadings, Cause, ActiveEffect], Chart | None]] = {
    "torque": _joint, "angle": _joint, "load": _load, "loop": _load, "matrix": _matrix,
}  # fmt: skip
"""Function that draws a cause's chart, by `Effect.shown`; others have `figures.of_cause` alone."""


# ---- where no single cause stands -----------------------------------------------------------


def everywhere(e: HeldOutReadings, name: str) -> Chart:
    """Chart ``name`` of the channel with the largest residual, over each joint, gravity, time,
    load."""
    claimed = e.after is not None
    residual = (e.prepared.y - (e.before if e.after is None else e.after)) / e.std
    k = largest(residual)
    y, panels, note = Axis(f"{e.names[k]}, residual", "noise"), [], ""
    for axis, x in _variables(e, k):
        order = np.argsort(x, kind="stable")
        points = Series("residual", "points", x[order], residual[order, k], None,
                        "after" if claimed else "before", ids=e.ids[order])  # fmt: skip
        series, note = thinned([points], MOST_ROWS)
        panels.append(Panel(axis, y, series, zero=True, height=0.8))
    simulator = "the simulator with the effects" if claimed else "the calibrated simulator"
    caption = (
        f"Measured minus {simulator}, channel {e.names[k]}, which differs most. A "
        "cause would show as a line, a wave or a step in the panel of its variable."
    )
    title = f"Residual of {e.names[k]} over all that was recorded"
    return Chart(name, title, tuple(panels), columns=3, caption=caption, note=note)


def _variables(e: HeldOutReadings, channel: int) -> Iterator[tuple[Axis, np.ndarray]]:
    """Yield axis and values (H,) of each variable: joints, gravity in the sensor, time, load of
    ``channel``."""
    scene, held = e.prepared.scene, e.prepared.scene.held
    for k, joint in enumerate(scene.robot.joints if scene.jointed else ()):
        axis, factor = joint_axis(joint, k + 1)
        yield axis, factor * scene.joints[held][:, k]
    down = np.swapaxes(value(scene.pose[0])[held], 1, 2) @ np.asarray(scene.gravity)
    down = down / max(float(np.linalg.norm(scene.gravity)), 1e-9)
    for k, direction in enumerate("xyz"):
        yield Axis(f"gravity along the sensor's {direction}", "1"), down[:, k]
    yield Axis("time", "s"), scene.t[held]
    if e.prepared.has_wrench:
        load = Axis(f"simulated load {e.names[channel]}", e.units[channel])
        yield load, scene.load[held][:, channel]
    if scene.warmth is not None:
        yield Axis("temperature above the first row's", "K"), scene.warmth[held]
    if e.prepared.moving:
        speed = np.gradient(scene.joints[held], scene.t[held], axis=0)
        yield Axis("speed of the joints together", "rad/s"), np.linalg.norm(speed, axis=1)


def scatter(e: HeldOutReadings, entry: Mapping[str, Any], name: str) -> Chart:
    """Chart ``name`` of rows minus their mean over time, for a cause (``entry`` of diagnosis.json)
    that shows in no mean; of a motion also as a spectrum: a vibration is a peak, noise is flat."""
    rows = e.prepared.excerpt
    stated = np.asarray(rows.metadata.sensor.noise_std or (0.0,) * 6, dtype=float)
    noise = np.where(stated > 0.0, stated, e.std)
    segments = rows.columns.get("segment")
    t, about = rows.t - rows.t[0], "its pose"
    at_rest = segments is not None and rows.metadata.mode == "static"
    if segments is not None and at_rest:
        _, at = np.unique(segments, return_inverse=True)
        sums = np.stack([np.bincount(at, column) for column in rows.wrench.T], axis=1)
        residual = (rows.wrench - (sums / np.bincount(at)[:, None])[at]) / noise
    else:
        about = f"the {SMOOTH_S:g} s about it"
        width = max(3, round(SMOOTH_S / float(np.median(np.diff(t))))) | 1
        kept = slice(width // 2, len(t) - width // 2)
        smooth = uniform_filter1d(rows.wrench, width, axis=0)
        t, residual = t[kept], ((rows.wrench - smooth) / noise)[kept]
    k = int(np.argmax((residual**2).mean(axis=0)))
    channel = Axis(f"{CHANNELS[k]} about its mean", "noise")
    over_time, note = thinned([Series("measured", "line", t, residual[:, k])])
    panels = [Panel(Axis("time", "s"), channel, over_time, zero=True)]
    if not at_rest:
        panels.append(_spectrum(t, residual[:, k]))
    source = "as stated" if rows.metadata.sensor.noise_std else e.prepared.noise_source
    caption = f"Each row less the mean of {about}, in units of the noise of a row, {source}."
    title = f"{entry['effect']}: rows about their means"
    return Chart(name, title, tuple(panels), caption=caption, note=note)


def _spectrum(t: np.ndarray, residual: np.ndarray) -> Panel:
    """Panel with the amplitude spectrum of residuals (N,) at t (N,) [s], in units of stated
    noise."""
    frequency = np.fft.rfftfreq(len(t), float(np.median(np.diff(t))))
    amplitude = 2.0 * np.abs(np.fft.rfft(residual)) / len(t)
    series, _ = thinned([Series("amplitude", "line", frequency, amplitude)])
    return Panel(Axis("frequency", "Hz"), Axis("amplitude", "noise"), series)
