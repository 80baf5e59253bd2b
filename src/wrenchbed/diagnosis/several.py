"""Diagnose several recordings of one robot together: what belongs to the robot is in all of them.

Every recording is analysed by itself. Each set of causes that explains one of them is then fitted
to all (`explain.refit`), and the joint evidence is treated as a single recording's: verdict,
held-out rows, reliability. Held-out rows of all recordings weigh alike.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product
from operator import attrgetter
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis import json_entries
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding
from wrenchbed.diagnosis.diagnose import Findings, Progress, Weighed, examine, findings_of, settle
from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR, UNKNOWN
from wrenchbed.diagnosis.explain import refit
from wrenchbed.diagnosis.explain.claims import Explanation, explained
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE, EXCUSED, SAME, made_by, rest
from wrenchbed.diagnosis.explain.contributions import share as share_of
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.diagnosis.explain.finalist import Finalist
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.reliability import Reliability, shipped
from wrenchbed.diagnosis.explain.structures import AT_ONCE, MINOR, NEGLIGIBLE, Analysis, Ranking
from wrenchbed.diagnosis.explain.verdict import Part, Verdict
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.drives.identify import arm_of
from wrenchbed.drives.identify_at_rest import added_load
from wrenchbed.errors import CalibrationError, DiagnosisError
from wrenchbed.jobs.workers import one_thread

MOST = 10
"""Most explanations of each recording that are fitted to all: further ones are improbable."""
LEADING = 2
"""Number of each recording's explanations that are also combined with another recording's."""
MUST_AGREE = ("robot", "sensor.model", "sensor.pose_flange", "gravity")
"""Metadata fields that must be the same in all recordings of a robot, where they are stated."""
_Key = frozenset[tuple[object, ...]]


@one_thread
def diagnose_several(
    recordings: Sequence[Recording],
    *,
    seed: int = 0,
    reliability: Reliability | None = None,
    material: Material | None = None,
    progress: Progress = lambda _: None,
) -> Findings:
    """Diagnose one robot from several recordings: where, which, how far, and what next.

    The twin is the robot with its shared effects and the tool of the first recording; figures and
    places are of the first recording, too. The gap is over the rows of all recordings.

    Args:
        recordings: two or more, with tool, payload, temperature and poses alike or not.
        seed: random seed of the split into blocks and of all permutations.
        reliability: shares of claims that are right; by default the package's own model.
        material: residual that counts as a gap of 1; one row's noise if None.
        progress: called with the step that begins.

    Raises:
        DiagnosisError: the recordings are not of one robot, or one of them allows no answer.
    """
    begun = time.perf_counter()
    check(recordings)
    names = [named(r) for r in recordings]

    known = reliability or shipped()

    def examined(r: Recording) -> Weighed:
        return examine(r, seed, known, lambda step: progress(f"{named(r)}: {step}"), material)

    each = [examined(r) for r in recordings]
    progress("all recordings together")
    joint = together([e.analysis for e in each])
    first = each[0]
    settled = settle(joint, known, seed)
    between, scattered = _between(each, names), first.scattered
    all_of_them = settled._replace(outliers=first.outliers, between=between, scattered=scattered)
    findings = findings_of(all_of_them, known, seed, progress, begun)
    d = findings.diagnosis
    of_each = list(zip(names, each, strict=True))
    entries = [(names[0], o) for o in d.outliers]
    entries += [(name, o.entry(None)) for name, e in of_each[1:] for o in e.outliers]
    outliers = [dict(o) | {"sentence": f"{name}: {o['sentence']}"} for name, o in entries]
    with_data = set(_of_data(first, d.gap.folds))
    notes = (
        *settles(first.decision.verdict, settled.decision.verdict, names),
        *(n for n in d.notes if n not in with_data),
        *(f"{name}: {n}" for name, e in of_each for n in _of_data(e, d.gap.folds)),
        f"the twin has the tool of {names[0]}, which figures and places are of too",
    )
    others, seconds = [r.name for r in recordings[1:]], time.perf_counter() - begun
    added, untold = _added_loads(recordings)
    diagnosis = replace(
        d, notes=(*notes, *untold), outliers=outliers, others=others, seconds=seconds,
        fitted=[*d.fitted, *added],
    )  # fmt: skip
    return replace(findings, diagnosis=diagnosis)


def _added_loads(recordings: Sequence[Recording]) -> tuple[list[dict[str, Any]], list[str]]:
    """Entries of ``fitted`` of diagnosis.json on loads that recordings of joint torques at rest
    carry beyond the first one's, and sentences on loads that these data do not determine."""
    first, *others = recordings
    entries, untold = list[dict[str, Any]](), list[str]()
    if not all(r.effort == "tau" and not r.has_wrench for r in recordings):
        return entries, untold
    for other in others:
        try:
            load = added_load(first, other, arm_of(first))
        except CalibrationError as error:
            untold.append(f"the difference of the loads is not told: {error}")
            continue
        for p in load:
            number = {"value": p.value, "std": p.std, "unit": p.unit, "stated": None}
            added = p.name.replace("tool", "added")
            entries.append({"name": added, "recording": named(other)} | number)
    return entries, untold


def named(recording: Recording) -> str:
    """File name of a recording, without its folder."""
    return PurePath(recording.name).name


def check(recordings: Sequence[Recording]) -> None:
    """Raise if recordings are not of one robot, or one is a copy of another.

    Raises:
        DiagnosisError: names the file and the field.
    """
    if len(recordings) < 2:
        raise DiagnosisError("diagnose_several needs two or more recordings; one is for diagnose")
    for r in recordings:
        if r.metadata.mode == "dynamic" and not r.has_wrench:
            raise DiagnosisError(
                f"{r.name}: motions without a wrench are diagnosed one at a time; of a load that "
                "was added, calibrate tells tool.mass before and after"
            )
    first, *others = recordings
    for k, other in enumerate(others, start=1):
        for field in MUST_AGREE:
            here, there = (attrgetter(field)(r.metadata) for r in (other, first))
            if here is not None and there is not None and here != there:
                raise DiagnosisError(
                    f"{other.name}: metadata {field} = {here!r}, but {first.name} has {there!r}: "
                    "recordings that are diagnosed together must be of one robot as it stands"
                )
        for earlier in recordings[:k]:
            here, there = other.columns, earlier.columns
            if here.keys() == there.keys() and all(np.array_equal(here[c], there[c]) for c in here):
                raise DiagnosisError(
                    f"{other.name}: the readings are those of {earlier.name}, row by row: the same "
                    "recording twice says nothing new"
                )


def together(analyses: Sequence[Analysis]) -> Analysis:
    """Analysis of the first recording, with a ranking by the joint evidence of all."""
    known = [[e.finalist for e in a.ranking.explanations] for a in analyses]
    refitters = refit.together([a.refitter for a in analyses], known)
    ranking = rank(refitters, analyses)
    each = zip(analyses, refitters, strict=True)
    one, *others = (replace(a, refitter=r, ranking=ranking) for a, r in each)
    return replace(one, others=tuple(others))


def rank(refitters: Sequence[Refitter], analyses: Sequence[Analysis]) -> Ranking:
    """Rank all sets of causes that explain one recording, after a fit to all recordings."""
    nothing = refitters[0].nothing()
    drafts = _drafts(refitters, [a.ranking for a in analyses])
    fitted = [d.refitter.fit(d.parts, d.rung, d.x).each[0] for d in drafts]
    once: dict[_Key, Finalist] = {}
    for f in sorted([nothing, *fitted], key=lambda f: -f.log_posterior):
        once.setdefault(_key(f.parts), f)  # begun at other shapes, it is the same structure
    finalists = list(once.values())
    least = finalists[0].log_posterior - NEGLIGIBLE
    kept = tuple(_explained(refitters, f) for f in finalists if f.log_posterior > least)
    unknown = float(np.log(PRIOR[UNKNOWN]))
    for a in analyses:  # where there is a gap; elsewhere nothing is as good
        null = a.refitter.nothing().log_posterior
        what = a.ranking.unknown - np.log(PRIOR[UNKNOWN])
        unknown += float(np.logaddexp(what, null - np.log(PRIOR[NONE])) - np.log(2.0))
    gap = _mean(refitters, [r.d.gap(r.y) - r.d.row_noise for r in refitters])
    best = max(fitted, key=lambda f: f.log_posterior, default=nothing)
    return Ranking(kept, unknown, _mixed(refitters, best), analyses[0].ranking.kernel, gap)


def _mixed(refitters: Sequence[Refitter], best: Finalist) -> float:
    """Log posterior of an unknown cause beside the fitted set ``best``, where it gains anything."""
    base = best.log_posterior + float(np.log(MORE / PRIOR["one"]))
    more = [
        float(logsumexp([s.log_posterior for s in r.added(f) if s.index < 0])) - base
        for r, f in zip(refitters, best.each, strict=True)
    ]
    return base + sum(max(m, 0.0) for m in more)


class _Draft(NamedTuple):
    """Set of causes to fit to all recordings: variants and start values (k,) of one of them."""

    refitter: Refitter
    parts: tuple[Hypothesis, ...]
    rung: int
    x: np.ndarray

    def beside(self, other: "_Draft") -> "_Draft | None":
        """Draft with the effects of both; None if the other adds none or they are too many."""
        names = {h.name for h in self.parts}
        more = [h for h in other.parts if h.name not in names]
        if not more or len(names) + len(more) > AT_ONCE + MINOR:
            return None
        here = tuple(self.refitter.like(h, other.refitter) for h in more)
        x = np.concatenate([self.x, self.refitter.start(here)])
        return self._replace(parts=(*self.parts, *here), x=x)


def _drafts(refitters: Sequence[Refitter], rankings: Sequence[Ranking]) -> list[_Draft]:
    """Sets of causes that explain one recording, and unions of two recordings' sets, each once."""
    every: dict[tuple[Refitter | None, _Key], _Draft] = {}
    leading: list[list[_Draft]] = []

    def add(draft: _Draft | None, shaped: bool = False) -> None:
        if draft is not None:
            r = draft.refitter
            key = _key([refitters[0].like(h, r) for h in draft.parts])
            every.setdefault((r if shaped else None, key), draft)

    for r, ranking in zip(refitters, rankings, strict=True):
        some = [e.finalist for e in ranking.explanations[: MOST + 1] if e.finalist.parts]
        drafts = [_Draft(r, f.parts, f.rung, f.x) for f in some]
        for draft in drafts:
            add(draft, any(h.variant.shape for h in draft.parts))
        leading.append(drafts[:LEADING])
    for few, others in combinations(leading, 2):
        for one, other in product(few, others):
            add(one.beside(other))
    return list(every.values())


def _key(parts: Sequence[Hypothesis]) -> _Key:
    return frozenset((h.name, h.variant.free, *sorted(h.variant.at.items())) for h in parts)


def _mean(refitters: Sequence[Refitter], gaps: Sequence[float]) -> float:
    """Mean over recordings of their gaps, weighted by the numbers of their rows."""
    return float(np.average(gaps, weights=[len(r.y) for r in refitters]))


def _explained(refitters: Sequence[Refitter], f: Finalist) -> Explanation:
    """Explanation by the causes that count over all recordings' rows, and the remaining gap."""
    each = [explained(r, g) for r, g in zip(refitters, f.each, strict=True)]
    parts = list[Part]()
    for k in sorted({p.index for e in each for p in e.parts if p.index is not None}):
        in_each = [next((p for p in e.parts if p.index == k), None) for e in each]
        every = zip(refitters, f.each, in_each, strict=True)
        shares = [share_of(r, g, k) if p is None else p.share for r, g, p in every]
        share = _mean(refitters, shares)
        if share < CLAIMABLE:
            continue
        alike = set.intersection(*(set(p.twins) for p in in_each if p is not None))
        same = tuple(n for n in sorted(alike) if _same(refitters, f, k, n, share))
        parts.append(Part(f.parts[k].name, share, index=k, twins=same))
    large = {p.index for p in parts}
    every_one = zip(refitters, f.each, each, strict=True)
    remaining = _mean(refitters, [min(e.rest, rest(r, g, large)) for r, g, e in every_one])
    for name in dict.fromkeys(p.name for e in each for p in e.parts if p.index is None):
        wrong = [[p for p in e.parts if p.index is None and p.name == name] for e in each]
        share = _mean(refitters, [sum(p.share for p in of) for of in wrong])
        if share >= CLAIMABLE:
            parts.append(Part(name, share, max(p.probability for of in wrong for p in of)))
    return Explanation(f, tuple(sorted(parts, key=lambda p: -p.share)), remaining)


def _same(refitters: Sequence[Refitter], f: Finalist, k: int, name: str, share: float) -> bool:
    """Whether effect ``name`` makes the readings of cause k, which adds the gap ``share``, with the
    same parameters in all recordings."""
    both = zip(refitters, f.each, strict=True)
    target = np.concatenate([r.d.without_stated(made_by(r, g, [k])) for r, g in both])
    first = refitters[0]
    for h in first.d.hypotheses:
        if h.name != name or len(h.variant.free) != len(f.parts[k].variant.free):
            continue
        columns = [r.like(h, first).columns for r in refitters]
        if h.effect.of_recording or any(not len(c) for c in columns):
            return True
        every = zip(refitters, columns, strict=True)
        made = np.concatenate([r.d.without_stated(r.d.E[:, c]) for r, c in every])
        residual = target - made @ np.linalg.lstsq(made, target, rcond=None)[0]
        if residual @ residual < min(SAME, EXCUSED / share) * (target @ target):
            return True
    return False


def _between(each: Sequence[Weighed], names: Sequence[str]) -> tuple[RowFinding, ...]:
    """Effects that show between rows of any recording: of each effect the most probable finding."""
    best: dict[str, RowFinding] = {}
    every = [(r, name) for e, name in zip(each, names, strict=True) for r in e.between]
    for r, name in sorted(every, key=lambda of: -of[0].probability):
        best.setdefault(r.effect, replace(r, sentence=f"{name}: {r.sentence}"))
    return tuple(best.values())


def _of_data(e: Weighed, folds: int) -> list[str]:
    p = e.analysis.prepared
    notes = [*p.notes, *([e.scattered] if e.scattered else ())]
    return [*notes, *json_entries.of_data(e.analysis, folds)]


def settles(
    alone: Verdict[Explanation], joint: Verdict[Explanation], names: Sequence[str]
) -> list[str]:
    """Sentences on rivals that the verdict ``joint``, on the recordings ``names``, rules out and
    ``alone``, on the first of them, does not."""
    result = []
    verb = "tells" if len(names) == 2 else "tell"
    for cause in alone.causes:
        rivals = set(cause.names)
        if len(rivals) == 1:
            continue
        now = next((c for c in joint.causes if c.names[0] in rivals), None)
        if now is None:
            continue
        gone = sorted(rivals - set(now.names))
        if gone:
            before = cause.probability * sum(map(cause.fraction, {*cause.names} & {*now.names}))
            others, still, ruled_out = (listed(n, "and") for n in (names[1:], now.names, gone))
            result.append(
                f"{others} {verb} {still} from {ruled_out}: "
                f"probability {before:.2f} → {now.probability:.2f}"
            )
    return result
