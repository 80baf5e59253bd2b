"""What each cause adds to the torque of one joint, as columns with free amplitudes.

Forms are bases rather than laws: friction against speed, load, angle and what happened since the
last reversal, so that a cause is found whose law is another one. Causes without a name (`outside`)
have columns too: what these explain best is unknown.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.efforts.operators import direction, late, since_reversal, stop
from wrenchbed.diagnosis.efforts.scene import EffortScene

FRICTION_SPREAD = 0.05
"""Standard deviation of ordinary changes of stated friction, relative: estimate; warming apart."""
INERTIA_SPREAD = 0.05
"""Standard deviation of a stated rotor inertia, relative: estimate."""
ROUNDED = 3
"""Angles of `PRESLIDING` over which friction may lack or add its own level: nobody states
bristles."""
OFFSET_SPREAD = 0.02
"""Standard deviation of a constant torque, over the largest predicted one: estimate."""
CONSTANT_SPREAD = 0.01
"""Standard deviation of a drive constant or a torque sensor's gain, relative: estimate."""
FREE = 1e3
"""Prior of what every fit leaves free, in noises of a row: wide; estimate."""
BACKGROUND = 0.1
"""Rms of what any effect may add unnamed, in noises of a row: no robot is perfect; estimate."""
STRIBECK = (0.02, 0.06, 0.15)
"""Speeds over which friction falls [rad/s, m/s]; estimate, UR joints fall within 0.02 to 0.1."""
PRESLIDING = (3e-4, 1e-3, 3e-3, 1e-2, 4e-2)
"""Ways after a reversal over which friction builds up or breaks away [rad, m]; estimate."""
WIDTHS = (1e-2, 3e-2, 1e-1)
"""Half widths of a gear's hysteresis that are tried [rad, m]; estimate."""
LATE = 2e-3
"""Ordinary delay of one joint's effort beside the others', one standard deviation [s]: estimate,
controllers report within 2 to 8 ms."""
STRETCHES = 6
"""Stretches of time over which friction or offset may change in time; estimate."""
LIMITS = (0.5, 0.75, 0.9)
"""Quantiles of the torque from which it may be limited; estimate."""
ENDS = (0.15, 0.85)
"""Quantiles of the angle beyond which something may resist; estimate."""


_RESISTS = {"drive.hysteresis": "stop", "drive.stiction": "since", "drive.stribeck": "stribeck"}
"""Beginning of the names of the columns whose sum is the size of an effect that only resists."""


@dataclass(frozen=True, eq=False)
class Block:
    """Columns that one cause sets free together.

    Attributes:
        effect: its name; for what has none, a word of what it does.
        joint: from 1; None of the whole arm.
        outside: whether it has no name.
        columns: names of its columns.
        value: what a column's amplitude is times, to be the effect's size.
        prior: log odds beside other variants of the same effect.
    """

    effect: str
    joint: int | None
    outside: bool
    columns: tuple[str, ...]
    value: float = 1.0
    prior: float = 0.0

    @property
    def key(self) -> tuple[str, int | None]:
        """Effect and joint of the cause that a block is a variant of."""
        return self.effect, self.joint

    @property
    def resists(self) -> tuple[str, ...]:
        """Columns whose amplitudes add up to more friction, not less; none of most effects.

        Friction that builds up after a reversal is hysteresis, and friction that fades is
        stiction: alike but for their sign.
        """
        start = _RESISTS.get(self.effect)
        return () if start is None else tuple(n for n in self.columns if n.startswith(start))


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a channel (N,), or of all channels (N, C).

    Attributes:
        name: unique.
        data: at all rows.
        std: of its amplitude where it is not part of a named cause; None: `BACKGROUND`.
        free: whether every fit leaves it free.
    """

    name: str
    data: np.ndarray
    std: float | None = None
    free: bool = False


def of_joint(scene: EffortScene, j: int) -> tuple[list[Column], list[Block]]:
    """Columns and causes of joint j, from 0."""
    made = _Joint(scene, j)
    columns = [*made.stated(), *made.named(), *made.unnamed()]
    names = {c.name for c in columns}
    return columns, [b for b in made.blocks() if set(b.columns) <= names]


class _Joint:
    """One joint of a scene."""

    def __init__(self, scene: EffortScene, j: int) -> None:
        self.scene, self.j = scene, j
        q = scene.q
        self.angle, self.speed, self.acceleration = q.v[:, j], q.d[:, j], q.dd[:, j]
        self.sign = direction(self.speed)
        self.hinge = scene.robot.joints[j].unit == "rad"
        self.way = 1.0 if self.hinge else float(np.ptp(self.angle)) / (2.0 * np.pi)
        self.total, self.body = scene.total[:, j], scene.body[:, j]
        self.since = since_reversal(self.angle, self.sign)
        stated = scene.drives.value["drive.coulomb"][j]
        self.is_stated = bool(np.isfinite(stated))
        moving = np.abs(self.sign) > 0.0
        fitted = float(np.median((scene.friction[:, j] * self.sign)[moving]))
        self.offset = OFFSET_SPREAD * float(np.abs(self.total).max())
        self.level = abs(float(stated)) if self.is_stated else abs(fitted)

    def name(self, text: str) -> str:
        return f"{text}.{self.j + 1}"

    def column(
        self, text: str, data: np.ndarray, std: float | None = None, *, free: bool = False
    ) -> Column:
        return Column(self.name(text), data, std or None, free)

    def spread(self, kind: str, relative: float, least: float = 0.0) -> float | None:
        """Ordinary spread of a stated value; None where nothing is stated."""
        drives = self.scene.drives
        if not drives.known(kind)[self.j]:
            return None
        own = relative * abs(float(drives.value[kind][self.j]))
        return float(np.sqrt(max(own, least) ** 2 + drives.std[kind][self.j] ** 2))

    @property
    def gain(self) -> float | None:
        """Ordinary spread of the gain from what is measured to a torque, relative; None where a
        drive constant is fitted."""
        drives, kind = self.scene.drives, "drive.constant"
        if not self.scene.currents:
            return CONSTANT_SPREAD
        if not drives.known(kind)[self.j]:
            return None
        return float(np.hypot(CONSTANT_SPREAD, drives.std[kind][self.j] / drives.of(kind)[self.j]))

    def stated(self) -> Iterator[Column]:
        """Columns of the stated drive parameters, free or within the spread of their stated
        values."""
        forms = (
            ("coulomb", self.sign, FRICTION_SPREAD, 0.0),
            ("viscous", self.speed, FRICTION_SPREAD, 0.0),
            ("offset", np.ones_like(self.speed), FRICTION_SPREAD, self.offset),
        )
        for kind, data, relative, least in forms:
            spread = self.spread(f"drive.{kind}", relative, least)
            if spread is None and self.is_stated and kind == "offset":
                spread = self.offset
            yield self.column(kind, data, spread, free=spread is None)
        spread = self.spread("drive.inertia", INERTIA_SPREAD)
        if spread is None and self.is_stated:  # a motor without a rotor has none to be wrong
            spread = INERTIA_SPREAD * float(self.scene.inertias.rotor[self.j])
        yield self.column("inertia", self.acceleration, spread, free=spread is None)
        yield self.column("constant", self.total, self.gain or 1.0, free=self.gain is None)

    def named(self) -> Iterator[Column]:
        """Columns of the drive effects that have a name in the library."""
        for k, width in enumerate(PRESLIDING):
            shape = self.sign * np.exp(-self.since / width)
            yield self.column(f"since{k}", shape, self.level if k < ROUNDED else None)
        for k, speed in enumerate(STRIBECK):
            yield self.column(f"stribeck{k}", self.sign * np.exp(-np.abs(self.speed) / speed))
        yield self.column("load", self.sign * np.abs(self.body))
        yield self.column("loadspeed", self.speed * np.abs(self.body))
        for k, width in enumerate(WIDTHS):
            yield self.column(f"stop{k}", stop(self.angle, width) - self.sign)
        yield self.column("asymmetry", np.abs(self.speed))
        middle = self.angle - self.angle.mean()
        yield self.column("cable", middle)
        if self.hinge:
            yield self.column("sine", np.sin(self.angle))
            yield self.column("cosine", np.cos(self.angle))
        yield self.column("late", late(self.total, self.scene.signals.t, LATE), 1.0)
        warm = self.scene.recording.columns.get(f"joint_temperature{self.j + 1}")
        if warm is not None and np.isfinite(warm).all() and np.ptp(warm) > 0.0:
            above = warm - warm[0]
            yield self.column("warmcoulomb", self.sign * above)
            yield self.column("warmviscous", self.speed * above)

    def unnamed(self) -> Iterator[Column]:
        """Columns of torque errors for which the library has no name."""
        size = np.abs(self.total)
        for k, at in enumerate(np.quantile(size, LIMITS)):
            yield self.column(f"limit{k}", np.sign(self.total) * np.maximum(size - at, 0.0))
        t = self.scene.signals.t
        place = (t - t[0]) / (t[-1] - t[0]) * (STRETCHES - 1)
        for k in range(1, STRETCHES):  # the first is the others' complement
            hat = np.maximum(1.0 - np.abs(place - k), 0.0)
            yield self.column(f"when{k}", self.sign * hat)
            yield self.column(f"drift{k}", hat)
        for k in (1, 2):
            turn = k * self.angle / self.way
            yield self.column(f"turnsine{k}", self.sign * np.sin(turn))
            yield self.column(f"turncosine{k}", self.sign * np.cos(turn))
        yield self.column("square", self.sign * self.speed**2)
        yield self.column("cube", self.speed**3)
        low, high = np.quantile(self.angle, ENDS)
        yield self.column("low", np.minimum(self.angle - low, 0.0))
        yield self.column("high", np.maximum(self.angle - high, 0.0))
        for k in range(self.scene.joints):
            if k != self.j:
                yield self.column(f"of{k + 1}", self.scene.total[:, k])

    def blocks(self) -> Iterator[Block]:
        """Causes of this joint; those whose columns are missing are left out by the caller."""
        if self.is_stated:
            yield self.block("drive.coulomb", ("coulomb",))
            yield self.block("drive.viscous", ("viscous",))
            yield self.block("drive.inertia", ("inertia",))
        if self.gain is not None:
            yield self.block("drive.constant", ("constant",))
        yield self.block("drive.stribeck", _some("stribeck", len(STRIBECK)))
        yield self.block("drive.load", ("load", "loadspeed"))
        yield self.block("drive.temperature", ("warmcoulomb", "warmviscous"))
        loop = _some("stop", len(WIDTHS))
        yield self.block("drive.hysteresis", ("coulomb", *loop) if self.is_stated else loop)
        yield self.block("drive.asymmetry", ("offset", "asymmetry") if self.is_stated
                         else ("asymmetry",))  # fmt: skip
        yield self.block("drive.stiction", _some("since", len(PRESLIDING))[ROUNDED:])
        yield self.block("link.cable", ("offset", "cable"))
        yield self.block("link.spring", ("offset", "sine", "cosine"))
        crossed = [f"of{k + 1}" for k in range(self.scene.joints) if k != self.j]
        for word, columns in (
            ("limited", _some("limit", len(LIMITS))),
            ("friction in time", tuple(f"when{k}" for k in range(1, STRETCHES))),
            ("offset in time", tuple(f"drift{k}" for k in range(1, STRETCHES))),
            ("friction by angle", ("turnsine1", "turncosine1", "turnsine2", "turncosine2")),
            ("friction by speed", ("square", "cube")),
            ("end of range", ("low", "high")),
            ("torque of other joints", tuple(crossed)),
        ):
            yield Block(word, self.j + 1, True, tuple(self.name(c) for c in columns))

    def block(self, effect: str, columns: Sequence[str]) -> Block:
        return Block(effect, self.j + 1, False, tuple(self.name(c) for c in columns))


def _some(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}{k}" for k in range(count))
