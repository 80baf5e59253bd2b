"""The figure that shows a cause as an engineer would look for it: a loop, a spring line, a wave.

An effect says what it is drawn over (`Effect.shown`); an effect that says nothing has measured and
simulated over the rows sorted by its prediction, which `figures.of_claim` draws of all.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from wrenchbed.effects.chain import respond
from wrenchbed.effects.scene import Scene
from wrenchbed.pages.chart import Axis, Chart, Mark, Matrix, Panel, Role, Scale, Series, thinned
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
_CROSS = Scale("change of the reading [noise of a row]", -30.0, 30.0, (-30.0, 0.0, 30.0),
               diverging=True)  # fmt: skip


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
    x_unit, y_unit = str(curve["x_unit"]), str(curve["y_unit"])
    label = {"N": "force", "N·m": "torque", "s": "time", "K": "temperature"}.get(x_unit, "variable")
    series = (
        Series("95 % interval", "band", x, y, 1.96 * std, "after"),
        Series("estimated curve", "line", x, y, std, "after"),
    )
    panel = Panel(Axis(label, x_unit), Axis("what it adds", y_unit), series, zero=True)
    caption = "A curve without an assumed formula, with the interval that the data leave it."
    return Chart(name, f"{entry['effect']}: estimated curve", (panel,), caption=caption)


# ---- a joint's own error ------------------------------------------------------------------


def _joint_error(e: Evidence, c: Claim) -> tuple[int, np.ndarray, np.ndarray, np.ndarray] | None:
    """What each row says of the value of the joint that is wrong.

    Returns:
        Number of the joint from 0; rows that say something (R,); their errors (R,) [rad or m];
        standard uncertainties (R,).
    """
    p, scene = e.prepared, e.prepared.scene
    assert c.active is not None
    if not scene.jointed:
        return None
    moved = value(c.active.effect.displace(scene, c.active.values))
    if np.ndim(moved) < 2:
        return None
    shift = moved[scene.held]
    at = replace(scene, theta=c.rest.robot_theta)
    slopes = [_slope(at, c, k) / e.std for k in range(shift.shape[1])]
    sizes = [float(((s * shift[:, [k]]) ** 2).sum()) for k, s in enumerate(slopes)]
    k = int(np.argmax(sizes))
    others = sum(s * shift[:, [j]] for j, s in enumerate(slopes) if j != k)
    left = c.measured / e.std - others
    weight = (slopes[k] ** 2).sum(axis=1)
    rows = np.flatnonzero(weight > LEAST_SLOPE**2 * weight.max())
    error = (slopes[k] * left).sum(axis=1)[rows] / weight[rows]
    return k, rows, error, np.sqrt(float(p.noise.mean()) / weight[rows])


def _slope(scene: Scene, c: Claim, joint: int) -> np.ndarray:
    """Change of the readings (H, 6) per unit of a joint's value."""
    step = np.zeros(scene.joints.shape[1])
    step[joint] = STEP
    up, down = (respond(replace(scene, q=scene.q + s), c.rest.active) for s in (step, -step))
    return np.asarray((up - down)[scene.held] / (2.0 * STEP))


def _torque(e: Evidence, c: Claim, name: str) -> Chart | None:
    """Error of a joint against the torque of weight on it: a spring is a line."""
    found = _joint_error(e, c)
    if found is None:
        return None
    k, scene = found[0], e.prepared.scene
    turns = scene.robot.joints[k].unit == "rad"
    x = scene.joint_torque[scene.held][:, k]
    label = Axis(f"torque of weight on joint {k + 1}", "N·m")
    if not turns:
        label = Axis(f"force of weight on joint {k + 1}", "N")
    return _of_joint(e, c, name, found, x, label)


def _angle(e: Evidence, c: Claim, name: str) -> Chart | None:
    """Error of a joint against its own value: a gear is a wave."""
    found = _joint_error(e, c)
    if found is None:
        return None
    k, scene = found[0], e.prepared.scene
    turns = scene.robot.joints[k].unit == "rad"
    x = scene.joints[scene.held][:, k]
    label = Axis(f"joint {k + 1}", "°" if turns else "mm")
    return _of_joint(e, c, name, found, np.rad2deg(x) if turns else 1e3 * x, label, dense=turns)


def _of_joint(
    e: Evidence, c: Claim, name: str, found: tuple[int, np.ndarray, np.ndarray, np.ndarray],
    x: np.ndarray, label: Axis, *, dense: bool = False,
) -> Chart:  # fmt: skip
    k, rows, error, std = found
    assert c.active is not None
    scene = e.prepared.scene
    unit = "mrad" if scene.robot.joints[k].unit == "rad" else "mm"
    moved = 1e3 * value(c.active.effect.displace(scene, c.active.values))[scene.held][:, k]
    order = np.argsort(x, kind="stable")
    told = order[np.isin(order, rows)]
    at = np.searchsorted(rows, told)
    line_x, line_y = x[order], moved[order]
    if dense and not scene.moving:
        line_x, line_y = _wave(scene, c, k)
    series, note = thinned(
        [
            Series("simulated effect", "line", line_x, line_y, role="after"),
            Series(
                "measured", "points", x[told], 1e3 * error[at], 1e3 * std[at], ids=e.ids[told]
            ),
        ],
        what="rows",
    )  # fmt: skip
    panel = Panel(label, Axis(f"error of joint {k + 1}", unit), series, zero=True, height=1.4)
    caption = (
        "What each row's six readings say of the joint's true value, less the reported one, by "
        f"least squares. {len(x) - len(rows)} of {len(x)} rows give too little information and "
        "are not drawn."
    )
    title = f"{c.name}: error of joint {k + 1} against {label.label}"
    return Chart(name, title, (panel,), caption=caption, note=note)


def _wave(scene: Scene, c: Claim, joint: int) -> tuple[np.ndarray, np.ndarray]:
    """What an effect does to a joint over its range: degrees and mrad (P,)."""
    assert c.active is not None
    joints = scene.joints
    grid = np.linspace(joints[:, joint].min(), joints[:, joint].max(), 400)
    q = np.tile(np.median(joints, axis=0), (len(grid), 1))
    q[:, joint] = grid
    still = replace(
        scene, q=q, t=np.arange(len(grid), dtype=float), held=np.ones(len(grid), dtype=bool),
        warmth=None, extra={},
    )  # fmt: skip
    moved = value(c.active.effect.displace(still, c.active.values))
    return np.rad2deg(grid), 1e3 * moved[:, joint]


# ---- what the sensor makes of its load ------------------------------------------------------


def _load(e: Evidence, c: Claim, name: str) -> Chart:
    """What a channel shows too much against its load."""
    k, x, order = _over_load(e, c)
    series = [
        _points(e, "measured", x, c.measured, k, order),
        Series(
            "simulated effect", "points", x[order], c.effect[order, k], role="after",
            mark="diamond", ids=e.ids[order],
        ),
    ]  # fmt: skip
    return _load_chart(c, name, k, series, "")


def _loop(e: Evidence, c: Claim, name: str) -> Chart:
    """The same, with the rows that come from a smaller load apart from those from a larger one."""
    k, x, _ = _over_load(e, c)
    at = np.flatnonzero(e.prepared.scene.held)
    way = e.prepared.scene.load[:, k]
    came = way[at] - way[np.maximum(at - 1, 0)]
    series = []
    for up, word in ((True, "rising"), (False, "falling")):
        own = np.flatnonzero((came >= 0.0) == up)
        mark: Mark = "dot" if up else "ring"
        series += [
            replace(_points(e, f"measured, {word}", x, c.measured, k, own), mark=mark),
            Series(
                f"simulated, {word}", "points", x[own], c.effect[own, k], role="after",
                mark="diamond" if up else "ring", ids=e.ids[own],
            ),
        ]  # fmt: skip
    note = "Rising: the load was smaller on the way there. A sensor that remembers has a loop."
    return _load_chart(c, name, k, series, note)


def _over_load(e: Evidence, c: Claim) -> tuple[int, np.ndarray, np.ndarray]:
    k = largest(c.effect / e.std)[0]
    x = e.prepared.scene.load[e.prepared.scene.held][:, k]
    return k, x, np.argsort(x, kind="stable")


def _points(
    e: Evidence, name: str, x: np.ndarray, y: np.ndarray, k: int, rows: np.ndarray
) -> Series:
    std = np.full(len(rows), e.std[k] * np.sqrt(e.prepared.noise[k]))
    return Series(name, "points", x[rows], y[rows, k], std, ids=e.ids[rows])


def _load_chart(c: Claim, name: str, k: int, series: list[Series], told: str) -> Chart:
    kept, note = thinned(series)
    channel, unit = CHANNELS[k], UNITS[k]
    panel = Panel(
        Axis(f"simulated load {channel}", unit), Axis(f"{channel} minus simulator", unit), kept,
        zero=True, height=1.4,
    )  # fmt: skip
    caption = f"Measured minus the simulator without {c.name}. {told}".strip()
    title = f"{c.name}: {channel} against its load"
    return Chart(name, title, (panel,), caption=caption, note=note)


def _matrix(e: Evidence, c: Claim, name: str) -> Chart:
    """What each channel shows of each channel's load."""
    assert c.active is not None
    scene, effect, p = e.prepared.scene, c.active.effect, c.active.values
    load = scene.load
    shown = effect.read(scene, load, p) - load
    response = np.stack(
        [(effect.read(scene, load + d, p) - load - d - shown).mean(axis=0) for d in np.eye(6)],
        axis=1,
    )  # (6, 6): shows, of
    span = np.ptp(load[scene.held], axis=0)
    texts = tuple(
        tuple(_cross(i, j, float(response[i, j])) for j in range(6)) for i in range(6)
    )  # fmt: skip
    matrix = Matrix(CHANNELS, CHANNELS, response * span / e.std[:, None], _CROSS, texts)
    panel = Panel(Axis("of the load of"), Axis(""), matrix=matrix)
    caption = (
        "Down: the channel that shows it. Numbers: % between like channels, mm of torque from "
        "force, N per N·m of force from torque. Colours: its change over the loads of this "
        "recording, in units of the noise of a row."
    )
    return Chart(name, f"{c.name}: what each channel shows of another", (panel,), caption=caption)


def _cross(i: int, j: int, v: float) -> str:
    if abs(v) < ROUNDING:
        return "0"
    if (i < 3) == (j < 3):
        return f"{100 * v:.2f} %".replace("-", "−")
    return (f"{1e3 * v:.2f}" if i >= 3 else f"{v:.3f}").replace("-", "−")


# ---- time -----------------------------------------------------------------------------------


def _lag(e: Evidence, c: Claim, name: str) -> Chart | None:
    """Correlation of measured and simulated readings against a shift in time."""
    from scipy.interpolate import CubicSpline  # slow to load: only when it is used

    p, scene = e.prepared, e.prepared.scene
    if not scene.moving or e.after is None:
        return None
    t, k = scene.t[scene.held], largest(c.effect / e.std)[0]
    delay = float(c.active.values.get("delay", 0.0)) if c.active is not None else 0.0
    reach = max(LEAST_REACH * scene.period, 3.0 * abs(delay))
    lags = np.linspace(-reach, reach, 2 * LAGS + 1)
    inner = (t > t[0] + reach) & (t < t[-1] - reach)
    if inner.sum() < LAGS:
        return None
    y = p.y[:, k]
    without = e.after[:, k] - c.effect[:, k]
    series, rest = [], []
    readings: tuple[tuple[str, np.ndarray, Role], ...] = (
        ("without the effect", without, "before"),
        ("with the effect", e.after[:, k], "after"),
    )
    for label, reading, role in readings:
        shifted = CubicSpline(t, reading)
        moved = [shifted(t[inner] - lag) for lag in lags]
        like = np.array([np.corrcoef(y[inner], m)[0, 1] for m in moved])
        left = np.array([np.sqrt(np.mean((y[inner] - m) ** 2)) for m in moved]) / e.std[k]
        series.append(Series(label, "line", 1e3 * lags, like, role=role))
        rest.append(Series(label, "line", 1e3 * lags, left, role=role))
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
    found = c.active.effect.variable(scene, c.active.values)
    if found is None:
        return None
    rotation = value(scene.pose[0])[scene.held]
    made, seen = (apply(rotation, f[:, :3]) for f in (c.effect, c.measured))
    way = made.sum(axis=0)
    way = way / max(float(np.linalg.norm(way)), 1e-12)
    x = found.values[scene.held]
    order = np.argsort(x, kind="stable")
    std = np.full(len(x), float(np.mean(e.std[:3] * np.sqrt(e.prepared.noise[:3]))))
    series, note = thinned(
        [
            Series("simulated effect", "line", x[order], (made @ way)[order], role="after"),
            Series("measured", "points", x[order], (seen @ way)[order], std, ids=e.ids[order]),
        ]
    )  # fmt: skip
    panel = Panel(Axis(found.label, found.unit), Axis("force along the push", "N"), series,
                  zero=True, height=1.4)  # fmt: skip
    caption = f"Measured minus the simulator without {c.name}, in the direction that it pushes."
    return Chart(name, f"{c.name}: force over {found.label}", (panel,), caption=caption, note=note)


_OWN: Mapping[str, Callable[[Evidence, Claim, str], Chart | None]] = {
    "torque": _torque, "angle": _angle, "load": _load, "loop": _loop, "matrix": _matrix,
    "lag": _lag, "depth": _depth,
}  # fmt: skip
"""By `Effect.shown`; the others are drawn by `figures.of_claim` alone."""
