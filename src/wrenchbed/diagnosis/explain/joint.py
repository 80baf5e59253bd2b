"""Structures fitted to several recordings of one robot at once.

Of the linear Gaussian model the posterior of one recording is the prior of the next, whatever their
order: log p(y_A, y_B | S) = log p(y_A | S) + log p(y_B | S, y_A), and information and scores of the
recordings add up. So every structure has one set of numbers for what belongs to the robot, and one
for each recording of what belongs to that (`Effect.of_recording`); background and stated numbers
are each recording's own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.special import logsumexp

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.likelihood import (
    Moments,
    ScaledEvidence,
    Whitened,
    over_scales,
)
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR
from wrenchbed.diagnosis.explain.refit import (
    SHAPE_SPREAD,
    Finalist,
    Problem,
    Refitter,
    Variables,
    minimum,
)
from wrenchbed.effects.chain import ActiveEffect

Rungs = tuple[int, ...]
"""Background rung of each recording (N,)."""


@dataclass(frozen=True, eq=False)
class JointPart:
    """One effect of a structure.

    Attributes:
        of: its hypothesis in each recording (N).
        shows: whether it can show there (N); where it cannot, the hypothesis is another's.
    """

    of: tuple[Hypothesis, ...]
    shows: tuple[bool, ...]

    @property
    def effect_name(self) -> str:
        return self.of[0].name

    @property
    def homes(self) -> tuple[int, ...]:
        """Recordings that hold a set of its numbers: one of the robot's, every one of its own."""
        shown = tuple(k for k, s in enumerate(self.shows) if s)
        return shown if self.of[0].effect.of_recording else shown[:1]


Structure = tuple[JointPart, ...]


@dataclass(frozen=True, eq=False)
class Layout:
    """Which of a structure's variables (k,), fitted to several recordings, each recording uses.

    Attributes:
        at: of each recording: places of its variables, in the order of `Variables`.
        shape: whether each is a shape (k,).
        owner: set of numbers that each belongs to (k,).
        sets: part and recording of each set, then those of blamed stated numbers.
    """

    at: tuple[np.ndarray, ...]
    shape: np.ndarray
    owner: np.ndarray
    sets: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, parts: Structure) -> "Layout":
        """Set after set: of each part, of each recording that has one."""
        count = len(parts[0].of) if parts else 0
        places: dict[tuple[int, int], np.ndarray] = {}
        shape, owner, sets = list[bool](), list[int](), list[tuple[int, int]]()
        free = [p for p, part in enumerate(parts) if not part.of[0].effect.stated]
        for p in free:
            for home in parts[p].homes:
                is_shape = Variables.of((parts[p].of[home],)).shape
                places[p, home] = len(shape) + np.arange(len(is_shape))
                shape += is_shape.tolist()
                owner += [len(sets)] * len(is_shape)
                sets.append((p, home))
        at = tuple(
            np.concatenate([
                np.zeros(0, dtype=int),
                *(places.get((p, r), places[p, parts[p].homes[0]]) for p in free),
            ])
            for r in range(count)
        )  # fmt: skip
        blamed = [
            (p, r)
            for p, part in enumerate(parts)
            if part.of[0].effect.stated
            for r in part.homes
            if len(part.of[r].columns)
        ]
        return cls(at, np.array(shape, dtype=bool), np.array(owner, dtype=int), (*sets, *blamed))

    def __len__(self) -> int:
        return len(self.shape)


@dataclass(frozen=True, eq=False)
class View(Finalist):
    """Joint finalist restricted to one of its recordings."""

    joint: "JointFinalist"


@dataclass(frozen=True, eq=False)
class JointFinalist:
    """A structure after its fit to all recordings; see `Finalist`, each tuple is by recording.

    Attributes:
        x: variables (k,); see `Layout`.
        covariance: of them and of the blamed stated numbers (m, m).
        spread: their prior standard deviations (m,).
        scales: size of the prior of each set of numbers that fits best.
        log_posterior: summed over rungs and sizes.
    """

    parts: Structure
    rungs: Rungs
    x: np.ndarray
    covariance: np.ndarray
    spread: np.ndarray
    scales: np.ndarray
    residuals: tuple[np.ndarray, ...]
    ys: tuple[np.ndarray, ...]
    designs: tuple[np.ndarray, ...]
    log_posterior: float

    @cached_property
    def layout(self) -> Layout:
        return Layout.of(self.parts)

    @cached_property
    def views(self) -> tuple[View, ...]:
        """View of the finalist in each recording."""
        return tuple(self._view(r) for r in range(len(self.residuals)))

    def _view(self, r: int) -> View:
        parts = tuple(p.of[r] for p in self.parts)
        sets = self.layout.sets
        at = self.layout.at[r] if parts else np.zeros(0, dtype=int)
        first, blamed = len(self.x), list[int]()
        for p, home in sets[len(set(self.layout.owner.tolist())) :]:
            width = len(self.parts[p].of[home].columns)
            blamed += list(range(first, first + width)) if home == r else []
            first += width
        of = np.concatenate([at, np.array(blamed, dtype=int)])
        scale = [
            next((s for s, k in zip(self.scales, sets, strict=True) if k == (p, r)), 1.0)
            for p in range(len(parts))
        ]
        return View(
            parts, self.rungs[r], self.x[at], self.covariance[np.ix_(of, of)],
            self.residuals[r], self.ys[r], self.designs[r][:, of], self.spread[of],
            self.log_posterior, np.array(scale), self,
        )  # fmt: skip


class OneOf(Refitter):
    """Refitter of one of several recordings of a robot; every fit is made to all of them at
    once."""

    def __init__(self, refitter: Refitter, joint: "JointRefitter", at: int) -> None:
        super().__init__(refitter.searcher, refitter.y)
        self.joint, self.at_recording = joint, at
        self.shown = {effect for effect, parameter in self.d.label if parameter}

    def active(self, parts: Sequence[Hypothesis], x: np.ndarray) -> list[ActiveEffect]:
        """Active effects of the parts that can show in this recording."""
        return [a for a in super().active(parts, x) if a.effect.name in self.shown]

    def without(self, fold: int) -> Refitter:
        return self.joint.without(fold).each[self.at_recording]

    def again(self, f: Finalist) -> Finalist:
        if isinstance(f, View):
            return self.joint.again(f.joint).views[self.at_recording]
        return super().again(f)

    def keeping(self, f: Finalist, keep: Sequence[int]) -> Finalist:
        if not keep or not isinstance(f, View):
            return super().keeping(f, keep)
        return self.joint.keeping(f.joint, tuple(keep)).views[self.at_recording]


class JointRefitter:
    """Fits structures to several recordings of one robot.

    Args:
        refitters: of the recordings.
        known: finalists of each recording alone, best first: an effect of a recording's own has
            there the form that it has in the best of these.
    """

    def __init__(
        self, refitters: Sequence[Refitter], known: Sequence[Sequence[Finalist]] = ()
    ) -> None:
        self._given, self._known = tuple(refitters), known
        self.each = tuple(OneOf(r, self, k) for k, r in enumerate(refitters))
        self.y = np.concatenate([r.y for r in refitters])
        ends = np.cumsum([0, *(len(r.y) for r in refitters)])
        self._rows = tuple(slice(a, b) for a, b in pairwise(ends.tolist()))
        self._folds: dict[int, JointRefitter] = {}
        self._again: dict[int, tuple[JointFinalist, JointFinalist]] = {}
        self._kept: dict[tuple[int, tuple[int, ...]], tuple[JointFinalist, JointFinalist]] = {}

    def part(self, h: Hypothesis, source: int) -> JointPart:
        """An effect as one recording's hypothesis has it, in all recordings."""
        of = tuple(h if r == source else self._same(h, r) for r in range(len(self.each)))
        return JointPart(of, tuple(h.name in each.shown for each in self.each))

    def _same(self, h: Hypothesis, r: int) -> Hypothesis:
        """A hypothesis in another recording; without columns where its slopes are to be taken."""
        d = self.each[r].d
        alike = [o for o in d.hypotheses if o.name == h.name]
        if h.effect.of_recording and alike and not h.effect.stated:
            finalists = self._known[r] if self._known else ()
            best = [p for f in finalists for p in f.parts if p.name == h.name]
            labelled = [o for o in alike if o.variant.label == h.variant.label]
            return (best or labelled or alike)[0]
        v = h.variant
        for o in alike:
            if o.variant.free == v.free and dict(o.variant.at) == dict(v.at):
                return replace(o, variant=v)
        return replace(h, columns=np.zeros(0, dtype=int))

    def start(
        self, parts: Structure, source: int | None = None, x: np.ndarray | None = None
    ) -> np.ndarray:
        """Variables (k,) without amplitudes; with the numbers x that one recording found."""
        layout = Layout.of(parts)
        result = np.zeros(len(layout))
        for r in reversed(range(len(self.each))):  # of what is shared, the first has the last word
            result[layout.at[r]] = self.each[r].start(tuple(p.of[r] for p in parts))
        if source is not None and x is not None:
            result[layout.at[source]] = x
        return result

    def fit(self, parts: Structure, rungs: Rungs, x: np.ndarray) -> JointFinalist:
        """The most probable numbers from x (k,), on the rungs that fit best."""
        spread = self._widest(parts)
        f = self._judged(parts, rungs, self._minimum(parts, rungs, x, spread))
        if f.rungs != rungs and len(x):
            f = self._judged(parts, f.rungs, self._minimum(parts, f.rungs, f.x, spread))
        return f

    def nothing(self) -> JointFinalist:
        """Finalist without any effect, on the best fitting rungs."""
        alone = [each.nothing() for each in self.each]
        prior = float(np.log(PRIOR[NONE]))
        total = prior + sum(f.log_posterior - prior for f in alone)
        none, ys = np.zeros(0), tuple(f.y for f in alone)
        return JointFinalist(
            (), tuple(f.rung for f in alone), none, np.zeros((0, 0)), none, none, ys, ys,
            tuple(np.zeros((len(y), 0)) for y in ys), total,
        )  # fmt: skip

    def without(self, fold: int) -> "JointRefitter":
        """Refitter that leaves out one fold of each recording."""
        if fold not in self._folds:
            self._folds[fold] = JointRefitter([r.without(fold) for r in self._given], self._known)
        return self._folds[fold]

    def again(self, f: JointFinalist) -> JointFinalist:
        """A finalist of more rows, its variables and residuals fitted to these."""
        if id(f) not in self._again:
            x = self._minimum(f.parts, f.rungs, f.x, f.spread[: len(f.x)])
            residual = self.y - self.response(f.parts, x)
            residuals = tuple(residual[rows] for rows in self._rows)
            self._again[id(f)] = (f, replace(f, x=x, residuals=residuals))
        return self._again[id(f)][1]

    def keeping(self, f: JointFinalist, keep: tuple[int, ...]) -> JointFinalist:
        """Fit again with only some parts of a finalist, starting from their present values."""
        if (id(f), keep) not in self._kept:
            parts = tuple(f.parts[k] for k in keep)
            sets = f.layout.sets
            kept_sets = [s for k in keep for s, (p, _) in enumerate(sets) if p == k]
            x = np.concatenate([f.x[f.layout.owner == s] for s in kept_sets])
            self._kept[id(f), keep] = (f, self.fit(parts, f.rungs, x))
        return self._kept[id(f), keep][1]

    def response(self, parts: Structure, x: np.ndarray) -> np.ndarray:
        """Whitened readings (C R,) of all recordings that the parts add."""
        at = Layout.of(parts).at
        return np.concatenate([
            each.response(tuple(p.of[r] for p in parts), x[at[r]])
            for r, each in enumerate(self.each)
        ])  # fmt: skip

    def _design(
        self, parts: Structure, x: np.ndarray, f: np.ndarray, which: Sequence[int]
    ) -> np.ndarray:
        """Derivatives (C R, m) of the response by some variables at x, where the response is f."""
        at = Layout.of(parts).at
        result = np.zeros((len(self.y), len(x)))
        for r, each in enumerate(self.each):
            places, views = at[r], tuple(p.of[r] for p in parts)
            some = [i for i, k in enumerate(places.tolist()) if k in set(which)]
            rows = self._rows[r]
            result[rows, places[some]] = each.design(views, x[places], f[rows], some)
        return result[:, list(which)]

    def _minimum(
        self, parts: Structure, rungs: Rungs, x: np.ndarray, spread: np.ndarray
    ) -> np.ndarray:
        levels = [
            each.level(tuple(p.of[r] for p in parts), rungs[r]) for r, each in enumerate(self.each)
        ]

        def whitened(z: np.ndarray) -> Whitened:
            both = zip(levels, self._rows, strict=True)
            return Whitened.of_all([level.whitened(z[rows]) for level, rows in both])

        problem = Problem(
            self.y,
            lambda at: self.response(parts, at),
            lambda at, f, which: self._design(parts, at, f, list(which)),
            whitened,
            np.flatnonzero(Layout.of(parts).shape).tolist(),
        )
        return minimum(problem, self.start(parts), x, spread)

    def _judged(self, parts: Structure, rungs: Rungs, x: np.ndarray) -> JointFinalist:
        layout = Layout.of(parts)
        f = self.response(parts, x)
        slopes = self._design(parts, x, f, range(len(x)))
        blamed = self._blamed(parts, layout)
        first = len(set(layout.owner.tolist()))
        width = [len(parts[p].of[r].columns) for p, r in layout.sets[first:]]
        owner = np.concatenate([layout.owner, np.repeat(np.arange(len(width)) + first, width)])
        shape = np.concatenate([layout.shape, np.zeros(sum(width), dtype=bool)])
        residual = self.y - f
        y = residual + slopes @ (x - self.start(parts))
        every = np.concatenate([slopes, blamed], axis=1)
        fixed = np.where(shape, SHAPE_SPREAD, 0.0)
        ladder = np.stack([self._scales(parts[p], r) for p, r in layout.sets])
        rungs, total, evidence = self._over_rungs(rungs, y, every, owner, fixed, ladder)
        spread = np.where(shape, SHAPE_SPREAD, evidence.scale[owner])
        covariance = np.linalg.inv(evidence.information + np.diag(1.0 / spread**2))
        residuals, ys, designs = (
            tuple(z[rows] for rows in self._rows) for z in (residual, y, every)
        )
        return JointFinalist(
            parts, rungs, x, covariance, spread, evidence.scale, residuals, ys, designs,
            total + self._prior(parts),
        )  # fmt: skip

    def _over_rungs(
        self, rungs: Rungs, y: np.ndarray, every: np.ndarray, owner: np.ndarray,
        fixed: np.ndarray, ladder: np.ndarray,
    ) -> tuple[Rungs, float, ScaledEvidence]:  # fmt: skip
        """The best rungs, the log evidence of all, and the best one's, recording by recording."""
        moments = [
            [
                Moments.of(rung.level, y[rows], every[rows]).raised(float(prior))
                for rung, prior in zip(each.searcher.rungs, each.rung_prior, strict=True)
            ]
            for each, rows in zip(self.each, self._rows, strict=True)
        ]
        best, known = list(rungs), dict[Rungs, ScaledEvidence]()

        def at(some: list[int]) -> ScaledEvidence:
            key = tuple(some)
            if key not in known:
                added = moments[0][some[0]]
                for r, k in enumerate(some[1:], start=1):
                    added = added + moments[r][k]
                known[key] = over_scales(added, owner, fixed, ladder)
            return known[key]

        for r in [*range(len(best)), 0]:
            every_rung = [at([*best[:r], k, *best[r + 1 :]]).total for k in range(len(moments[r]))]
            best[r] = int(np.argmax(every_rung))
        top = at(best).total
        more = 0.0
        for r in range(len(best)):  # rungs of one recording hardly depend on those of another
            totals = [at([*best[:r], k, *best[r + 1 :]]).total for k in range(len(moments[r]))]
            more += float(logsumexp(totals)) - top
        return tuple(best), top + more, at(best)

    def _blamed(self, parts: Structure, layout: Layout) -> np.ndarray:
        """Columns (C R, m) of the stated numbers that a structure blames."""
        columns = [np.zeros((len(self.y), 0))]
        for p, r in layout.sets[len(set(layout.owner.tolist())) :]:
            block = self.each[r].d.E[:, parts[p].of[r].columns]
            wide = np.zeros((len(self.y), block.shape[1]))
            wide[self._rows[r]] = block
            columns.append(wide)
        return np.concatenate(columns, axis=1)

    def _widest(self, parts: Structure) -> np.ndarray:
        """Widest prior standard deviation of each variable (k,)."""
        layout = Layout.of(parts)
        largest = np.array([self._scales(parts[p], r)[-1] for p, r in layout.sets])
        return np.where(layout.shape, SHAPE_SPREAD, largest[layout.owner])

    def _scales(self, part: JointPart, home: int) -> np.ndarray:
        """Prior standard deviations (s,) of a set of numbers: what is shared may be small as soon
        as one recording shows it."""
        of = part.of if len(part.homes) == 1 else (part.of[home],)
        return self.each[home].searcher.scales(max(of, key=lambda h: h.typical_gap))

    def _prior(self, parts: Structure) -> float:
        """Log prior of a structure, counted once: each part where it is least rare."""
        result = (len(parts) - 1) * float(np.log(MORE / PRIOR["one"]))
        for part in parts:
            result += max(
                each.searcher.prior(h)
                for each, h in zip(self.each, part.of, strict=True)
                if any(h.name == o.name for o in each.d.hypotheses)
            )
        return result
