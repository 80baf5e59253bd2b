"""One test case: what is wrong with the robot, how much it shows, and the reading without noise."""

from collections.abc import Mapping
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
_EFFECT_TRIES = 12
_MARGIN = 1.25


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


@dataclass(frozen=True, eq=False)
class _Found:
    item: Imperfection
    gap: float
    reading: np.ndarray
    rows: float = 0.0


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
    rng = np.random.default_rng([seed, 1])
    world = ImperfectRobot(design)
    around = background(world, rng)
    base = world.reading(around)
    minor = gap(design, base - design.nominal)
    if kind == "none":
        return _case(world, seed, kind, around, base, [], minor)
    if kind == "outside":
        return _outside(world, seed, around, base, effect, rng, minor)
    known = effects(design)
    if effect is not None and effect not in known:
        raise ParameterError(f"this design shows no {effect!r}. It shows: {', '.join(known)}")
    if kind == "single":
        found = _any(world, around, base, known, effect, size, rng, kind)
        return _case(world, seed, kind, around, base, [found], minor)
    for _ in range(_EFFECT_TRIES):
        first = _any(world, around, base, known, effect, size, rng, kind)
        with_first = [*around, (first.item, 1.0)]
        others = tuple(e for e in known if _subsystem(e) != _subsystem(first.item.name))
        second = _any(world, with_first, world.reading(with_first), others, None, size, rng, kind)
        with_second = [*around, (second.item, 1.0)]
        again = _measure(world, with_second, world.reading(with_second), first.item)
        if size is not None or _enough(again, kind):
            return _case(world, seed, kind, around, base, [again, second], minor)
    raise ParameterError("no two causes show together in this design")


def _any(
    world: ImperfectRobot,
    around: list[Scaled],
    base: np.ndarray,
    known: tuple[str, ...],
    effect: str | None,
    size: float | None,
    rng: np.random.Generator,
    kind: str,
) -> _Found:
    left = list(known)
    for _ in range(_EFFECT_TRIES):
        name = effect if effect is not None else str(rng.choice(left))
        found = _one(world, around, base, name, size, rng, kind)
        if found is not None:
            return found
        if effect is None and len(left) > 1:
            left.remove(name)
    raise ParameterError(f"{effect or 'no effect'} shows enough in this design")


def _one(
    world: ImperfectRobot,
    around: list[Scaled],
    base: np.ndarray,
    name: str,
    size: float | None,
    rng: np.random.Generator,
    kind: str,
) -> _Found | None:
    """An effect that shows enough, None if it does not within the tries."""
    low, high = SIZES
    now = size if size is not None else float(np.exp(rng.uniform(np.log(low), np.log(high))))
    for _ in range(_TRIES):
        item = EFFECTS[name].draw(world.design, rng, now)
        found = _measure(world, around, base, item)
        if size is not None and np.isfinite(found.gap):
            return found
        if _enough(found, kind):
            return found
        shown, needed = found.gap, NEEDED[kind]
        if EFFECTS[name].rows:
            shown, needed = found.rows, ROWS_NEEDED[kind]
        if not np.isfinite(shown):
            now = 0.5 * now
            continue
        growth = float(np.sqrt(_MARGIN * needed / max(shown, 1e-12)))
        if shown < 0.01 * needed:  # the draw, not the size, is what does not show
            growth = 1.2
        now = min(now * float(np.clip(growth, 1.05, 3.0)), LARGEST)
    return None


def _measure(
    world: ImperfectRobot, around: list[Scaled], base: np.ndarray, item: Imperfection
) -> _Found:
    """What an imperfection adds to a reading ``base`` of everything around it."""
    if EFFECTS[item.name].rows:
        rise = raised_variance(world.design, item, base)
        return _Found(item, float(rise.mean()), base, float(rise.max()))
    with np.errstate(invalid="ignore"):
        reading = world.reading([*around, (item, 1.0)])
    if not np.isfinite(reading).all():
        return _Found(item, float("nan"), base)
    size = gap(world.design, reading - base, configured=item.name in STATED)
    return _Found(item, size, reading)


def _enough(found: _Found, kind: str) -> bool:
    if EFFECTS[found.item.name].rows:
        return found.rows >= ROWS_NEEDED[kind]
    return found.gap >= NEEDED[kind]


def _outside(
    world: ImperfectRobot,
    seed: int,
    around: list[Scaled],
    base: np.ndarray,
    family: str | None,
    rng: np.random.Generator,
    minor: float,
) -> LookalikeCase:
    known = families(world.design)
    if family is not None and family not in known:
        raise ParameterError(f"there is no family {family!r}. Known: {', '.join(known)}")
    for _ in range(_EFFECT_TRIES):
        name = family if family is not None else str(rng.choice(known))
        item = FAMILIES[name](world.design, rng)
        target = float(np.exp(rng.uniform(np.log(2.5), np.log(40.0))))
        amount = 1.0
        for _ in range(5):
            items = [*around, (item, amount)]
            found = gap(world.design, world.reading(items) - base)
            if NEEDED["outside"] <= found <= 2.0 * target:
                clean = world.reading(items)
                return LookalikeCase(
                    seed, "outside", (), name, {}, {name: found}, clean,
                    background=minor, items=tuple(items), unclipped=clean,
                )  # fmt: skip
            amount *= float(np.clip(np.sqrt(target / max(found, 1e-12)), 1e-3, 30.0))
    raise ParameterError(f"{family or 'no family'} shows enough in this design")


def _case(
    world: ImperfectRobot,
    seed: int,
    kind: str,
    around: list[Scaled],
    base: np.ndarray,
    found: list[_Found],
    minor: float,
) -> LookalikeCase:
    items = [*around, *[(f.item, 1.0) for f in reversed(found)]]  # as ``found`` was measured
    names = tuple(f.item.name for f in found)
    clean = found[0].reading if found else base
    limited = any(f.item.rows is not None and np.isfinite(f.item.rows.limit).any() for f in found)
    return LookalikeCase(
        seed=seed,
        kind=kind,
        causes=names,
        outside=None,
        sizes={f.item.name: {k: float(v) for k, v in f.item.values.items()} for f in found},
        gaps={f.item.name: f.gap for f in found},
        clean=clean,
        rows={f.item.name: f.rows for f in found if EFFECTS[f.item.name].rows},
        background=minor,
        items=tuple(items),
        unclipped=world.reading(items, clip=False) if limited else clean,
    )


def _subsystem(name: str) -> str:
    return name.split(".")[0]
