"""Figures that show a cause as an engineer would look for it, and the residual where none stands.

An effect says what it is drawn over (`Effect.shown`): a loop, a spring line, a wave. An effect that
says nothing has measured and simulated over the rows sorted by its prediction, which
`figures.of_claim` draws of all.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed.effects.chain import respond
from wrenchbed.effects.scene import Scene
from wrenchbed.pages.chart import Axis, Chart, Mark, Matrix, Panel, Role, Scale, Series, thinned
from wrenchbed.pages.numbers import minus
from wrenchbed.physics.rotations import apply
from wrenchbed.physics.time_derivatives import value
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.reports.simulators import Claim, Evidence, largest

STEP = 1e-5
"""Of a joint's value in a difference quotient [rad or m]."""
LEAST_SLOPE = 0.2
"""Of the largest: rows in which a joint moves the reading less say little about its value."""
ROUNDING = 1e-9
"""Of a response per unit of load, below which it is rounding of doubles."""
LEAST_REACH, LAGS = 8, 40
"""Samples by which readings are shifted each way at least, and shifts each way."""
SMOOTH_S = 0.5
"""Of a motion, over which rows are averaged: slower changes are the motion's own."""
MOST_ROWS = 200
"""Points of each of many panels."""
_CROSS = Scale("change of the reading [noise of one row]", -30.0, 30.0, (-30.0, 0.0, 30.0),
               diverging=True)  # fmt: skip
_OF_UNIT = {"N": "force", "N·m": "torque", "s": "time", "K": "temperature"}


def own_chart(e: Evidence, c: Claim, name: str) -> Chart | None:
    """A claimed cause over its own variable; None if it has none, or the data lack it.

    Args:
        e: the simulators.
        c: the cause.
        name: of the chart.
    """
    if c.active is None:
        return None
    draw = _OWN.get(c.active.effect.shown)
    return None if draw is None else draw(e, c, name)


def curve_chart(entry: Mapping[str, Any], name: str) -> Chart | None:
    """The form-free curve of an entry of ``which`` with its 95 % band; None if it has none."""
    curve = entry.get("curve")
    if not curve:
        return None
    x, y, std = (np.asarray(curve[k], dtype=float) for k in ("x", "y", "std"))
    across = Axis(_OF_UNIT.get(str(curve["x_unit"]), "variable"), str(curve["x_unit"]))
    series = (
        Series("95 % interval", "band", x, y, 1.96 * std, "after"),
        Series("estimated curve", "line", x, y, std, "after"),
    )
    panel = Panel(across, Axis("what it adds", str(curve["y_unit"])), series, zero=True)
    caption = "A curve without an assumed formula, with the interval that the data leave it."
    return Chart(name, f"{entry['effect']}: estimated curve", (panel,), caption=caption)


def _over(name: str, title: str, x: Axis, y: Axis, series: list[Series], caption: str) -> Chart:
    """One panel of series over a variable."""
    kept, note = thinned(series)
    panel = Panel(x, y, kept, zero=True, height=1.4)
    return Chart(name, title, (panel,), caption=caption, note=note)


# ---- a joint's own error ------------------------------------------------------------------


def _joint(e: Evidence, c: Claim, name: str) -> Chart | None:
    """What each row says of a joint's error, against the torque on it or against its own value.

    A spring is a line over the torque of weight, a gear a wave over the angle.
    """
    scene = e.prepared.scene
    if c.active is None or not scene.jointed:
        return None
    moved = value(c.active.effect.displace(scene, c.active.values))
    if np.ndim(moved) < 2:
        return None
    shift = moved[scene.held]
    k, rows, error, std = _joint_error(e, c, shift)
    turns = scene.robot.joints[k].unit == "rad"
    if c.active.effect.shown == "torque":
        x = scene.joint_torque[scene.held][:, k]
        kind = "torque" if turns else "force"
        across = Axis(f"{kind} of weight on joint {k + 1}", "N·m" if turns else "N")
    else:
        x = scene.joints[scene.held][:, k] * (180.0 / np.pi if turns else 1e3)
        across = Axis(f"joint {k + 1}", "°" if turns else "mm")
    order = np.argsort(x, kind="stable")
    series = [
        Series("simulated effect", "line", x[order], 1e3 * shift[order, k], role="after"),
        Series("measured", "points", x[rows], 1e3 * error, 1e3 * std, ids=e.ids[rows]),
    ]
    caption = (
        "What each row's six readings say of the joint's true value, less the reported one, by "
        f"least squares. {len(x) - len(rows)} of {len(x)} rows give too little information and "
        "are not drawn."
    )
    y = Axis(f"error of joint {k + 1}", "mrad" if turns else "mm")
    title = f"{c.name}: error of joint {k + 1} against {across.label}"
    return _over(name, title, across, y, series, caption)


def _joint_error(
    e: Evidence, c: Claim, shift: np.ndarray
) -> tuple[int, np.ndarray, np.ndarray, np.ndarray]:
    """What each row says of the value of the joint that is wrong.

    Args:
        e, c: the simulators and the cause.
        shift: of the joints by the cause (H, J).

    Returns:
        Number of the joint from 0; rows that say something (R,); their errors (R,) [rad or m];
        standard uncertainties (R,).
    """
    scene = replace(e.prepared.scene, theta=c.rest.robot_theta)
    slopes = [_slope(scene, c, k) / e.std for k in range(shift.shape[1])]
    sizes = [float(((s * shift[:, [k]]) ** 2).sum()) for k, s in enumerate(slopes)]
    k = int(np.argmax(sizes))
    others = sum(s * shift[:, [j]] for j, s in enumerate(slopes) if j != k)
    residual = c.measured / e.std - others
    weight = (slopes[k] ** 2).sum(axis=1)
    rows = np.flatnonzero(weight > LEAST_SLOPE**2 * weight.max())
    error = (slopes[k] * residual).sum(axis=1)[rows] / weight[rows]
    return k, rows, error, np.sqrt(float(e.prepared.noise.mean()) / weight[rows])


def _slope(scene: Scene, c: Claim, joint: int) -> np.ndarray:
    """Change of the readings (H, 6) per unit of a joint's value."""
    step = np.zeros(scene.joints.shape[1])
    step[joint] = STEP
    up, down = (respond(replace(scene, q=scene.q + s), c.rest.active) for s in (step, -step))
    return np.asarray((up - down)[scene.held] / (2.0 * STEP))


# ---- what the sensor makes of its load ------------------------------------------------------


def _load(e: Evidence, c: Claim, name: str) -> Chart:
    """What a channel shows too much against its load; of a loop rising apart from falling rows."""
    assert c.active is not None
    scene, k = e.prepared.scene, largest(c.effect / e.std)[0]
    channel, unit, at = CHANNELS[k], UNITS[k], np.flatnonzero(scene.held)
    load = scene.load[:, k]
    came = load[at] - load[np.maximum(at - 1, 0)]
    branches = {"": np.ones(len(at), dtype=bool)}
    caption = f"Measured minus the simulator without {c.name}."
    if c.active.effect.shown == "loop":
        branches = {", rising": came >= 0.0, ", falling": came < 0.0}
        caption += " Rising: the load was smaller on the way there. A sensor that remembers has "
        caption += "a loop."
    series = []
    marks: tuple[Mark, ...] = ("dot", "ring")
    for (word, chosen), mark in zip(branches.items(), marks, strict=False):
        rows = np.flatnonzero(chosen)
        x, ids = load[at][rows], e.ids[rows]
        std = np.full(len(rows), e.std[k] * np.sqrt(e.prepared.noise[k]))
        series += [
            Series(f"measured{word}", "points", x, c.measured[rows, k], std, mark=mark, ids=ids),
            Series(
                f"simulated effect{word}", "points", x, c.effect[rows, k], role="after",
                mark="diamond" if mark == "dot" else "ring", ids=ids,
            ),
        ]  # fmt: skip
    x_axis, y_axis = (
        Axis(f"simulated load {channel}", unit),
        Axis(f"{channel} minus simulator", unit),
    )
    title = f"{c.name}: {channel} against its load"
    return _over(name, title, x_axis, y_axis, series, caption)


def _matrix(e: Evidence, c: Claim, name: str) -> Chart:
    """What each channel shows of each channel's load."""
    assert c.active is not None
    scene, effect, p = e.prepared.scene, c.active.effect, c.active.values
    shown = effect.read(scene, scene.load, p) - scene.load
    columns = [scene.load + d for d in np.eye(6)]
    response = np.stack(
        [(effect.read(scene, load, p) - load - shown).mean(axis=0) for load in columns], axis=1
    )  # (6, 6): shows, of
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
    return Chart(name, f"{c.name}: what each channel shows of another", (panel,), caption=caption)


def _cross(i: int, j: int, v: float) -> str:
    if abs(v) < ROUNDING:
        return "0"
    if (i < 3) == (j < 3):
        return minus(f"{100 * v:.2f} %")
    return minus(f"{1e3 * v:.2f}" if i >= 3 else f"{v:.3f}")


# ---- time, and contact ----------------------------------------------------------------------


def _lag(e: Evidence, c: Claim, name: str) -> Chart | None:
    """Correlation of measured and simulated readings against a shift in time."""
    from scipy.interpolate import CubicSpline  # slow to load: only when it is used

    p, scene = e.prepared, e.prepared.scene
    if not scene.moving or e.after is None or c.active is None:
        return None
    t, k = scene.t[scene.held], largest(c.effect / e.std)[0]
    reach = max(LEAST_REACH * scene.period, 3.0 * abs(float(c.active.values.get("delay", 0.0))))
    lags = np.linspace(-reach, reach, 2 * LAGS + 1)
    inner = (t > t[0] + reach) & (t < t[-1] - reach)
    if inner.sum() < LAGS:
        return None
    y, after = p.y[inner, k], e.after[:, k]
    series, rest = [], []
    readings: tuple[tuple[str, np.ndarray, Role], ...] = (
        ("without the effect", after - c.effect[:, k], "before"),
        ("with the effect", after, "after"),
    )
    for label, reading, role in readings:
        shifted = CubicSpline(t, reading)
        moved = [shifted(t[inner] - lag) for lag in lags]
        like = np.array([np.corrcoef(y, m)[0, 1] for m in moved])
        rms = np.array([np.sqrt(np.mean((y - m) ** 2)) for m in moved]) / e.std[k]
        series.append(Series(label, "line", 1e3 * lags, like, role=role))
        rest.append(Series(label, "line", 1e3 * lags, rms, role=role))
    x = Axis("simulated readings later by", "ms")
    panels = (
        Panel(x, Axis(f"correlation of {CHANNELS[k]}"), tuple(series)),
        Panel(x, Axis("residual, rms", "noise"), tuple(rest)),
    )
    caption = (
        "The simulator fits best at the shift by which measured readings are late: without the "
        "effect beside 0, with it at 0."
    )
    return Chart(name, f"{c.name}: correlation over lag", panels, shared=True, caption=caption)


def _depth(e: Evidence, c: Claim, name: str) -> Chart | None:
    """Force along the push against the depth of what touches."""
    assert c.active is not None
    scene = e.prepared.scene
    depth = c.active.effect.variable(scene, c.active.values)
    if depth is None:
        return None
    rotation = value(scene.pose[0])[scene.held]
    simulated, measured = (apply(rotation, f[:, :3]) for f in (c.effect, c.measured))
    push = simulated.sum(axis=0)
    push = push / max(float(np.linalg.norm(push)), 1e-12)
    x = depth.values[scene.held]
    order = np.argsort(x, kind="stable")
    std = np.full(len(x), float(np.mean(e.std[:3] * np.sqrt(e.prepared.noise[:3]))))
    series = [
        Series("simulated effect", "line", x[order], (simulated @ push)[order], role="after"),
        Series("measured", "points", x, measured @ push, std, ids=e.ids),
    ]
    across, up = Axis(depth.label, depth.unit), Axis("force along the push", "N")
    caption = f"Measured minus the simulator without {c.name}, in the direction that it pushes."
    return _over(name, f"{c.name}: force over {depth.label}", across, up, series, caption)


_OWN: Mapping[str, Callable[[Evidence, Claim, str], Chart | None]] = {
    "torque": _joint, "angle": _joint, "load": _load, "loop": _load, "matrix": _matrix,
    "lag": _lag, "depth": _depth,
}  # fmt: skip
"""By `Effect.shown`; the others are drawn by `figures.of_claim` alone."""


# ---- where no single cause stands -----------------------------------------------------------


def everywhere(e: Evidence, name: str) -> Chart:
    """The residual of its largest channel over every joint, direction, time and load."""
    simulator = "the calibrated simulator" if e.after is None else "the simulator with the effects"
    residual = (e.prepared.y - (e.before if e.after is None else e.after)) / e.std
    k = largest(residual)[0]
    role: Role = "before" if e.after is None else "after"
    panels, note = [], ""
    for label, unit, x in _variables(e, k):
        order = np.argsort(x, kind="stable")
        points = Series("residual", "points", x[order], residual[order, k], role=role,
                        ids=e.ids[order])  # fmt: skip
        series, note = thinned([points], MOST_ROWS)
        y = Axis(f"{CHANNELS[k]}, residual", "noise")
        panels.append(Panel(Axis(label, unit), y, series, zero=True, height=0.8))
    caption = (
        f"Measured minus {simulator}, channel {CHANNELS[k]}, which differs most. A "
        "cause would show as a line, a wave or a step in the panel of its variable."
    )
    title = f"Residual of {CHANNELS[k]} over all that was recorded"
    return Chart(name, title, tuple(panels), columns=3, caption=caption, note=note)


def _variables(e: Evidence, channel: int) -> Iterator[tuple[str, str, np.ndarray]]:
    """Label, unit and values (H,) of what was recorded or follows from it."""
    p, scene = e.prepared, e.prepared.scene
    held = scene.held
    for k, joint in enumerate(scene.robot.joints if scene.jointed else ()):
        turns, x = joint.unit == "rad", scene.joints[held][:, k]
        yield f"joint {k + 1}", "°" if turns else "mm", np.rad2deg(x) if turns else 1e3 * x
    down = np.swapaxes(value(scene.pose[0])[held], 1, 2) @ np.asarray(scene.gravity)
    down = down / max(float(np.linalg.norm(scene.gravity)), 1e-9)
    for k, axis in enumerate("xyz"):
        yield f"gravity along the sensor's {axis}", "1", down[:, k]
    yield "time", "s", scene.t[held]
    yield f"simulated load {CHANNELS[channel]}", UNITS[channel], scene.load[held][:, channel]
    if scene.warmth is not None:
        yield "temperature above the first row's", "K", scene.warmth[held]
    if p.moving:
        speed = np.gradient(scene.joints[held], scene.t[held], axis=0)
        yield "speed of the joints together", "rad/s", np.linalg.norm(speed, axis=1)


def scatter(e: Evidence, entry: Mapping[str, Any], name: str) -> Chart:
    """Rows about their means where a cause shows only between rows.

    Over time; beneath at rest how many are how large, in a motion their spectrum: a vibration is a
    peak, noise is flat.
    """
    rows = e.prepared.excerpt
    stated = np.asarray(e.prepared.recording.metadata.sensor.noise_std or (0.0,) * 6, dtype=float)
    noise = np.where(stated > 0.0, stated, e.std)
    segments = rows.columns.get("segment")
    at_rest = segments is not None and rows.metadata.mode == "static"
    if segments is not None and at_rest:
        _, at = np.unique(segments, return_inverse=True)
        count = np.maximum(np.bincount(at), 1)[:, None]
        means = np.stack([np.bincount(at, column) for column in rows.wrench.T], axis=1) / count
        kept, about = slice(None), "its pose"
        residual = (rows.wrench - means[at]) / noise
    else:
        width = max(3, round(SMOOTH_S / float(np.median(np.diff(rows.t))))) | 1
        kernel = np.ones(width) / width
        means = np.stack([np.convolve(c, kernel, "valid") for c in rows.wrench.T], axis=1)
        kept, about = slice(width // 2, len(rows) - width // 2), f"the {SMOOTH_S:g} s about it"
        residual = (rows.wrench[kept] - means) / noise
    k = int(np.argmax((residual**2).mean(axis=0)))
    t, channel = rows.t[kept] - rows.t[0], Axis(f"{CHANNELS[k]} about its mean", "stated noise")
    over_time, note = thinned([Series("measured", "line", t, residual[:, k])])
    panels = (
        Panel(Axis("time", "s"), channel, over_time, zero=True),
        _sizes(residual[:, k], channel) if at_rest else _spectrum(t, residual[:, k]),
    )
    caption = f"Each row less the mean of {about}, in units of the noise that the sensor states."
    title = f"{entry['effect']}: rows about their means"
    return Chart(name, title, panels, caption=caption, note=note)


def _sizes(residual: np.ndarray, axis: Axis) -> Panel:
    """How many rows (N,) are how large, beside what the stated noise makes."""
    reach = max(4.0, float(np.abs(residual).max()))
    counts, edges = np.histogram(residual, np.linspace(-reach, reach, 61))
    middle = (edges[1:] + edges[:-1]) / 2.0
    usual = len(residual) * np.diff(edges) * np.exp(-(middle**2) / 2.0) / np.sqrt(2.0 * np.pi)
    series = (
        Series("rows", "line", middle, counts.astype(float)),
        Series("stated noise", "line", middle, usual, role="before", dashed=True),
    )
    return Panel(axis, Axis("rows"), series)


def _spectrum(t: np.ndarray, residual: np.ndarray) -> Panel:
    """Amplitude of rows (N,) over frequency."""
    frequency = np.fft.rfftfreq(len(t), float(np.median(np.diff(t))))
    amplitude = 2.0 * np.abs(np.fft.rfft(residual)) / len(t)
    series, _ = thinned([Series("amplitude", "line", frequency, amplitude)])
    return Panel(Axis("frequency", "Hz"), Axis("amplitude", "stated noise"), series)
