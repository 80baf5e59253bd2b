"""The contract of a drive effect: what it adds to the effort of its own joint, as columns.

Forms are bases rather than laws: friction against speed, load, angle and what happened since the
last reversal, so that a cause is found whose law is another one.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from wrenchbed.effects.drives.operators import direction, since_reversal


class Size(NamedTuple):
    """Size of an effect as people read it.

    Attributes:
        unit: of a hinge, SI.
        plausible: largest one of a fault with which the robot still runs, of a load the least one
            that its user asks about, over `Block.level`.
        absolute: whether that level is 1, not what the cause changes.
        columns: beginnings of the names of the columns whose amplitudes make it; all of the cause
            if empty.
        vector: whether it is their length, not their sum.
    """

    name: str
    unit: str
    plausible: float
    absolute: bool = False
    columns: tuple[str, ...] = ()
    vector: bool = False


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a channel (N,), or of all channels (N, C).

    Attributes:
        name: unique.
        data: at all rows.
        std: of its amplitude where it is not part of a named cause; None: small.
        free: whether every fit leaves it free.
    """

    name: str
    data: np.ndarray
    std: float | None = None
    free: bool = False


@dataclass(frozen=True, eq=False)
class Block:
    """Columns that one cause sets free together.

    Attributes:
        effect: its name; for what has none, a word of what it does.
        joint: from 1; None of the whole arm.
        outside: whether it has no name.
        value: at which its columns were made: a time, or periods a turn.
        prior: log odds beside other variants of the same effect.
        level: of what it changes: friction of the joint [N·m], mass [kg] or inertia [kg·m²] of the
            link or the tool; 1 where sizes are absolute.
    """

    effect: str
    joint: int | None
    outside: bool
    columns: tuple[str, ...]
    value: float = 1.0
    prior: float = 0.0
    level: float = 1.0

    @property
    def key(self) -> tuple[str, int | None]:
        """Effect and joint of the cause that a block is a variant of."""
        return self.effect, self.joint

    @property
    def slot(self) -> tuple[str, int | None]:
        """Causes of one slot exclude each other: a joint's delay and filter may cancel."""
        lag = self.effect in ("drive.delay", "drive.bandwidth")
        return "lag" if lag else self.effect, self.joint


@dataclass(frozen=True, eq=False)
class DriveRows:
    """Motion and predicted effort of one joint in time (N,), SI; on slides forces are torques.

    Attributes:
        joint: from 1.
        t, rate: times [s], and rows a second [Hz].
        total, body: predicted effort, and that of the rigid body alone.
        level: Coulomb friction, stated or fitted.
        is_stated: whether that is stated.
        spread: ordinary spread of stated numbers, by effect; None where nobody knows it.
        free: effects whose number nobody states, so that every fit leaves it free.
        warm: temperature of the drive [°C], if it was recorded and changes.
        command: where a servo's tracking error is its effort, the target times its stiffness
            (N,) [N·m]; None of measured efforts.
    """

    joint: int
    t: np.ndarray
    rate: float
    angle: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    total: np.ndarray
    body: np.ndarray
    hinge: bool
    level: float
    is_stated: bool
    spread: Mapping[str, float | None]
    free: frozenset[str]
    warm: np.ndarray | None = None
    command: np.ndarray | None = None

    @property
    def lagging(self) -> np.ndarray:
        """What lags (N,) where a drive does: the effort that is reported, or less a command."""
        return self.total if self.command is None else -self.command

    @cached_property
    def sign(self) -> np.ndarray:
        """Direction of motion (N,), that of before at rest."""
        return direction(self.speed)

    @cached_property
    def since(self) -> np.ndarray:
        """Way since the last reversal (N,)."""
        return since_reversal(self.angle, self.sign)

    def column(
        self, word: str, data: np.ndarray, std: float | None = None, *, free: bool = False
    ) -> Column:
        """A column of this joint."""
        return Column(f"{word}.{self.joint}", data, std or None, free)


@dataclass(frozen=True, eq=False)
class DriveResidual:
    """What the prediction of one joint leaves at the kept rows (M,), for effects with a shape.

    Attributes:
        y: measured less predicted effort.
        left: of y beside all columns, zero where no row counts.
        own: ordinary columns of the joint, but of a delay (M, K).
        thin: takes a column (N,) to the kept rows.
    """

    y: np.ndarray
    use: np.ndarray
    angle: np.ndarray
    left: np.ndarray
    own: np.ndarray
    thin: Callable[[np.ndarray], np.ndarray]

    @cached_property
    def basis(self) -> np.ndarray:
        """Orthonormal basis (n, K) of the ordinary columns at the n rows that count."""
        some = self.own[self.use]
        return np.linalg.qr(some / np.maximum(np.sqrt((some**2).mean(axis=0)), 1e-12))[0]


class DriveEffect(ABC):
    """One effect of a drive; the instance of a module is its constant ``EFFECT``."""

    name: ClassVar[str]
    title: ClassVar[str]
    """What happens, ``{joint}`` in the place of the joint's number; begins small."""
    size: ClassVar[Size]
    remedy: ClassVar[str] = ""
    """A recording that separates it from its usual rivals."""
    beside: ClassVar[tuple[str, ...]] = ()
    """Words of stated numbers that it sets free too, where they are stated."""
    one_way: ClassVar[bool] = False
    """Whether its size is never below zero: it can only add to friction, or be late."""

    def shapes(self, rows: DriveRows) -> Mapping[str, np.ndarray]:
        """What the effect adds to the effort (N,) at size 1, by the words of its columns; none
        where it does not show, or a residual suggests its shape."""
        return {}

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        """Columns that the effect adds; those with a standard deviation belong to every healthy
        drive and are no part of the cause."""
        return tuple(rows.column(word, shape) for word, shape in self.shapes(rows).items())

    def block(self, rows: DriveRows, columns: tuple[Column, ...]) -> Block | None:
        """The cause made of its columns; None where these rows have none."""
        names = tuple(c.name for c in columns if c.std is None)
        if not names:
            return None
        with_stated = tuple(f"{word}.{rows.joint}" for word in self.beside if rows.is_stated)
        return self.cause(rows, (*with_stated, *names))

    def cause(
        self, rows: DriveRows, columns: tuple[str, ...], value: float = 1.0, prior: float = 0.0
    ) -> Block:
        """A cause of this effect made of some columns, by their names."""
        level = 1.0 if self.size.absolute else rows.level
        return Block(self.name, rows.joint, False, columns, value, prior, level)

    def scan(
        self, rows: DriveRows, residual: DriveResidual
    ) -> tuple[tuple[Column, ...], Block] | None:
        """Columns and cause of the shape that a residual suggests; None of effects without one."""
        return None


class StatedNumber(DriveEffect):
    """A number of the drive that is stated, or that every fit leaves free."""

    word: ClassVar[str]
    """Name of its column, before the joint's number."""
    relative: ClassVar[float]
    """Standard deviation of ordinary errors of the stated value, relative."""

    @abstractmethod
    def shape(self, rows: DriveRows) -> np.ndarray:
        """Effort (N,) that one unit of the stated number adds."""

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        free = self.name in rows.free
        return (rows.column(self.word, self.shape(rows), rows.spread[self.name], free=free),)

    def block(self, rows: DriveRows, columns: tuple[Column, ...]) -> Block | None:
        if not self.judged(rows):
            return None
        return self.cause(rows, tuple(c.name for c in columns))

    def judged(self, rows: DriveRows) -> bool:
        """Whether another value is a cause."""
        return rows.is_stated
