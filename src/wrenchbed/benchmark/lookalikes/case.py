"""One test case: what is wrong with the robot, how much it shows, and the reading without noise.

Thresholds with a margin and the growth of sizes are estimates; see docs/explanation/benchmark.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from wrenchbed.benchmark.lookalikes.catalogue import EFFECTS, LARGEST, background, effects
from wrenchbed.benchmark.lookalikes.design import ExperimentDesign
from wrenchbed.benchmark.lookalikes.imperfection import (
    STATED,
    Imperfection,
    ImperfectRobot,
    Scaled,
    gap,
    raised_variance,
)
from wrenchbed.benchmark.lookalikes.outside import FAMILIES, families
from wrenchbed.errors import ParameterError

KINDS = ("none", "single", "pair", "outside")
NEEDED = {"none": 0.0, "single": 1.0, "pair": 1.5, "outside": 2.0}
"""Least gap of each cause."""
ROWS_NEEDED = {"single": 0.5, "pair": 0.75}
"""Least rise of a channel's row variance, for causes that show only between rows."""
SIZES = (0.5, 4.0)
"""Sizes are drawn log-uniformly between these multiples of typical and grow until they show."""
_TRIES = 10
"""Draws of one effect."""
_EFFECT_TRIES = 12
"""Effects that are tried."""
_MARGIN = 1.25
"""Aim above what is needed when a size grows."""


@dataclass(frozen=True, eq=False)
class LookalikeCase:
    """A robot with known faults.

    Attributes:
        seed: that it was drawn with.
        kind: ``none``, ``single``, ``pair`` or ``outside``.
        causes: the contract's names of the effects, empty for ``none`` and ``outside``.
        outside: name of the family outside the library, else None.
        sizes: true parameters of each cause, SI.
        gaps: what each cause (or outside family) adds to the gap; of a cause between rows, the
            mean rise of a row's variance over the channels.
        clean: noise-free reading of each hold or sample (N, 6) [N, N·m], with all causes.
        rows: largest rise of a channel's row variance, of the causes that show between rows.
        background: gap of all small imperfections together.
        items: everything that is wrong, and how much of it.
        unclipped: ``clean`` without range limits (N, 6).
    """

    seed: int
    kind: str
    causes: tuple[str, ...]
    outside: str | None
    sizes: Mapping[str, Mapping[str, float]]
    gaps: Mapping[str, float]
    clean: np.ndarray
    rows: Mapping[str, float] = field(default_factory=dict)
    background: float = 0.0
    items: tuple[Scaled, ...] = ()
    unclipped: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))


def draw(
    design: ExperimentDesign,
    seed: int,
    kind: str = "single",
    effect: str | None = None,
    size: float | None = None,
) -> LookalikeCase:
    """A case that depends on design and seed alone.

    Args:
        effect: name of the (first) cause, or of the outside family; random if None.
        size: of the cause in multiples of typical; random if None, and grown until it shows.

    Raises:
        ParameterError: an unknown kind or effect, or one that this design cannot show.
    """
    if kind not in KINDS:
        raise ParameterError(f"there is no kind of case {kind!r}. Known: {', '.join(KINDS)}")
    drawing = _Drawing(design, seed, kind, size)
    if kind == "none":
        return drawing.case([])
    if kind == "outside":
        return drawing.outside(effect)
    known = effects(design)
    if effect is not None and effect not in known:
        raise ParameterError(f"this design shows no {effect!r}. It shows: {', '.join(known)}")
    if kind == "single":
        return drawing.case([drawing.any_of(known, effect)])
    return drawing.pair(known, effect)


@dataclass(frozen=True, eq=False)
class _Measured:
    """An imperfection, the gap and row variance that it adds, and the reading with it."""

    item: Imperfection
    gap: float
    reading: np.ndarray
    rows: float = 0.0

    @property
    def between_rows(self) -> bool:
        return EFFECTS[self.item.name].rows

    @property
    def shown(self) -> float:
        return self.rows if self.between_rows else self.gap

    def needed(self, kind: str) -> float:
        return (ROWS_NEEDED if self.between_rows else NEEDED)[kind]

    def enough(self, kind: str) -> bool:
        return self.shown >= self.needed(kind)


class _Drawing:
    """Draws the causes of one case beside its background."""

    def __init__(self, design: ExperimentDesign, seed: int, kind: str, size: float | None) -> None:
        self.design, self.seed, self.kind, self.size = design, seed, kind, size
        self.rng = np.random.default_rng([seed, 1])
        self.robot = ImperfectRobot(design)
        self.around = background(self.robot, self.rng)
        self.base = self.robot.reading(self.around)
        self.minor = gap(design, self.base - design.nominal)

    def any_of(self, known: Sequence[str], effect: str | None) -> _Measured:
        """A cause that shows: the effect if one is given, else a random one."""
        remaining = list(known)
        for _ in range(_EFFECT_TRIES):
            name = effect if effect is not None else str(self.rng.choice(remaining))
            cause = self._grown(name)
            if cause is not None:
                return cause
            if effect is None and len(remaining) > 1:
                remaining.remove(name)
        raise ParameterError(f"{effect or 'no effect'} shows enough in this design")

    def pair(self, known: Sequence[str], effect: str | None) -> LookalikeCase:
        """Two causes of different subsystems, each of which shows beside the other."""
        around, base = self.around, self.base
        for _ in range(_EFFECT_TRIES):
            first = self.any_of(known, effect)
            self._surround([*around, (first.item, 1.0)])
            others = [e for e in known if _subsystem(e) != _subsystem(first.item.name)]
            second = self.any_of(others, None)
            self._surround([*around, (second.item, 1.0)])
            again = self._measure(first.item)
            self.around, self.base = around, base
            if self.size is not None or again.enough(self.kind):
                return self.case([again, second])
        raise ParameterError("no two causes show together in this design")

    def outside(self, family: str | None) -> LookalikeCase:
        """A fault outside the library, scaled to a random gap."""
        known = families(self.design)
        if family is not None and family not in known:
            raise ParameterError(f"there is no family {family!r}. Known: {', '.join(known)}")
        for _ in range(_EFFECT_TRIES):
            name = family if family is not None else str(self.rng.choice(known))
            item = FAMILIES[name](self.design, self.rng)
            target = float(np.exp(self.rng.uniform(np.log(2.5), np.log(40.0))))
            amount = 1.0
            for _ in range(5):
                items = [*self.around, (item, amount)]
                reached = gap(self.design, self.robot.reading(items) - self.base)
                if NEEDED["outside"] <= reached <= 2.0 * target:
                    clean = self.robot.reading(items)
                    return LookalikeCase(
                        self.seed, "outside", (), name, {}, {name: reached}, clean,
                        background=self.minor, items=tuple(items), unclipped=clean,
                    )  # fmt: skip
                amount *= float(np.clip(np.sqrt(target / max(reached, 1e-12)), 1e-3, 30.0))
        raise ParameterError(f"{family or 'no family'} shows enough in this design")

    def case(self, causes: Sequence[_Measured]) -> LookalikeCase:
        """The case with these causes, the first one measured beside all others."""
        items = [*self.around, *[(c.item, 1.0) for c in reversed(causes)]]
        clean = causes[0].reading if causes else self.base
        changed = [c.item.rows for c in causes if c.item.rows is not None]
        limited = any(np.isfinite(rows.limit).any() for rows in changed)
        return LookalikeCase(
            seed=self.seed,
            kind=self.kind,
            causes=tuple(c.item.name for c in causes),
            outside=None,
            sizes={c.item.name: {k: float(v) for k, v in c.item.values.items()} for c in causes},
            gaps={c.item.name: c.gap for c in causes},
            clean=clean,
            rows={c.item.name: c.rows for c in causes if c.between_rows},
            background=self.minor,
            items=tuple(items),
            unclipped=self.robot.reading(items, clip=False) if limited else clean,
        )

    def _surround(self, around: list[Scaled]) -> None:
        self.around, self.base = around, self.robot.reading(around)

    def _grown(self, name: str) -> _Measured | None:
        """An effect that shows enough, None if it does not within the tries."""
        low, high = np.log(SIZES)
        now = self.size if self.size is not None else float(np.exp(self.rng.uniform(low, high)))
        for _ in range(_TRIES):
            cause = self._measure(EFFECTS[name].draw(self.design, self.rng, now))
            if (self.size is not None and np.isfinite(cause.gap)) or cause.enough(self.kind):
                return cause
            if not np.isfinite(cause.shown):
                now = 0.5 * now
                continue
            needed = cause.needed(self.kind)
            growth = float(np.sqrt(_MARGIN * needed / max(cause.shown, 1e-12)))
            if cause.shown < 0.01 * needed:  # the draw, not the size, is what does not show
                growth = 1.2
            now = min(now * float(np.clip(growth, 1.05, 3.0)), LARGEST)
        return None

    def _measure(self, item: Imperfection) -> _Measured:
        """What an imperfection adds to the reading of everything around it."""
        if EFFECTS[item.name].rows:
            rise = raised_variance(self.design, item, self.base)
            return _Measured(item, float(rise.mean()), self.base, float(rise.max()))
        with np.errstate(invalid="ignore"):
            reading = self.robot.reading([*self.around, (item, 1.0)])
        if not np.isfinite(reading).all():
            return _Measured(item, float("nan"), self.base)
        size = gap(self.design, reading - self.base, configured=item.name in STATED)
        return _Measured(item, size, reading)


def _subsystem(name: str) -> str:
    return name.split(".")[0]
