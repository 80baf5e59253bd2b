"""Diagnose several recordings of one robot together: what belongs to the robot is in all of them.

Every recording is analysed by itself. Each structure that explains one of them is then fitted to
all (`explain.joint`), and the joint evidence goes the way of a single recording's: verdict,
held-out rows, reliability. Held-out rows of all recordings count alike.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np
from scipy.special import logsumexp

from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis import answer
from wrenchbed.diagnosis.between_rows.row_effects import RowFinding
from wrenchbed.diagnosis.diagnose import (
    Examined,
    Findings,
    Progress,
    Weighed,
    examine,
    findings_of,
    settle,
)
from wrenchbed.diagnosis.evidence.search import MORE, NONE, PRIOR, UNKNOWN
from wrenchbed.diagnosis.explain.claims import Explanation, Part, explained
from wrenchbed.diagnosis.explain.contributions import CLAIMABLE, EXCUSED, SAME, made_by, rest
from wrenchbed.diagnosis.explain.contributions import share as share_of
from wrenchbed.diagnosis.explain.joint import (
    JointFinalist,
    JointRefitter,
    Structure,
)
from wrenchbed.diagnosis.explain.reliability import Reliability
from wrenchbed.diagnosis.explain.structures import AT_ONCE, MINOR, NEGLIGIBLE, Analysis, Ranking
from wrenchbed.diagnosis.next.isolability import listed
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.errors import DiagnosisError
from wrenchbed.jobs.workers import one_thread

MOST = 10
"""Explanations of each recording that are fitted to all; estimate."""
LEADING = 2
"""Explanations of each recording whose effects are also combined with another recording's."""
Draft = tuple[Structure, tuple[int, ...], np.ndarray]


@one_thread
def diagnose_several(
    recordings: Sequence[Recording],
    *,
    seed: int = 0,
    reliability: Reliability | None = None,
    material: Material | None = None,
    progress: Progress = lambda _: None,
) -> Findings:
    """Diagnosis of one robot from several recordings: where, which, how far, and what next.

    The twin is the robot with its shared effects and the tool of the first recording, which figures
    and places are of too. The gap is over the rows of all recordings.

    Args:
        recordings: two or more, with tool, payload, temperature and poses alike or not.
        seed: of the split into blocks and of all permutations.
        reliability: how often claims are right; the one that comes with the package if None.
        material: residual that counts as a gap of 1; one row's noise if None.
        progress: called with the step that begins.

    Raises:
        DiagnosisError: the recordings are not of one robot, or one of them cannot answer.
    """
    begun = time.perf_counter()
    check(recordings)
    names = [named(r) for r in recordings]

    def examined(r: Recording) -> Examined:
        return examine(r, seed, reliability, lambda step: progress(f"{named(r)}: {step}"), material)

    each = [examined(r) for r in recordings]
    progress("all recordings together")
    joint = together([e.weighed.analysis for e in each])
    first = each[0]
    settled = settle(joint, first.known, seed)
    all_of_them = Examined(
        settled, first.known, first.outliers, _between(each, names), first.scattered
    )
    findings = findings_of(all_of_them, seed, progress, begun)
    d = findings.diagnosis
    own = [n for n in d.notes if n in _of_data(first, d.gap.folds)]
    prefixed = [f"{names[0]}: {n}" for n in own]
    for e, name in zip(each[1:], names[1:], strict=True):
        prefixed += [f"{name}: {n}" for n in _of_data(e, d.gap.folds)]
    entries = [d.outliers, *([o.entry(None) for o in e.outliers] for e in each[1:])]
    outliers = [
        dict(entry) | {"sentence": f"{name}: {entry['sentence']}"}
        for of_one, name in zip(entries, names, strict=True)
        for entry in of_one
    ]
    notes = (
        *settles(first.weighed, settled, names),
        *(n for n in d.notes if n not in own),
        *prefixed,
        f"the twin has the tool of {names[0]}, which figures and places are of too",
    )
    diagnosis = replace(
        d,
        notes=notes,
        outliers=outliers,
        others=[r.name for r in recordings[1:]],
        seconds=time.perf_counter() - begun,
    )
    return replace(findings, diagnosis=diagnosis)


def named(recording: Recording) -> str:
    """File name of a recording, without its folder."""
    return PurePath(recording.name).name


def check(recordings: Sequence[Recording]) -> None:
    """Refuse what cannot be one robot, or is no second recording.

    Raises:
        DiagnosisError: names the file and the field.
    """
    if len(recordings) < 2:
        raise DiagnosisError("diagnose_several needs two or more recordings; one is for diagnose")
    first, *others = recordings
    for k, other in enumerate(others, start=1):
        for field, here, there in _must_agree(other, first):
            if here is not None and there is not None and here != there:
                raise DiagnosisError(
                    f"{other.name}: metadata {field} = {here!r}, but {first.name} has {there!r}: "
                    "recordings that are diagnosed together must be of one robot as it stands"
                )
        for earlier in recordings[:k]:
            if len(other) == len(earlier) and np.array_equal(other.wrench, earlier.wrench):
                raise DiagnosisError(
                    f"{other.name}: the wrench is that of {earlier.name}, row by row: the same "
                    "recording twice says nothing new"
                )


def _must_agree(a: Recording, b: Recording) -> list[tuple[str, object, object]]:
    x, y = a.metadata, b.metadata
    return [
        ("robot", x.robot, y.robot),
        ("sensor.model", x.sensor.model, y.sensor.model),
        ("sensor.pose_flange", x.sensor.pose_flange, y.sensor.pose_flange),
        ("gravity", x.gravity, y.gravity),
    ]


def together(analyses: Sequence[Analysis]) -> Analysis:
    """The first recording's analysis with a ranking by the joint evidence of all."""
    known = [[e.finalist for e in a.ranking.explanations] for a in analyses]
    refitter = JointRefitter([a.refitter for a in analyses], known)
    ranking = rank(refitter, analyses)
    one, *others = (
        replace(a, refitter=each, ranking=ranking)
        for a, each in zip(analyses, refitter.each, strict=True)
    )
    return replace(one, others=tuple(others))


def rank(joint: JointRefitter, analyses: Sequence[Analysis]) -> Ranking:
    """Ranking of every structure that explains one recording, fitted to all recordings."""
    nothing = joint.nothing()
    fitted = [joint.fit(*c) for c in _candidates(joint, analyses, nothing)]
    best = max(fitted, key=lambda f: f.log_posterior, default=nothing)
    once: dict[frozenset[object], JointFinalist] = {}
    for f in sorted([nothing, *fitted], key=lambda f: -f.log_posterior):
        once.setdefault(_key(f.parts), f)  # begun at other shapes, it is the same structure
    finalists = list(once.values())
    least = finalists[0].log_posterior - NEGLIGIBLE
    pooled = Pooled(joint)
    kept = tuple(pooled.explained(f) for f in finalists if f.log_posterior > least)
    unknown = float(np.log(PRIOR[UNKNOWN]))
    for a in analyses:  # where there is a gap; elsewhere nothing is as good
        alone = [e.log_posterior for e in a.ranking.explanations if not e.finalist.parts]
        null = a.refitter.nothing().log_posterior if not alone else alone[0]
        what = a.ranking.unknown - np.log(PRIOR[UNKNOWN])
        unknown += float(np.logaddexp(what, null - np.log(PRIOR[NONE])) - np.log(2.0))
    gap = pooled.mean([each.d.gap(each.y) - each.d.row_noise for each in joint.each])
    return Ranking(kept, unknown, _mixed(joint, best), analyses[0].ranking.kernel, gap)


def _mixed(joint: JointRefitter, best: JointFinalist) -> float:
    """Log posterior of something unknown beside a finalist, in every recording that asks for it."""
    base = best.log_posterior + float(np.log(MORE / PRIOR["one"]))
    more = [
        float(logsumexp([s.log_posterior for s in each.added(view) if s.index < 0])) - base
        for each, view in zip(joint.each, best.views, strict=True)
    ]
    return base + sum(max(m, 0.0) for m in more)


def _candidates(
    joint: JointRefitter, analyses: Sequence[Analysis], nothing: JointFinalist
) -> list[Draft]:
    """Structures of all recordings with rungs and variables to begin with, alike ones once."""
    drafts: dict[object, Draft] = {}
    leading: list[list[Draft]] = []
    for r, a in enumerate(analyses):
        found = []
        for e in a.ranking.explanations[: MOST + 1]:
            f = e.finalist
            if not f.parts:
                continue
            parts = tuple(joint.part(h, r) for h in f.parts)
            rungs = (*nothing.rungs[:r], f.rung, *nothing.rungs[r + 1 :])
            found.append((parts, rungs, joint.start(parts, r, f.x)))
            shaped = r if any(h.variant.shape for h in f.parts) else None
            drafts.setdefault((shaped, _key(parts)), found[-1])
        leading.append(found[:LEADING])
    for k, some in enumerate(leading):
        for others in leading[k + 1 :]:
            for one in some:
                for other in others:
                    both = _both(joint, one, other)
                    if both is not None:
                        drafts.setdefault((None, _key(both[0])), both)
    return list(drafts.values())


def _key(parts: Structure) -> frozenset[object]:
    return frozenset(
        (h.name, h.variant.free, tuple(sorted(h.variant.at.items())))
        for h in (p.of[0] for p in parts)
    )


def _both(joint: JointRefitter, one: Draft, other: Draft) -> Draft | None:
    """Union of two structures, if each has an effect that the other lacks and their size allows
    it."""
    names = {p.effect_name for p in one[0]}
    more = tuple(p for p in other[0] if p.effect_name not in names)
    if not more or len(more) == len(other[0]) == len(one[0]) + len(more):
        return None
    if len(one[0]) + len(more) > AT_ONCE + MINOR:
        return None
    return (*one[0], *more), one[1], np.concatenate([one[2], joint.start(more)])


@dataclass(frozen=True, eq=False)
class Pooled:
    """Claims of a finalist over all recordings: gaps are means over all rows of the fits."""

    joint: JointRefitter

    def mean(self, gaps: Sequence[float]) -> float:
        """Mean gap over the rows of all recordings."""
        return float(np.average(gaps, weights=[len(each.y) for each in self.joint.each]))

    def explained(self, f: JointFinalist) -> Explanation:
        """Parts that count over all recordings, and what remains in these."""
        each = [explained(r, v) for r, v in zip(self.joint.each, f.views, strict=True)]
        parts = [self._part(f, k, each) for k in self._claimed(f, each)]
        parts = [p for p in parts if p.share >= CLAIMABLE]
        large = {p.index for p in parts}
        both = zip(self.joint.each, f.views, each, strict=True)
        remaining = self.mean([min(e.rest, rest(r, v, large)) for r, v, e in both])
        parts += self._wrong(each)
        return Explanation(f.views[0], tuple(sorted(parts, key=lambda p: -p.share)), remaining)

    def _claimed(self, f: JointFinalist, each: Sequence[Explanation]) -> list[int]:
        """Numbers of the parts that count in one recording at least."""
        claimed = {p.index for e in each for p in e.parts}
        return [k for k in range(len(f.parts)) if k in claimed]

    def _part(self, f: JointFinalist, k: int, each: Sequence[Explanation]) -> Part:
        shares, twins = [], list[frozenset[str]]()
        for refitter, view, e in zip(self.joint.each, f.views, each, strict=True):
            own = next((p for p in e.parts if p.index == k), None)
            shares.append(share_of(refitter, view, k) if own is None else own.share)
            if own is not None:
                twins.append(frozenset(own.twins))
        alike = sorted(frozenset.intersection(*twins))
        share = self.mean(shares)
        still = tuple(name for name in alike if self._same(f, k, name, share))
        return Part(f.parts[k].effect_name, share, index=k, twins=still)

    def _same(self, f: JointFinalist, k: int, name: str, share: float) -> bool:
        """Whether an effect makes a part's readings with the same parameter values in all
        recordings."""
        target = np.concatenate([
            each.d.without_stated(made_by(each, view, [k]))
            for each, view in zip(self.joint.each, f.views, strict=True)
        ])  # fmt: skip
        count = len(f.parts[k].of[0].variant.free)
        for h in self.joint.each[0].d.hypotheses:
            if h.name != name or len(h.variant.free) != count:
                continue
            part = self.joint.part(h, 0)
            if h.effect.of_recording or any(not len(o.columns) for o in part.of):
                return True
            made = np.concatenate([
                each.d.without_stated(each.d.E[:, o.columns])
                for each, o in zip(self.joint.each, part.of, strict=True)
            ])  # fmt: skip
            residual = target - made @ np.linalg.lstsq(made, target, rcond=None)[0]
            if residual @ residual < min(SAME, EXCUSED / share) * (target @ target):
                return True
        return False

    def _wrong(self, each: Sequence[Explanation]) -> list[Part]:
        """Stated numbers that are wrong in one of the recordings."""
        result = []
        for name in dict.fromkeys(p.name for e in each for p in e.parts if p.index is None):
            own = [
                next(
                    (p for p in e.parts if p.index is None and p.name == name), Part(name, 0.0, 0.0)
                )
                for e in each
            ]
            share = self.mean([p.share for p in own])
            if share >= CLAIMABLE:
                result.append(Part(name, share, max(p.probability for p in own)))
        return result


def _between(each: Sequence[Examined], names: Sequence[str]) -> tuple[RowFinding, ...]:
    """Findings between rows of all recordings; of each effect the surest."""
    best: dict[str, RowFinding] = {}
    for e, name in zip(each, names, strict=True):
        for r in e.between:
            if r.effect not in best or r.probability > best[r.effect].probability:
                best[r.effect] = replace(r, sentence=f"{name}: {r.sentence}")
    return tuple(sorted(best.values(), key=lambda r: -r.probability))


def _of_data(e: Examined, folds: int) -> list[str]:
    p = e.weighed.analysis.prepared
    notes = [*p.notes, *([e.scattered] if e.scattered else ())]
    return [*notes, *answer.of_data(e.weighed.analysis, folds)]


def settles(alone: Weighed, joint: Weighed, names: Sequence[str]) -> list[str]:
    """Sentences on causes that further recordings distinguish and the first one does not."""
    result = []
    verb = "tells" if len(names) == 2 else "tell"
    for cause in alone.verdict.causes:
        rivals = set(cause.names)
        if len(rivals) == 1:
            continue
        now = next((c for c in joint.verdict.causes if c.names[0] in rivals), None)
        if now is None:
            continue
        gone = sorted(rivals - set(now.names))
        if gone:
            own = zip(cause.names, cause.shares, strict=True)
            before = cause.probability * sum(share for name, share in own if name in now.names)
            result.append(
                f"{listed(list(names[1:]))} {verb} {listed(list(now.names))} from {listed(gone)}: "
                f"probability {before:.2f} → {now.probability:.2f}"
            )
    return result
