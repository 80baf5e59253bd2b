"""How good a diagnosis is: figures of a benchmark with their intervals.

The interval of a share of cases is the exact one of Clopper & Pearson (1934). Any other figure is a
function of sums over cases, so drawing cases anew is one product with a matrix of counts (Efron &
Tibshirani 1993, ch. 6; percentile intervals, 95 %); where all cases are alike no draw differs.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import binomtest

from wrenchbed.benchmark.fault import STATED, subsystem
from wrenchbed.benchmark.scoring.truth_and_claims import OURS, Answer, CaseRow, Claim, numbers
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN

VISIBLE = 3.0
"""Least signal over noise [σ] of an effect that counts for isolation: others are too small."""
SURE = 0.9
"""Probability above which a claim counts as sure."""
BINS = 10
"""Number of equally wide bins of the expected calibration error."""
NORMAL_90 = 1.6448536269514722
"""Half the width of the 90 % interval of a normal distribution [σ]."""
LEAST = 1e-4
"""Least probability in a log score."""
DRAWS = 2000
"""Draws of the bootstrap: its percentiles are then good to about 1 % of the interval."""
EDGES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, np.inf)
"""Edges of the gaps that detection is shown against."""
Parts = Callable[[Answer, Claim], Sequence[float] | None]
"""Sums that a claim about a case adds, None where it does not count."""
Test = Callable[[Answer, Claim], bool]
"""Condition on a case and a claim about it."""
Cells = tuple[list[str], list[list[str]]]
"""Column heads and rows of a table."""


def ratio(s: np.ndarray) -> np.ndarray:
    """Ratio (…) of the first to the last of sums s (…, sums)."""
    return np.asarray(s[..., 0] / s[..., -1])


@dataclass(frozen=True)
class ScoredMetric:
    """Value of a metric, its 95 % interval, and the number of cases (or parameters) in it; ``hits``
    is how many of these cases hold, for a share of cases, else None."""

    value: float
    low: float
    high: float
    count: int
    hits: int | None = None

    @property
    def counted(self) -> str:
        """Text of the count for tables: ``58 of 61``, or the number of cases alone."""
        return str(self.count) if self.hits is None else f"{self.hits} of {self.count}"


@dataclass(frozen=True)
class Metric:
    """Definition of a figure by sums over cases: ``parts`` gives the k numbers that a case adds,
    None where it does not count, ``combine`` the figure from sums (…, k). ``ours``: only the
    diagnosis has it; ``percent``: shown in %; ``target``: text as ``≥ 95 %``, empty if none."""

    title: str
    target: str
    parts: Parts
    combine: Callable[[np.ndarray], np.ndarray] = ratio
    ours: bool = False
    percent: bool = True

    def text(self, scored: ScoredMetric | None, *, wide: bool = True) -> str:
        """Text of a value for tables, with its interval if ``wide``; – if there is none."""
        if scored is None:
            return "–"
        numbers = (scored.value, scored.low, scored.high)
        value, low, high = (f"{100 * x:.0f}" if self.percent else f"{x:.2f}" for x in numbers)
        unit = " %" if self.percent else ""
        return f"{value}{unit} ({low}–{high})" if wide else f"{value}{unit}"


def share(title: str, target: str, counts: Test, held: Test, *, ours: bool = False) -> Metric:
    """Make a metric: of the cases for which ``counts`` is true, the share for which ``held`` is
    too; ``target`` and ``ours`` are as of `Metric`."""

    def parts(truth: Answer, claim: Claim) -> Sequence[float] | None:
        return (held(truth, claim), 1.0) if counts(truth, claim) else None

    return Metric(title, target, parts, ours=ours)


def figure(
    metric: Metric, rows: Sequence[CaseRow], method: str = OURS, draws: int = DRAWS, seed: int = 0
) -> ScoredMetric | None:
    """Compute a metric of a method over cases, and its 95 % interval (exact, or by a bootstrap of
    ``draws``); None where no case counts."""
    every = [p for r in rows if (p := metric.parts(r.truth, r.claims[method])) is not None]
    if not every:
        return None
    sums = np.array(every, dtype=float)
    n = len(sums)
    whole = metric.percent and metric.combine is ratio and sums.shape[1] == 2
    if whole and np.isin(sums, (0.0, 1.0)).all() and sums[:, 1].all():
        hits, trials = (int(x) for x in sums.sum(axis=0))
        return ScoredMetric(hits / trials, *exact_interval(hits, trials), trials, hits)
    weights = np.random.default_rng([seed, 50]).multinomial(n, np.full(n, 1.0 / n), size=draws)
    with np.errstate(invalid="ignore", divide="ignore"):
        drawn = metric.combine(weights @ sums)
        value = float(metric.combine(sums.sum(axis=0)))
    if not np.isfinite(drawn).any():
        return None
    low, high = np.nanquantile(np.where(np.isfinite(drawn), drawn, np.nan), [0.025, 0.975])
    if metric.percent and value == 0.0:
        high = 1.0 - 0.025 ** (1.0 / n)
    elif metric.percent and value == 1.0:
        low = 0.025 ** (1.0 / n)
    return ScoredMetric(value, float(low), float(high), n)


def exact_interval(hits: int, count: int) -> tuple[float, float]:
    """95 % interval (low, high) of hits/count (Clopper & Pearson 1934, 10.1093/biomet/26.4.404)."""
    low, high = binomtest(hits, count).proportion_ci(0.95, "exact")
    return float(low), float(high)


# ---- what a claim says ---------------------------------------------------------------------------


def holds(claim: Claim, truth: Sequence[str]) -> bool:
    """Whether any class of effects that is claimed holds any of the true effects."""
    return any(t in c for c in claim.causes for t in truth)


def right(truth: Answer, claim: Claim) -> bool:
    """Whether the leading answer of a claim (a class, none or unknown) is right."""
    if claim.causes:
        return bool(set(claim.causes[0]) & set(truth.effects))
    return claim.verdict == {"none": NONE, "outside": UNKNOWN}.get(truth.kind)


def probability(truth: Answer, claim: Claim) -> float:
    """Probability that a claim gives to the right leading answer."""
    if truth.kind in ("none", "outside"):
        return claim.probabilities.get(NONE if truth.kind == "none" else UNKNOWN, 0.0)
    lead = {_without_joint(n) for n in (*claim.causes, ())[0]}
    members = [(set(k.split("|")), p) for k, p in claim.probabilities.items()]
    return float(
        sum(p for of, p in members if of & _named(truth) and (of != lead or right(truth, claim)))
    )


def _named(truth: Answer) -> set[str]:
    """Names of the true effects, with their joints and without, as claims may have them."""
    return {*truth.effects, *map(_without_joint, truth.effects)}


def matched(truth: Answer, claim: Claim) -> tuple[int, int, int]:
    """Count true effects that are claimed, claims without a true effect, missed true effects."""
    hits = sum(any(t in c for c in claim.causes) for t in truth.effects)
    wrong = sum(not set(c) & set(truth.effects) for c in claim.causes)
    return hits, wrong, len(truth.effects) - hits


def kind_is(*kinds: str) -> Test:
    """Make a test of whether a case is of one of the given kinds, as ``single``."""
    return lambda truth, claim: truth.kind in kinds


def verdict_is(verdict: str) -> Test:
    """Make a test of whether a claim has a given verdict, as ``unknown``."""
    return lambda truth, claim: claim.verdict == verdict


def isolated(truth: Answer, claim: Claim) -> bool:
    """Whether any class of effects that is claimed holds the true effect."""
    return holds(claim, truth.effects)


def _of_the_joint(truth: Answer, claim: Claim) -> bool:
    """Whether a class of effects that is claimed holds the true effect, with its true joint."""
    (cause,) = truth.causes
    return isolated(truth, claim) and cause.joint in claim.elements.get(cause.effect, ())


def _visible(truth: Answer, claim: Claim) -> bool:
    """Whether a perfect detector would see a case's single effect: its signature over the noise, or
    the rise of variance over its scatter √(2/n), is above `VISIBLE`."""
    sigmas = [
        c.rows * np.sqrt(truth.rows / 2) if c.rows else np.sqrt(6 * truth.rows * c.gap)
        for c in truth.causes
    ]
    return truth.kind == "single" and all(s > VISIBLE for s in sigmas)


def named(truth: Answer, claim: Claim) -> bool:
    """Whether any cause is claimed with a probability above `SURE`."""
    return bool(claim.causes) and claim.sure > SURE


def _bins(truth: Answer, claim: Claim) -> Sequence[float]:
    sums = np.zeros((BINS, 2))
    k = min(int(claim.sure * BINS), BINS - 1)
    sums[k] = claim.sure, right(truth, claim)
    return [*sums.ravel(), 1.0]


def _calibration(s: np.ndarray) -> np.ndarray:
    """Expected calibration error Σ_bins |Σ p − Σ right| / n, from sums (…, 2 BINS + 1)."""
    bins = s[..., :-1].reshape(*s.shape[:-1], BINS, 2)
    return np.asarray(np.abs(bins[..., 0] - bins[..., 1]).sum(axis=-1) / s[..., -1])


def _where(truth: Answer, claim: Claim) -> Sequence[float] | None:
    """Numbers (hit, 1): whether ``claim.where`` is the subsystem of a true effect, or of an effect
    in one claimed class with it; None if no effect of the library is a cause."""
    if not truth.effects:
        return None
    allowed = {subsystem(t) for t in truth.effects}
    for c in claim.causes:
        if set(c) & set(truth.effects):
            allowed |= {subsystem(n) for n in c}
    return (claim.where in allowed, 1.0)


def _coverage(truth: Answer, claim: Claim) -> Sequence[float] | None:
    """Numbers (hits, all) of published 90 % intervals of true effects, a hit if it holds the true
    number; of the referee's robots every number is known, 0 where none is listed."""
    inside = [
        abs(n.value - n.truth) <= NORMAL_90 * n.std
        for cause in (truth.causes if truth.effects else ())
        for n in numbers(cause.effect, claim.parameters.get(cause.effect, {}), cause.true)
        if truth.oracle is not None or n.name in cause.true
    ]
    return (sum(inside), len(inside)) if inside else None


def _closed(truth: Answer, claim: Claim) -> Sequence[float] | None:
    """Shares of the gap on held-out rows (claim's, oracle's) that the claimed (0 if none) and the
    true effects remove; None where a cause scatters rows, which raises the floor itself. The gap is
    the configured simulator's if only stated numbers are wrong, else the calibrated one's."""
    oracle = None if truth.oracle is None else truth.oracle.closed
    if oracle is None or not truth.effects or any(c.rows for c in truth.causes):
        return None
    start = "configured" if set(truth.effects) <= set(STATED) else "calibrated"
    gap, closed = claim.gap, 0.0
    if claim.causes and {start, "floor", "calibrated"} <= set(gap):
        whole = gap[start] - gap["floor"]
        after = gap.get("with_effects", gap["calibrated"])
        closed = (gap[start] - after) / whole if whole > 0 else 0.0
    return (float(np.clip(closed, -1, 1)), float(np.clip(oracle, -1, 1)))


Figures = Mapping[str, Mapping[str, ScoredMetric | None]]
"""Every metric by method and name, None where no case counts."""
METRICS = {
    "isolation": share(
        "isolation: a claimed class holds the effect", "≥ 95 %", _visible, isolated
    ),
    "joint": share(
        "… with the joint that it is of", "≥ 96 %",
        lambda truth, claim: _visible(truth, claim) and bool(truth.causes[0].joint), _of_the_joint,
    ),
    "isolation_alike": share(
        "… or one that this data cannot tell from it", "≥ 95 %", kind_is("single"),
        lambda truth, claim: holds(claim, truth.alike),
    ),
    "alone": share(
        "… and nothing else is claimed", "", _visible,
        lambda truth, claim: len(claim.causes) == 1 and truth.effects[0] in claim.causes[0],
    ),
    "certain": share(
        "… without a rival", "", _visible, lambda truth, claim: truth.effects in claim.causes
    ),
    "false_alarm": share(
        "no gap: any verdict but none", "≤ 3 %", kind_is("none"),
        lambda truth, claim: claim.verdict != NONE,
    ),
    "unknown": share(
        "outside the library: unknown", "≥ 95 %", kind_is("outside"), verdict_is(UNKNOWN)
    ),
    "misnamed": share(
        "outside the library: named with p > 0.9", "≤ 2 %", kind_is("outside"), named
    ),
    "sure": share("right when it says p > 0.9", "≥ 97 %", named, right),
    "ece": Metric("expected calibration error", "≤ 5 %", _bins, _calibration),
    "log_score": Metric(
        "log score (lower is better)", "< 0.79",
        lambda truth, claim: (-float(np.log(max(probability(truth, claim), LEAST))), 1.0),
        percent=False,
    ),
    "pairs": Metric(
        "two effects: F1", "≥ 85 %",
        lambda truth, claim: matched(truth, claim) if truth.kind == "pair" else None,
        lambda s: np.asarray(2 * s[..., 0] / (2 * s[..., 0] + s[..., 1] + s[..., 2])),
    ),
    "where": Metric("first subsystem right", "≥ 97 %", _where),
    "coverage": Metric("90 % intervals hold the truth", "87–93 %", _coverage, ours=True),
    "sets": share(
        "90 % sets of answers hold the truth", "87–93 %", lambda truth, claim: bool(claim.set90),
        lambda truth, claim: bool(
            {*claim.set90} & (_named(truth) or {UNKNOWN if truth.causes else NONE})
        ),
        ours=True,
    ),
    "of_oracle": Metric(
        "held-out gap closed, as a share of the oracle's", "≥ 98 %", _closed, ours=True
    ),
    "seconds": Metric(
        "seconds a case", "",
        lambda truth, claim: None if claim.seconds is None else (claim.seconds, 1.0),
        percent=False,
    ),
    "failed": share(
        "cases that end in an error", "0 %", lambda truth, claim: True, verdict_is("error")
    ),
}  # fmt: skip
"""All metrics by name, with the project's targets."""


# ---- tables --------------------------------------------------------------------------------------


def figures(rows: Sequence[CaseRow], methods: Sequence[str]) -> Figures:
    """Compute every metric of every method; None for those that only the diagnosis states."""
    return {
        method: {
            key: None if metric.ours and method != OURS else figure(metric, rows, method)
            for key, metric in METRICS.items()
        }
        for method in methods
    }


def effect_cells(rows: Sequence[CaseRow]) -> Cells:
    """Heading and rows of a table: answers counted by true effect or fault outside the library."""
    head = ["effect", "n", "median gap", "isolated", "none", "unknown", "otherwise named"]
    alone = [(r.truth, r.claims[OURS]) for r in rows if r.truth.kind in ("single", "outside")]
    groups: dict[tuple[bool, str], list[tuple[Answer, Claim]]] = {}
    for truth, claim in alone:
        key = truth.kind == "outside", _without_joint(truth.causes[0].effect)
        groups.setdefault(key, []).append((truth, claim))
    lines = []
    for (_, name), cases in sorted(groups.items(), key=lambda item: item[0]):
        held = [isolated(t, c) for t, c in cases]
        verdicts = [str(sum(c.verdict == v for _, c in cases)) for v in (NONE, UNKNOWN)]
        missed = (c for (_, c), found in zip(cases, held, strict=True) if c.causes and not found)
        wrong = Counter(_without_joint(c.causes[0][0]) for c in missed)
        names = ", ".join(f"{k} {v}" for k, v in wrong.most_common()) or "–"
        size = float(np.median([t.causes[0].gap for t, _ in cases]))
        title = f"{name} (between rows)" if cases[0][0].causes[0].rows else name
        gap = f"{size:.0f}" if size >= 99.5 else f"{size:.2g}"
        lines.append([title, str(len(cases)), gap, str(sum(held)), *verdicts, names])
    return head, lines


def _without_joint(name: str) -> str:
    """Name of an effect without the joint: ``drive.coulomb`` of ``drive.coulomb.2``."""
    return name.rstrip("0123456789").rstrip(".")


def size_cells(rows: Sequence[CaseRow]) -> Cells:
    """Heading and rows of a table: of cases of one effect that changes means, by the gap that it
    adds, the shares that are noticed (any answer but none) and isolated (a class has it)."""
    singles = [r for r in rows if r.truth.kind == "single" and not r.truth.causes[0].rows]
    lines = []
    for low, high in pairwise(EDGES):
        cases = [(t, c[OURS]) for t, c in singles if low <= t.causes[0].gap < high]
        hits = [(c.verdict != NONE, isolated(t, c)) for t, c in cases]
        parts = [f"{100 * np.mean(part):.0f} %" for part in zip(*hits, strict=True)]
        span = f"{low:g}–{high:g}" if np.isfinite(high) else f"> {low:g}"
        lines.append([span, str(len(cases)), *(parts or ["–", "–"])])
    return ["gap", "n", "noticed", "isolated"], lines
