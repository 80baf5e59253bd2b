"""The contract of a drive effect: what it adds to the effort of its own joint, as columns.

Forms are bases rather than laws: friction against speed, load, angle and what happened since the
last reversal, so that a cause is detected whose law is another one.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np

from wrenchbed.effects.drives.operators import direction, since_reversal


class Size(NamedTuple):
    """How a drive effect's published size follows from the fitted amplitudes of its regressors.

    Attributes:
        unit: SI, for a hinge.
        plausible: largest size with which a robot still runs, over the joint's `Block.level` (its
            friction …); of a wrong load the least size that a user asks about.
        absolute: whether that level is 1, so that ``plausible`` is in ``unit``.
        columns: prefixes of the names of the regressors that make the size; all if empty.
        vector: whether the size is the norm of the amplitudes, not their sum.
    """

    name: str
    unit: str
    plausible: float
    absolute: bool = False
    columns: tuple[str, ...] = ()
    vector: bool = False


@dataclass(frozen=True, eq=False)
class Column:
    """One regressor with a fitted amplitude, of one joint's effort (N,), or of all joints (N, C).

    Attributes:
        data: values at all N rows.
        std: prior standard deviation of the amplitude in healthy robots; None: a small one.
        free: whether every fit leaves its amplitude free.
    """

    name: str
    data: np.ndarray
    std: float | None = None
    free: bool = False


@dataclass(frozen=True, eq=False)
class Block:
    """A possible cause: the columns whose amplitudes are fitted together if it is assumed.

    Attributes:
        effect: name of the effect; without a name, words for what it does.
        joint: its number from 1; None for the whole arm.
        outside: whether no effect of the library describes the cause.
        columns: their names.
        value: number at which columns were made: a time [s], periods a turn; 1 if they need none.
        prior: log odds against other blocks of the same effect and joint.
        level: scale of what it changes: friction of the joint [N·m], mass [kg] or inertia [kg·m²]
            of the link or the tool; 1 if sizes are absolute.
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
        """Effect and joint: blocks with the same key are forms of one cause."""
        return self.effect, self.joint


@dataclass(frozen=True, eq=False)
class DriveRows:
    """Motion, predicted effort of one joint in N rows (N,), SI; a slide's force counts as torque.

    Attributes:
        joint: its number from 1.
        t, rate: times [s], and rows per second [Hz].
        total, body: predicted effort, and that of the rigid body alone.
        hinge: whether the joint is rotary, not a slide (prismatic).
        level: Coulomb friction of the joint, stated or fitted.
        is_stated: whether the recording states it.
        spread: standard deviation of stated numbers in healthy robots, by effect; None if unstated.
        free: effects with an unstated number, which every fit leaves free.
        warm: temperature of the drive [°C], if it was recorded and changes.
        command: target times stiffness [N·m], if the effort is a servo's tracking error.
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
        """Signal (N,) that is late if the drive is: the reported effort, or minus the command."""
        return self.total if self.command is None else -self.command

    @cached_property
    def sign(self) -> np.ndarray:
        """Direction of motion (N,), −1 or 1; at rest that before the rest."""
        return direction(self.speed)

    @cached_property
    def since(self) -> np.ndarray:
        """Distance (N,) [rad or m] moved since the last reversal; inf before the first one."""
        return since_reversal(self.angle, self.sign)

    def column(
        self, word: str, data: np.ndarray, std: float | None = None, *, free: bool = False
    ) -> Column:
        """Make a regressor ``word.joint`` of data (N,); ``std``: prior; ``free``: in every fit."""
        return Column(f"{word}.{self.joint}", data, std or None, free)


@dataclass(frozen=True, eq=False)
class DriveResidual:
    """Residual of one joint's effort at M of N rows, for the search `DriveEffect.scan`.

    Attributes:
        y: measured minus predicted effort (M,).
        use: whether each row is used (M,), boolean.
        left: residual of y after a fit of all columns (M,), zero where not used.
        own: columns of friction and the like, which every joint has, without a delay's (M, K).
        thin: function that filters a column (N,) and picks the M rows of it.
    """

    y: np.ndarray
    use: np.ndarray
    angle: np.ndarray
    left: np.ndarray
    own: np.ndarray
    thin: Callable[[np.ndarray], np.ndarray]

    @cached_property
    def basis(self) -> np.ndarray:
        """Orthonormal basis (n, K) of the columns `own` at the n rows used."""
        some = self.own[self.use]
        return np.linalg.qr(some / np.maximum(np.sqrt((some**2).mean(axis=0)), 1e-12))[0]


class DriveEffect(ABC):
    """One effect of a drive; each plug-in module holds an instance ``EFFECT``."""

    name: ClassVar[str]
    title: ClassVar[str]
    """What happens, ``{joint}`` in the place of the joint's number; begins small."""
    size: ClassVar[Size]
    remedy: ClassVar[str] = ""
    """Advice: a recording that separates the effect from its usual rivals."""
    beside: ClassVar[tuple[str, ...]] = ()
    """Column names (``coulomb`` …) of stated numbers that the cause leaves free as well."""
    one_way: ClassVar[bool] = False
    """Whether its size is never below zero: it can only add to friction, or be late."""

    def shapes(self, rows: DriveRows) -> Mapping[str, np.ndarray]:
        """Effort (N,) that each regressor of the effect adds at amplitude 1, by its name; empty if
        the motion can show none."""
        return {}

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        """Regressors that the effect adds to a fit; those with a standard deviation belong to every
        healthy drive, not to the cause."""
        return tuple(rows.column(word, shape) for word, shape in self.shapes(rows).items())

    def block(self, rows: DriveRows, columns: tuple[Column, ...]) -> Block | None:
        """Cause that frees those ``columns`` of the effect that have no prior; None if none has."""
        names = tuple(c.name for c in columns if c.std is None)
        if not names:
            return None
        with_stated = tuple(f"{word}.{rows.joint}" for word in self.beside if rows.is_stated)
        return self.cause(rows, (*with_stated, *names))

    def cause(
        self, rows: DriveRows, columns: tuple[str, ...], value: float = 1.0, prior: float = 0.0
    ) -> Block:
        """Make a cause of this effect from names of columns, the ``value`` at which they were made
        (a time [s], periods a turn) and ``prior`` log odds against its other forms."""
        level = 1.0 if self.size.absolute else rows.level
        return Block(self.name, rows.joint, False, columns, value, prior, level)

    def shows(self, rows: DriveRows) -> bool:
        """Whether a diagnosis looks for the effect in ``rows``; by default in all."""
        return True

    def scan(
        self, rows: DriveRows, residual: DriveResidual
    ) -> tuple[tuple[Column, ...], Block] | None:
        """Regressors and cause with a lag or period searched on a residual; None if it has none."""
        return None


class StatedNumber(DriveEffect):
    """Error of a drive parameter that the metadata state; where unstated, every fit frees it."""

    word: ClassVar[str]
    """Name of its column, before the joint's number."""
    relative: ClassVar[float]
    """Standard deviation of ordinary errors of the stated value, relative."""

    @abstractmethod
    def shape(self, rows: DriveRows) -> np.ndarray:
        """Effort (N,) in N rows that one unit of the effect's stated drive parameter adds."""

    def columns(self, rows: DriveRows) -> tuple[Column, ...]:
        free = self.name in rows.free
        return (rows.column(self.word, self.shape(rows), rows.spread[self.name], free=free),)

    def block(self, rows: DriveRows, columns: tuple[Column, ...]) -> Block | None:
        if not self.judged(rows):
            return None
        return self.cause(rows, tuple(c.name for c in columns))

    def judged(self, rows: DriveRows) -> bool:
        """Whether an error of the stated number counts as a cause: if the recording states it."""
        return rows.is_stated
