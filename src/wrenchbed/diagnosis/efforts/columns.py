"""Columns of one joint with free amplitudes: its drive effects, and what has no name.

Causes without a name (`outside`) have columns too: what these explain best is unknown.
"""

import numpy as np

from wrenchbed.channels.effort import ZERO
from wrenchbed.diagnosis.efforts.names import drive_effects
from wrenchbed.diagnosis.efforts.scene import COMMANDED, EffortScene
from wrenchbed.effects.drives.base import Block, Column, DriveRows, StatedNumber

FREE = 1e3
"""Prior of what every fit leaves free, in noises of a row: wide; estimate."""
BACKGROUND = 0.1
"""Rms of what any effect may add unnamed, in noises of a row: no robot is perfect; estimate."""
STRETCHES = 6
"""Stretches of time over which friction or offset may change in time; estimate."""
LIMITS = (0.5, 0.75, 0.9)
"""Quantiles of the torque from which it may be limited; estimate."""
ENDS = (0.15, 0.85)
"""Quantiles of the angle beyond which something may resist; estimate."""
_OFFSET, _ROTOR, _CONSTANT = "drive.offset", "drive.inertia", "drive.constant"


def of_joint(scene: EffortScene, j: int) -> tuple[list[Column], list[Block]]:
    """Columns and causes of joint j, from 0, but those whose shape a residual suggests."""
    rows = rows_of(scene, j)
    columns, blocks = list[Column](), list[Block]()
    if rows.command is not None:  # setpoints of limited speed trail by the square of the speed
        speed = np.gradient(rows.command, rows.t)
        columns.append(rows.column("setpoint", speed * np.abs(speed), free=True))
    for effect in drive_effects().values():
        some = effect.columns(rows)
        columns += some
        if (block := effect.block(rows, some)) is not None:
            blocks.append(block)
    for word, shapes in _forms(scene, rows).items():
        named, more = "." in word, [rows.column(name, shape) for name, shape in shapes.items()]
        columns += more
        names = (*[f"offset.{rows.joint}"] * named, *(c.name for c in more))
        blocks.append(Block(word, rows.joint, not named, names))
    return columns, blocks


def rows_of(scene: EffortScene, j: int) -> DriveRows:
    """What the drive effects of joint j, from 0, see."""
    q, known = scene.q, scene.drives.known("drive.coulomb")
    spread = {
        name: _spread(scene, j, effect)
        for name, effect in drive_effects().items()
        if isinstance(effect, StatedNumber)
    }
    free = frozenset(name for name, std in spread.items() if std is None)
    if spread[_CONSTANT] is None:
        spread[_CONSTANT] = 1.0
    warm = scene.recording.columns.get(f"joint_temperature{j + 1}")
    if warm is not None and not (np.isfinite(warm).all() and np.ptp(warm) > 0.0):
        warm = None
    return DriveRows(
        j + 1, scene.signals.t, scene.signals.rate, q.v[:, j], q.d[:, j], q.dd[:, j],
        scene.total[:, j], scene.body[:, j], scene.robot.joints[j].unit == "rad",
        abs(float(scene.levels[0, j])), bool(known[j]), spread, free, warm,
        scene.recording.columns.get(f"{COMMANDED}{j + 1}"),
    )  # fmt: skip


def _spread(scene: EffortScene, j: int, effect: StatedNumber) -> float | None:
    """Ordinary spread of a stated number, of a drive constant relative; None where nothing is
    stated."""
    drives, kind = scene.drives, effect.name
    if kind == _CONSTANT and not (scene.currents or scene.commanded):  # a torque sensor's is 1
        return effect.relative
    known, value = drives.known(kind)[j], abs(float(drives.of(kind)[j]))
    if kind in (_OFFSET, _ROTOR):  # where friction is stated no zero is, and the model's rotor
        known = known or drives.known("drive.coulomb")[j]
    value = float(scene.inertias.rotor[j]) if kind == _ROTOR else value
    least = ZERO * float(np.abs(scene.total[:, j]).max()) if kind == _OFFSET else 0.0
    spread = float(np.hypot(max(effect.relative * value, least), drives.std[kind][j]))
    return spread / (value if kind == _CONSTANT else 1.0) if known else None


def _forms(scene: EffortScene, rows: DriveRows) -> dict[str, dict[str, np.ndarray]]:
    """Columns of springs between links, beside a constant, then of torque errors for which the
    library has no name."""
    size, t = np.abs(rows.total), rows.t
    place = (t - t[0]) / (t[-1] - t[0]) * (STRETCHES - 1)
    hats = [np.maximum(1.0 - np.abs(place - k), 0.0) for k in range(1, STRETCHES)]
    way = 1.0 if rows.hinge else float(np.ptp(rows.angle)) / (2.0 * np.pi)
    turns = [(k, k * rows.angle / way) for k in (1, 2)]
    low, high = np.quantile(rows.angle, ENDS)
    others = [k for k in range(scene.joints) if k != rows.joint - 1]
    spring = {"sine": np.sin(rows.angle), "cosine": np.cos(rows.angle)}
    return {
        "link.cable": {"cable": rows.angle - rows.angle.mean()},
        **({"link.spring": spring} if rows.hinge else {}),
        "limited": {
            f"limit{k}": np.sign(rows.total) * np.maximum(size - at, 0.0)
            for k, at in enumerate(np.quantile(size, LIMITS))
        },
        "friction in time": {f"when{k}": rows.sign * hat for k, hat in enumerate(hats, start=1)},
        "offset in time": {f"drift{k}": hat for k, hat in enumerate(hats, start=1)},
        "friction by angle": {f"turnsine{k}": rows.sign * np.sin(turn) for k, turn in turns}
        | {f"turncosine{k}": rows.sign * np.cos(turn) for k, turn in turns},
        "friction by speed": {"square": rows.sign * rows.speed**2, "cube": rows.speed**3},
        "end of range": {
            "low": np.minimum(rows.angle - low, 0.0),
            "high": np.maximum(rows.angle - high, 0.0),
        },
        "torque of other joints": {f"of{k + 1}": scene.total[:, k] for k in others},
    }
