"""Fits of a corrected simulator, and sets of causes as the options of a decision, weighed by them.

Stated values are free within their ordinary spread, and claimed causes; nothing else is, so the
residual is what no claim explains. Uncertainty is the scatter of fits without each block of time
(jackknife over blocks, Künsch 1989, doi 10.1214/aos/1176347265), which grows with noise that has
memory and with a law that is not right, and the shift of a fit by ordinary errors of all stated
values, which are the same in every block of time. The same fits say how far the gap shrinks on
rows that they did not see.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from wrenchbed.diagnosis.decision.decide import LARGEST_NONE, closes, small
from wrenchbed.diagnosis.decision.facts import Facts
from wrenchbed.diagnosis.decision.rivals import not_apart
from wrenchbed.diagnosis.efforts.columns import FREE, LIGHT
from wrenchbed.diagnosis.efforts.dictionary import RIDGE, Dictionary
from wrenchbed.diagnosis.efforts.search import AMPLITUDE, TEMPER, Structure, wide
from wrenchbed.diagnosis.evidence.likelihood import Products
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE
from wrenchbed.diagnosis.explain.elements import DOUBT
from wrenchbed.diagnosis.explain.reliability import RIGHT_ELSEWHERE
from wrenchbed.diagnosis.explain.verdict import Cause, Key, Option, Part, Verdict
from wrenchbed.diagnosis.gap.gap_bootstrap import Bootstrap, Closure, Judged, closure
from wrenchbed.drives.identify import FRICTION, jackknife
from wrenchbed.drives.joint_least_squares import FOLDS

ORDINARY = 2.0
"""Standard deviations by which a fit may move a stated value: 95 % of healthy robots lie within."""
_SMALL = 1e-3
"""Probability of a set of causes below which it is not examined; the best one always is."""
_BESIDE = 0.25
"""Gap of causes without a name, over that of named ones, above which a set of causes counts as
unknown: the unnamed causes are then no small part."""
_LAW = 0.1
"""Share of a gap up to which what a cause adds to Coulomb friction may be a law that differs from
it: bristles and Stribeck curves (tuned on servos of ``tests/support/servo_arm.py``)."""
_MOSTLY = 2.0 / 3.0
"""Closed share of the gap below which claims are believed to at most `RIGHT_ELSEWHERE`: clearly
more than half. That probability also bounds `none`, since ordinary errors may imitate a cause (79 %
of `none` were right on the development seeds), and claims that leave a gap of 1 in a joint."""


@dataclass(frozen=True, eq=False)
class Simulator:
    """Simulator with some causes, whose sizes are fitted to all rows.

    Attributes:
        d: columns: changes of the readings per unit of a parameter.
        blocks: indices, in ``d.blocks``, of the causes that are free without bounds.
        rms: prior rms that each cause adds to the readings, over a row's noise std.
    """

    d: Dictionary
    blocks: tuple[int, ...]
    rms: float = FREE

    @property
    def x(self) -> np.ndarray:
        """Fitted amplitude of each column (P,); 0 for columns that the fit does not use."""
        return self._fit[0]

    @cached_property
    def each(self) -> np.ndarray:
        """Amplitudes (B, P) of P columns, fitted without each of B blocks of time."""
        return np.stack([self._fitted(fold)[0] for fold in range(FOLDS)])

    @cached_property
    def errors(self) -> np.ndarray:
        """Errors (S, P) of P fitted amplitudes if one of S stated values is wrong by its standard
        deviation in healthy robots; its own amplitude, which follows it, has no error. One that
        moves other stated values further than `ORDINARY` would show, so it is that much smaller."""
        level, at, std = self._fit[1], np.flatnonzero(self._bounded), self.d.std
        errors = level.held(level.gram[:, at]).T
        errors[np.arange(len(at)), at] -= 1.0
        errors *= std[at, None]
        most = np.abs(errors[:, at] / std[at]).max(axis=1, initial=ORDINARY)
        return np.asarray(errors * ORDINARY / most[:, None])

    def number(self, of: Callable[[np.ndarray], float]) -> dict[str, float]:
        """``value`` and ``std`` of a number that ``of`` computes from all amplitudes (P,)."""
        value = of(self.x)
        scatter = jackknife(np.array([[of(x)] for x in self.each]))[0, 0]
        stated = sum((of(self.x + error) - value) ** 2 for error in self.errors)
        return {"value": value, "std": float(np.sqrt(scatter + stated))}

    def tells(self, block: int) -> bool:
        """Whether an amplitude of the cause ``block`` (index) is `ORDINARY` of its standard
        uncertainties or more from 0."""
        at = self.d.at[block]
        variance = np.diagonal(jackknife(self.each[:, at])) + np.square(self.errors[:, at]).sum(0)
        return bool((np.abs(self.x[at]) >= ORDINARY * np.sqrt(variance)).any())

    @cached_property
    def _fit(self) -> tuple[np.ndarray, Products]:
        return self._fitted()

    @cached_property
    def _unbounded(self) -> np.ndarray:
        """Whether each of P amplitudes is fitted without bounds (P,), boolean."""
        result = self.d.free.copy()
        result[[k for b in self.blocks for k in self.d.at[b]]] = True
        return result

    @property
    def _bounded(self) -> np.ndarray:
        """Whether each amplitude (P,) is of a stated value and kept within its ordinary spread."""
        return self.d.stated & ~self._unbounded

    def _fitted(self, fold: int | None = None) -> tuple[np.ndarray, Products]:
        """Amplitudes (P,) fitted to all time blocks but ``fold`` (None: all), and their model."""
        d, bounded, (gram, right) = self.d, self._bounded, self.d.without(fold)
        variance = np.where(bounded, d.std**2, self._unbounded * wide(d, self.rms))
        fixed = np.zeros(right.shape)
        while True:  # each pass fixes more amplitudes
            level = Products(gram, variance)
            x = fixed + level.held(right - gram @ fixed)
            off = bounded & (variance > 0.0) & (np.abs(x[:, 0]) > ORDINARY * d.std)
            if not off.any():
                break
            fixed[off] = np.sign(x[off]) * ORDINARY * d.std[off, None]
            variance = np.where(off, 0.0, variance)
        return x[:, 0], level


class Simulators:
    """Cache of simulators fitted to joint efforts, by the indices of the causes in each."""

    def __init__(self, d: Dictionary) -> None:
        self.d, self._made = d, cache(partial(Simulator, d))
        self._box = Simulator(d, tuple(range(len(d.blocks))), AMPLITUDE)

    def of(self, blocks: Iterable[int] = ()) -> Simulator:
        """Simulator with the causes of these indices in ``d.blocks``; fitted at the first call."""
        return self._made(tuple(sorted(blocks)))

    def judged(self, blocks: Sequence[int]) -> Judged:
        """Held-out gaps: as stated, fitted without causes, with those of indices ``blocks``.

        To measure one cause, the others are refitted without it, in the channel where it counts
        most. But a wrong number of the stated tool is measured from the configured value
        (`docs/contracts.md`), so no ordinary error of a link takes its place. The black box, for
        comparison, has all causes at once.
        """
        d, fit, use = self.d, self.of(blocks), self._use
        each = {
            "configured": 0.0 * fit.each, "calibrated": self.of().each,
            "box": self._box.each,
        }  # fmt: skip
        stages = {"before": "calibrated"}
        if blocks:
            each["with_effects"], stages["after"] = fit.each, "with_effects"
        labels = {k: Part(d.blocks[k].effect, 0.0, joint=d.blocks[k].joint).label for k in blocks}
        for k, label in labels.items():
            each[label] = self.of([b for b in blocks if b != k]).each
            if d.blocks[k].effect.startswith("tool."):
                each[label] = fit.each.copy()
                each[label][:, d.at[k]] = 0.0
        every = {name: self._left(x) for name, x in each.items()}
        here = {
            n: self._where(self._lesser(every, n) - every["with_effects"]) for n in labels.values()
        }
        rows = {name: self._of_rows(x) for name, x in every.items() if name not in here}
        rows["floor"] = np.zeros(len(use))
        channels = {s: every[name].sum(axis=0) / use.sum(axis=0) for s, name in stages.items()}
        without = {label: rows["with_effects"] + back for label, back in here.items()}
        return Judged(d.fold, np.ones(len(use)), rows, without, channels)

    def gap(self, blocks: Iterable[int], joint: int | None) -> np.ndarray:
        """Held-out gap (M,) by row with causes ``blocks``: of ``joint`` (from 1); None: of all."""
        left = self._left(self.of(blocks).each)
        return self._of_rows(left) if joint is None else left[:, joint - 1]

    @cached_property
    def _use(self) -> np.ndarray:
        return np.stack([c.use for c in self.d.channels], axis=-1)

    def _left(self, each: np.ndarray) -> np.ndarray:
        """Gap (M, C) of readings, 0 if unused; amplitudes (B, P) are fitted without each block."""
        counts = self._use * np.square([c.std / c.counts for c in self.d.channels])
        noise = np.square([c.left_std / c.std for c in self.d.channels])
        return np.asarray((remaining(self.d, each) ** 2 - noise) * counts)

    def _lesser(self, every: Mapping[str, np.ndarray], name: str) -> np.ndarray:
        """Gap (M, C) of the simulator ``name``, or as configured in channels where that is less: a
        cause that only makes up for ordinary errors that were fitted beside it closes nothing."""
        stated = every["configured"].sum(axis=0) < every[name].sum(axis=0)
        return np.asarray(np.where(stated, every["configured"], every[name]))

    def _where(self, back: np.ndarray) -> np.ndarray:
        """Gap by row (M,) in the channel where most of a cause's gap ``back`` (M, C) lies."""
        c = int((back.sum(axis=0) / self._use.sum(axis=0)).argmax())
        return np.asarray(back[:, c] * len(back) / self._use[:, c].sum())

    def _of_rows(self, left: np.ndarray) -> np.ndarray:
        """Gap (M,) of each row, from gaps (M, C) of readings; its mean is that of used readings."""
        return np.asarray(left.sum(axis=1) * len(left) / self._use.sum())


def added(d: Dictionary, x: np.ndarray, columns: np.ndarray, beside: Sequence[int] = ()) -> float:
    """Gap that the columns of indices ``columns``, with amplitudes x (P,), add at the joint where
    it is largest, less what causes ``beside`` (indices) and the columns that are free in every fit
    take up there.

    Columns common to all joints, known from the others, take up nothing of a cause in one drive.
    """
    joint, gap = d.joint[columns], 0.0
    in_one = bool((joint >= 0).all())
    free = d.free & (d.joint >= 0) if in_one else d.free.copy()
    free[[k for b in beside for k in d.at[b]]] = True
    for channel in [d.channels[joint[0]]] if in_one else d.channels:
        here = np.flatnonzero(np.isin(channel.at, columns))
        taken = free[channel.at] & ~np.isin(channel.at, columns)
        square = np.maximum(np.diagonal(channel.gram), 1e-300)
        others = Products(channel.gram, np.where(taken, 1.0 / (square * RIDGE), 0.0))
        amplitudes = x[channel.at[here]]
        information = others.informations([here[None]])[0][0]
        gap = max(gap, float(amplitudes @ information @ amplitudes))
    return gap


def remaining(d: Dictionary, each: np.ndarray) -> np.ndarray:
    """Residual (M, C) of C channels over a row's noise: each of B time blocks is predicted by its
    row of ``each`` (B, P), amplitudes fitted without that block."""
    some, result = np.abs(each).max(axis=0) > 0.0, list[np.ndarray]()
    for channel in d.channels:
        of_channel = some[channel.at]
        values = each[:, channel.at[of_channel]][d.fold]
        made = np.einsum("mk,mk->m", channel.data[:, of_channel], values)
        result.append((channel.y - made) / channel.std)
    return np.stack(result, axis=-1)


def mass_of_tool(d: Dictionary, x: np.ndarray) -> float:
    """Mass of the tool [kg] for amplitudes x (P,) of all columns."""
    return max(float(d.scene.tool.mass) + float(x[d.names.index("tool.mass")]), LIGHT)


def displacement(d: Dictionary) -> np.ndarray:
    """Displacement (3,) [m] of the tool's CoG, fitted with its mass and ordinary errors alone."""
    tool = (k for k, b in enumerate(d.blocks) if b.effect in ("tool.mass", "tool.cog"))
    x = Simulator(d, tuple(tool)).x
    moment = dict(zip(d.names, x.tolist(), strict=True))
    return np.array([moment.get(f"tool.cog.{a}", 0.0) for a in "xyz"]) / mass_of_tool(d, x)


def weighed(
    chances: Mapping[Structure, float], simulators: Simulators
) -> tuple[Option[Structure], ...]:
    """Probable sets of causes from ``chances``, their probabilities: best first, each with its
    causes and the gap that each adds, largest first."""
    likely = {s: p for k, (s, p) in enumerate(chances.items()) if p >= _SMALL or k == 0}
    total, result = sum(likely.values()), list[Option[Structure]]()
    for structure, p in likely.items():
        gaps = _gaps(simulators, structure)
        every = [_part(simulators, chances, structure, b, gap) for b, gap in gaps.items()]
        parts = {part.key: part for part in sorted(every, key=lambda part: part.share)}
        result.append(Option(structure, p / total, tuple(reversed(parts.values()))))
    return tuple(result)


def _gaps(s: Simulators, structure: Structure) -> dict[int, float]:
    """Gap that each cause of a set adds, by index: of several in one joint first the one that alone
    leaves least, the next beside it, and so on, since they may cancel each other. One that contains
    another (a cable an offset) comes after it, with its further columns."""
    d, result = s.d, dict[int, float]()
    for b in structure:
        joint, before = d.blocks[b].joint, list[int]()
        group = [k for k in structure if d.blocks[k].joint == joint] if joint else [b]
        others = [k for k in structure if k not in group]
        while b not in result:
            left = [k for k in group if k not in before]
            simple = [k for k in left if not any({*d.at[i]} < {*d.at[k]} for i in left)]
            best = min(simple, key=lambda k: _left_in(s, joint or 1, (*others, *before, k)))
            result.setdefault(best, _beside(s, best, others, before))
            before.append(best)
    return result


def _left_in(s: Simulators, joint: int, causes: Sequence[int]) -> float:
    """Sum of squares that a fit with ``causes``, by index, leaves in a joint [N²·m²; N²]."""
    channel = s.d.channels[joint - 1]
    left = channel.y - channel.data @ s.of(causes).x[channel.at]
    return float(left[channel.use] @ left[channel.use])


def _beside(s: Simulators, block: int, others: list[int], before: list[int]) -> float:
    """Gap that the cause ``block`` adds to ``before``, in a fit with ``others`` too."""
    of = [k for b in before for k in s.d.at[b]]
    fit = s.of((*others, *before, block))
    return added(s.d, fit.x, np.setdiff1d(s.d.at[block], of), before)


def _part(
    s: Simulators, chances: Mapping[Structure, float], structure: Structure, block: int, gap: float
) -> Part:
    """Cause ``block``, an index, of the set ``structure``, with its ``gap``. It is named by a
    simpler cause that it contains (an offset, not a cable) unless ``chances``, sets'
    probabilities, prefer it, and more than friction's own law (`_LAW`) speaks for it.
    """
    d, b, beside = s.d, s.d.blocks[block], [k for k in structure if k != block]
    for k, other in enumerate(d.blocks):
        if other.joint == b.joint and {*other.columns} < {*b.columns}:
            less = tuple(sorted((*beside, k)))
            further = np.setdiff1d(d.at[block], d.at[k])
            law = other.effect == FRICTION[0] and (
                added(d, s.of(structure).x, further, (k,)) < _LAW * gap
            )
            block = k if law or chances.get(less, 0.0) >= chances[structure] else block
    return Part(d.blocks[block].effect, gap, index=block, joint=b.joint)


def outside(s: Simulators, best: Option[Structure]) -> str:
    """Description and channel of the largest cause that is no effect of the library; else empty."""
    unnamed = (p for p in best.parts if "." not in p.name and p.share >= CLAIMABLE)
    each = (f"{p.name} of {s.d.scene.channels[(p.joint or 1) - 1][0]}" for p in unnamed)
    return next(each, "")


def blocks(causes: Sequence[Cause]) -> tuple[int, ...]:
    """Sorted indices of the claimed causes in the dictionary, for a fit with all of them."""
    return tuple(sorted(c.part.index for c in causes if c.part.index is not None))


def facts_of(
    s: Simulators, every: Sequence[Option[Structure]], seed: int, least: float = CLAIMABLE
) -> Facts[Structure]:
    """Facts for a decision on joint efforts, from probable sets of causes, best first; see `Facts`.

    Causes add ``least`` gap; sets with large unnamed causes are unknown. ``seed``: of bootstrap.
    """
    some, unknown = list[Option[Structure]](), 0.0
    for o in every:
        parts = tuple(p for p in o.parts if "." in p.name and p.share >= least)
        large = sum(p.share for p in o.parts if p.share >= CLAIMABLE)
        if large > (1.0 + _BESIDE) * sum(p.share for p in parts if p.share >= CLAIMABLE):
            unknown += o.probability
        else:
            some.append(replace(o, parts=parts))

    @cache
    def measured(causes: tuple[int, ...]) -> Closure:
        names = [column for _, column, _ in s.d.scene.channels]
        of = partial(closure, [s.judged(causes)], names, FOLDS, seed)
        fit = s.of(causes)
        untold = {s.d.blocks[b].key for b in causes if not fit.tells(b)}
        gap = replace(of(stated=False), apart=True, untold=untold)
        stated = all(s.d.stated[s.d.at[b]].all() for b in causes)
        shrinks = gap.closed is None or gap.closed.high >= 0.0  # None: nothing is left to shrink
        if not (shrinks and stated and small(gap)):
            return gap
        # the usual fit takes wrong stated numbers: they close the configured gap
        return replace(of(stated=True), apart=True, untold=untold)

    return Facts(
        some or (Option((), 0.0, ()),), unknown, lambda verdict: measured(blocks(verdict.causes)),
        _right, doubt=DOUBT / TEMPER, ordinary_fitted=True,
    )  # fmt: skip


def as_good(s: Simulators, verdict: Verdict[Structure], seed: int) -> tuple[Key, ...]:
    """Effects that do as well in the leading cause's place on held-out rows, best first; none if
    the claimed causes leave only noise in its joint. ``seed``: of the bootstrap over blocks."""
    if not verdict.causes or (index := verdict.causes[0].part.index) is None:
        return ()
    d, (lead, *others) = s.d, verdict.causes
    claim, joint = blocks(verdict.causes), lead.part.joint
    mean, leading = Bootstrap([(d.fold, np.ones(len(d.fold)))], seed).mean, s.gap(claim, joint)
    if mean(leading).low <= 0.0:
        return ()
    taken = {key for c in verdict.causes for key in c.keys}
    simpler = {*d.blocks[index].columns}
    each = (
        (b.key, s.gap((*blocks(others), k), joint), partial(s.gap, (*claim, k), joint))
        for k, b in enumerate(d.blocks)
        if b.joint == joint and not b.outside and b.key not in taken
        if len(d.at[k]) and not simpler < {*b.columns}
    )
    return not_apart(mean, s.gap(blocks(others), joint), leading, 0.0, each)


def _right(verdict: Verdict[Structure], gap: Closure) -> float:
    """Share of verdicts like this that are right, 0…1: less where ordinary errors may imitate a
    cause, or much of the gap is left; where a gap of 1 is left in its joint, or surely in all
    joints, at most the share that is closed there, since causes may then only resemble the true; 0
    if its size may be 0."""
    if not verdict.causes:
        return RIGHT_ELSEWHERE if verdict.word == NONE else 1.0
    part = verdict.causes[0].part
    if part.key in gap.untold:
        return 0.0
    of_joint = [c for n, c in gap.per_channel.items() if n.lstrip("taui") == str(part.joint)]
    left = [c["after"] / c["before"] for c in of_joint if c.get("after", 0.0) > LARGEST_NONE]
    little = gap.closed is None or gap.closed.value < _MOSTLY
    doubtful = little or left or not closes(gap.members.get(part.label))
    right = RIGHT_ELSEWHERE if doubtful else 1.0
    return gap.closed_beside(LARGEST_NONE) * min([right, *(max(1.0 - x, 0.0) for x in left)])
