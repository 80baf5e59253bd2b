"""Effects that joint efforts show, of drives (from the registry), links, tool and base, and their
regressor columns: of each joint, each wrench channel, and the whole arm.

Unnamed causes (`Block.outside`) have columns too: if they explain best, the verdict is ``unknown``.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import polar

from wrenchbed import registry
from wrenchbed.channels.effort import TARED, ZERO
from wrenchbed.channels.holding_torques import LINK_CENTRE, LINK_MASS
from wrenchbed.diagnosis.efforts.errors_of_fit import SAME, beside_fit
from wrenchbed.diagnosis.efforts.scene import EffortScene
from wrenchbed.diagnosis.efforts.stated_drives import COMMANDED
from wrenchbed.diagnosis.explain.verdict import Key
from wrenchbed.diagnosis.prepare.bias_and_load_fit import COG_M, MASS_SHARE, states_tool
from wrenchbed.drives.identify import load_torques
from wrenchbed.drives.servo import DELAY
from wrenchbed.effects.drives.base import Block, Column, DriveEffect, DriveRows, Size, StatedNumber
from wrenchbed.effects.drives.operators import late, slow
from wrenchbed.physics.rigid_load_regressor import INERTIAL
from wrenchbed.physics.wrench import CHANNELS, of_mass, of_moment
from wrenchbed.robots.base import INERTIA_AXES

FREE = 1e3
"""Prior rms of an amplitude that every fit leaves free, over a row's noise std: no restriction."""
BACKGROUND = 0.1
"""Prior rms that each effect may add without being claimed, over a row's noise std: no robot is
perfect. Its square is a hundredth of the gap of 1 from which a cause counts."""
STRETCHES = 6
"""Number of knots in time between which a friction or offset may change linearly: enough for a
warm-up within some minutes, few enough that each amplitude is determined."""
LIMITS = (0.1, 0.25, 0.4, 0.6, 0.75, 0.9)
"""Quantiles of the effort beyond which it may be limited, at either end: between them the robot
would hardly run."""
REACHED = (0.01, 0.99)
"""Quantiles of the measured effort that stand for its limits, if it has any: single outliers lie
beyond."""
ENDS = (0.15, 0.85)
"""Quantiles of a joint's value beyond which something may resist motion: near the ends it used."""
LIGHT = 0.01
"""Least tool mass [kg] by which a first moment is divided: a lighter one weighs below 0.1 N."""
_GAIN = 0.01
"""Prior std of a gain's error, and of crosstalk among forces or among moments (ratio): about ATI's
stated 0.75 to 1.5 % of full scale."""
_TILT = np.deg2rad(0.1)
"""Prior std of a healthy robot's base tilt [rad]: what a bubble level leaves."""
_ANY_AXIS = 1e-9
"""Added to a change of gravity [m/s²], so that none, or one upside down, has a tilt's axis too."""
_LINK_INERTIA = 0.05
"""Prior std of a link's inertia over its mean principal one: drawings lack cables and covers."""
_GYRATION = 0.02
"""Least radius of gyration of a link [m], for files without inertias: that of a ball of 6 cm."""
_STEP = 1e-4
"""Finite-difference steps in mass [kg] and first moment [kg·m] for the wrench's columns: small,
since the wrench is linear in both but for the square of the centre of gravity."""
_LATE = 4e-3
"""Finite-difference step for columns of a delay or lag [s]: half a row at 125 Hz, still linear."""
_NOTHING = 1e-9
"""Largest value of a column, over that of the largest column, up to which it is rounding: a larger
limit drops small but real causes, a smaller one than 1e-15 keeps rounding of doubles as a cause."""
_LAST = -2.0
"""Log prior odds of a fault of the last link against one of the tool that hangs on it: tools change
daily, links do not (1 : 7)."""
_REBUILT = -2.0
"""Log prior odds of a link that changed since a healthy fit of the arm, against a wrong model."""
_OFFSET, _ROTOR, _CONSTANT = "drive.offset", "drive.inertia", "drive.constant"
_SERVO_DELAY = 5e-4
"""Ordinary change of a fitted servo's delay from one day to another [s]: half a cycle of a bus at
1 kHz; estimate."""
_RANGE = "record the joint over its whole range, which tells a cable from a spring"
_REACH = "record poses with the arm stretched and folded, at rest in both directions"
Made = tuple[list[Column], list[Block]]
"""Regressor columns, and the causes, each of which frees the amplitudes of some of them."""


class Carried(NamedTuple):
    """Effect of links, tool or base: title, definition of its size, and how to tell its rivals."""

    title: str
    size: Size
    remedy: str = ""


OTHERS: Mapping[str, Carried] = {
    "link.mass": Carried("the mass of link {joint} differs from the model",
                         Size("mass", "kg", 0.5), _REACH),
    "link.cog": Carried("the centre of gravity of link {joint} differs from the model",
                        Size("moment", "kg·m", 0.05, vector=True), _REACH),
    "link.inertia": Carried("the inertia of link {joint} differs from the model",
                            Size("inertia", "kg·m²", 1.0, vector=True)),
    "link.cable": Carried("a cable bundle pulls at joint {joint} like a spring",
                          Size("stiffness", "N·m/rad", 2.0, columns=("cable",)), _RANGE),
    "link.spring": Carried(
        "the spring that balances gravity at joint {joint} is wrong",
        Size("amplitude", "N·m", 2.0, columns=("sine", "cosine"), vector=True), _RANGE,
    ),
    "tool.mass": Carried("the tool's mass differs from its stated value",
                         Size("mass", "kg", 0.25),
                         "weigh the tool, or record the same motion without it"),
    "tool.cog": Carried("the tool's centre of gravity differs from its stated place",
                        Size("distance", "m", 0.02, vector=True),
                        "record the same motion without the tool"),
    "base.tilt": Carried("the base is tilted",
                         Size("angle", "rad", float(np.deg2rad(5.0)), vector=True),
                         "put a level on the base, or record with joint 1 in several directions"),
}  # fmt: skip
"""Effects without a file of their own, by name; ``{joint}`` is the joint's or link's number."""


@cache
def drive_effects() -> Mapping[str, DriveEffect]:
    """All drive effects by name."""
    return {name: registry.load("drives", name) for name in registry.names("drives")}


@cache
def all_effects() -> Mapping[str, DriveEffect | Carried]:
    """Descriptions by name of all effects of drives, and of links, tool and base."""
    return {**drive_effects(), **OTHERS}


def place(key: Key) -> str:
    """Place of an effect as text: ``joint 2``, ``link 3``; without a joint ``tool`` or ``base``."""
    part = key[0].split(".")[0]
    return part if key[1] is None else f"{'link' if part == 'link' else 'joint'} {key[1]}"


def title(effect: str, joint: int | None) -> str:
    """Description of an effect with its joint's number, from 1, in lower case."""
    return all_effects()[effect].title.format(joint=joint)


def of_joint(scene: EffortScene, rows: DriveRows) -> Made:
    """Columns (effort per unit of a parameter) and causes of a joint, but those that scans add."""
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
        blocks.append(Block(word, rows.joint, not named, names, level=rows.level))
    return columns, blocks


def rows_of(scene: EffortScene, j: int) -> DriveRows:
    """Input of the drive effects for joint j, from 0: motion, predicted effort, stated numbers."""
    q, known = scene.q, scene.drives.known("drive.coulomb")
    spread = {
        name: _spread(scene, j, effect)
        for name, effect in drive_effects().items()
        if isinstance(effect, StatedNumber)
    }
    free = frozenset(name for name, std in spread.items() if std is None)
    if spread[_CONSTANT] is None:
        spread[_CONSTANT] = 1.0
    if scene.drives.known(DELAY)[j]:
        spread["drive.delay"] = float(np.hypot(_SERVO_DELAY, scene.drives.std[DELAY][j]))
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
    """Standard deviation, in healthy robots, of a stated number of joint j, from 0 (a ratio for a
    drive constant); None if it is not stated."""
    drives, kind = scene.drives, effect.name
    if kind == _CONSTANT and not (scene.currents or scene.commanded):  # a torque sensor's is 1
        return effect.relative * (SAME if scene.drives.by_errors else 1.0)
    known, value = drives.known(kind)[j], abs(float(drives.of(kind)[j]))
    zero = TARED if known else ZERO  # a constant torque that is stated was measured
    if kind in (_OFFSET, _ROTOR):  # where friction is stated no zero is, and the model's rotor
        known = known or drives.known("drive.coulomb")[j]
    value = float(scene.inertias.rotor[j]) if kind == _ROTOR else value
    least = zero * float(np.abs(scene.total[:, j]).max()) if kind == _OFFSET else 0.0
    spread = float(np.hypot(max(effect.relative * value, least), drives.std[kind][j]))
    return spread / (value if kind == _CONSTANT else 1.0) if known else None


def _forms(scene: EffortScene, rows: DriveRows) -> dict[str, dict[str, np.ndarray]]:
    """Columns (N,) by name, by cause: cables and springs between links, then shapes of torque
    errors that are no effect of the library, as "offset in time"."""
    middle = np.median(rows.total)
    hats = _hats(rows.t)
    way = 1.0 if rows.hinge else float(np.ptp(rows.angle)) / (2.0 * np.pi)
    turns = [(k, k * rows.angle / way) for k in (1, 2)]
    low, high = np.quantile(rows.angle, ENDS)
    least, most = np.quantile(scene.measured[:, rows.joint - 1], REACHED)
    others = [k for k in range(scene.joints) if k != rows.joint - 1]
    spring = {"sine": np.sin(rows.angle), "cosine": np.cos(rows.angle)}
    return {
        "link.cable": {"cable": rows.angle - rows.angle.mean()},
        **({"link.spring": spring} if rows.hinge else {}),
        "torque limit": {
            f"limit{k}": (np.maximum if at > middle else np.minimum)(rows.total - at, 0.0)
            for k, at in enumerate(np.quantile(rows.total, LIMITS))
        }
        | {
            "least": np.minimum(rows.total - least, 0.0),
            "most": np.maximum(rows.total - most, 0.0),
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


def _hats(t: np.ndarray) -> list[np.ndarray]:
    """Overlapping triangles at times t (N,), one array for each of `STRETCHES` but the first."""
    place = (t - t[0]) / (t[-1] - t[0]) * (STRETCHES - 1)
    return [np.maximum(1.0 - np.abs(place - k), 0.0) for k in range(1, STRETCHES)]


def of_sensor(scene: EffortScene, channel: int) -> Made:
    """Columns of one wrench channel, from 0, and causes that are no named effect of joint efforts.

    Tool and tilt have columns in all channels, so that torques and wrench are evidence together.
    Errors of the sensor alone get columns without a name; a diagnosis of the wrench names them.
    """
    total, t, name = scene.load, scene.signals.t, CHANNELS[channel]
    alike = range(3) if channel < 3 else range(3, 6)
    columns = [
        Column(f"bias.{name}", np.ones(len(t)), free=True),
        Column(f"late.{name}", late(total[:, channel], t, _LATE), free=True),
    ]
    parts = {
        "gain": [Column(f"gain.{name}.{CHANNELS[k]}", total[:, k], _GAIN) for k in alike],
        "zero in time": [
            Column(f"drift.{name}.{k}", hat) for k, hat in enumerate(_hats(t), start=1)
        ],
        "crosstalk": [
            Column(f"of.{name}.{CHANNELS[k]}", total[:, k]) for k in range(6) if k not in alike
        ],
    }
    number = scene.joints + 1 + channel
    blocks = [Block(w, number, True, tuple(c.name for c in some)) for w, some in parts.items()]
    return columns + [c for some in parts.values() for c in some], blocks


def of_arm(scene: EffortScene) -> Made:
    """Columns (N, C), change of C channels per unit, and causes of an arm's links, tool, base."""
    columns, blocks = _links(scene)
    columns += [] if scene.commanded else _lag(scene)  # rows hold what was told and reached
    unseen = np.zeros((len(scene.signals.t), len(scene.channels) - scene.joints))
    columns = [replace(c, data=np.hstack([c.data, unseen])) for c in columns]
    for more, causes in (_tool(scene), _tilt(scene)):
        columns += more
        blocks += causes
    if scene.drives.by_errors:
        columns = beside_fit(scene, columns)
    largest = {c.name: float(np.abs(c.data).max()) for c in columns}
    seen = {name for name, size in largest.items() if size > _NOTHING * max(largest.values())}
    visible = [replace(b, columns=tuple(n for n in b.columns if n in seen)) for b in blocks]
    return [c for c in columns if c.name in seen], visible


def _links(scene: EffortScene) -> Made:
    columns, blocks = list[Column](), list[Block]()
    for k in np.flatnonzero(scene.inertias.phi[:, 0] > 0.0).tolist():
        phi, y = scene.inertias.phi[k], scene.regressor[..., INERTIAL * k : INERTIAL * (k + 1)]
        mass, cog = phi[0], phi[1:4] / max(phi[0], 1e-9)
        last = k == scene.robot.carrier  # the tool hangs on it, and is the more likely cause
        moments = [of_moment(cog, axis) for axis in np.eye(3)]
        about = float(phi[4:7].sum()) - 2.0 * float(phi[1:4] @ phi[1:4]) / mass  # its CoG
        inertia = max(about / 3.0, mass * _GYRATION**2)  # mean principal one
        for kind, ends, forms, level, std in (
            ("mass", ("mass",), [of_mass(cog)], mass, LINK_MASS),
            ("cog", "xyz", moments, mass, LINK_CENTRE),
            ("inertia", INERTIA_AXES, np.eye(INERTIAL)[4:], inertia, _LINK_INERTIA),
        ):
            names = tuple(f"link.{kind}.{k + 1}.{end}" for end in ends)
            both = zip(names, forms, strict=True)
            columns += [Column(n, y @ form, std * level) for n, form in both]
            prior = _LAST * last + _REBUILT * bool(scene.drives.by_errors)
            blocks.append(Block(f"link.{kind}", k + 1, False, names, prior=prior, level=level))
    return columns, blocks


def _tool(scene: EffortScene) -> Made:
    """Columns and causes of the tool's mass and first moment; free where they are not stated."""
    y = load_torques(scene.regressor, scene.robot, scene.theta)
    cog, mass = np.asarray(scene.tool.cog, dtype=float), float(scene.tool.mass)
    known = tuple(states_tool(scene.recording).values())
    middle = cog + scene.displaced / 2.0

    def seen(form: np.ndarray, at: np.ndarray, moved: np.ndarray, more: float) -> np.ndarray:
        """Change of all channels (N, C) per mass ``more`` [kg] and first moment ``moved`` (3,)
        [kg·m] at the CoG ``at`` (3,) [m]; ``form`` (10,): both as inertial parameters."""
        places = at, at + _STEP * moved / max(mass, LIGHT)
        now, then = (
            scene.sensed(scene.robot.theta_of_tool(scene.theta, m, [float(c) for c in place]))
            for m, place in zip((mass, mass + _STEP * more), places, strict=True)
        )
        return np.hstack([y @ form, (then - now) / _STEP])

    fit = scene.drives.load
    mass_std, *cog_std = (np.zeros(4) if fit is None else fit[1]).tolist()
    std = float(np.hypot(MASS_SHARE * mass, mass_std)) if known[0] else None
    columns = [Column("tool.mass", seen(of_mass(cog), cog, np.zeros(3), 1.0), std, not known[0])]
    for name, axis, off in zip("xyz", np.eye(3), cog_std, strict=True):
        std = float(np.hypot(COG_M, off)) * max(mass, 1.0) if known[1] else None
        data = seen(of_moment(middle, axis), middle, axis, 0.0)
        columns.append(Column(f"tool.cog.{name}", data, std, not known[1]))
    names = tuple(c.name for c in columns)
    return columns, [
        Block("tool.mass", None, False, names[:1] if known[0] else (), level=mass),
        Block("tool.cog", None, False, names[1:] if known[1] else ()),
    ]


def _lag(scene: EffortScene) -> list[Column]:
    """Columns of a delay and a filter common to all joints: fitted, but never named as a cause."""
    t, rate = scene.signals.t, scene.signals.rate
    delayed = np.stack([late(x, t, _LATE) for x in scene.total.T], axis=-1)
    filtered = np.stack([slow(x, rate, _LATE) for x in scene.total.T], axis=-1)
    return [Column("common.delay", delayed, free=True), Column("common.lag", filtered, free=True)]


def _tilt(scene: EffortScene) -> Made:
    gravity = np.asarray(scene.model.gravity, dtype=float)
    down, stated = gravity / np.linalg.norm(gravity), gravity - scene.turned
    side = np.eye(3)[int(np.argmin(np.abs(down)))]
    axis = np.cross(down, scene.turned + _ANY_AXIS * side)
    axis /= np.linalg.norm(axis)
    about = np.array([axis, np.cross(down, axis)])
    changes = np.cross(about, gravity)  # for 1 rad
    if scene.turned.any():  # a large tilt is about one axis: its column is exact at that size
        angle = np.arctan2(np.linalg.norm(np.cross(stated, down)), stated @ down)
        changes[0] = scene.turned / angle
    level = np.delete(np.arange(3), np.argmax(np.abs(down)))  # axes of the base to name
    each = zip(level, polar(about[:, level])[0].T @ changes, strict=True)
    columns = [Column(f"base.tilt.{'xyz'[k]}", scene.by_gravity(g), _TILT) for k, g in each]
    return columns, [Block("base.tilt", None, False, tuple(c.name for c in columns))]
