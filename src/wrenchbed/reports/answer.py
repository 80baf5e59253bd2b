"""The words of a diagnosis, of a wrench or of joint efforts, for page, terminal and rerun."""

from collections.abc import Sequence
from dataclasses import dataclass

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.diagnosis.gap.result import Diagnosis
from wrenchbed.diagnosis.next.blind import sentences as sentences_of
from wrenchbed.pages import numbers
from wrenchbed.reports import effort_sentences, sentences, tables
from wrenchbed.reports.claim import Claim, claim

BADGES = {"none": "✓", "identified": "●", "ambiguous": "◐", "partial": "◔", "unknown": "?"}
"""Shapes beside the colour of a verdict."""


@dataclass(frozen=True)
class Answer:
    """A diagnosis in words.

    Attributes:
        d: the diagnosis.
        about: recordings, robot and duration.
        headline: the verdict in sentences.
        aside: sentences on outliers.
        place: where, in a few words; ``where``: sentences on it.
        causes: what is claimed; ``no_cause``: what stands for it where nothing is.
        far: how far the gap shrinks, a figure (which may be empty) and sentences.
        black_box: what a flexible model says of the gap; empty where it says nothing.
        measure: what a gap is.
        gaps: label, gap and kind of each simulator.
        notes: what else a reader should know.
        steps: what to do next.
    """

    d: Diagnosis
    about: str
    headline: str
    aside: Sequence[str]
    place: str
    where: Sequence[str]
    causes: Sequence[Claim]
    no_cause: str
    far: tuple[str, str]
    black_box: str
    measure: str
    gaps: Sequence[tuple[str, float, str]]
    notes: Sequence[str]
    steps: Sequence[str]

    @property
    def blind(self) -> tuple[str, ...]:
        """Sentences on what the recording could not have shown."""
        return sentences_of(self.d.blind)

    @property
    def distance(self) -> str:
        """How far the gap shrinks, and what a black box says of it."""
        figure, text = self.far
        text = text if self.black_box in text else f"{text} {self.black_box}"
        return f"{figure}. {text}" if figure else text

    @property
    def bars(self) -> list[tuple[str, str]]:
        """Label and gap of each simulator but the black box."""
        return [(label, numbers.gap(v)) for label, v, kind in self.gaps if kind != "box"]

    @property
    def candidates(self) -> list[dict[str, str]]:
        """Leading causes by probability."""
        return tables.candidates(self.d.probabilities)

    @property
    def leading(self) -> str:
        """The leading causes with their probabilities, and those that are likely together."""
        ranked = ", ".join(f"{c['key']} {c['p']}" for c in self.candidates)
        likely = ", ".join(self.d.set90)
        return f"leading cause: {ranked}; at least 90 % together: {likely}"


def of_wrench(findings: Findings) -> Answer:
    """The words of a diagnosis of a wrench."""
    d = findings.diagnosis
    rows = [r.sentence for r in findings.rows]
    far, g = sentences.distance(findings), d.gap
    box = None
    if g.black_box is not None:
        box = g.calibrated.value - g.black_box * (g.calibrated.value - g.floor)
    return Answer(
        d,
        about=f"{', '.join((d.recording, *d.others))}  {d.robot}, {d.seconds:.1f} s",
        headline=sentences.headline(findings),
        aside=[str(o["sentence"]) for o in d.outliers],
        place=sentences.place(findings),
        where=sentences.places(findings),
        causes=[claim(w) for w in d.which],
        no_cause=sentences.without_cause(findings),
        far=(far["figure"], far["text"]),
        black_box=sentences.black_box(g),
        measure=sentences.MEASURE,
        gaps=tables.gaps(g, box),
        notes=[*rows, *(n for n in d.notes if n not in rows)],
        steps=[str(n["sentence"]) for n in d.next] or [sentences.nothing_more(findings)],
    )


def of_efforts(findings: EffortFindings) -> Answer:
    """The words of a diagnosis of joint efforts."""
    d, g = findings.diagnosis, findings.diagnosis.gap
    channels = effort_sentences.channels(findings)
    box = None if g.black_box is None else g.calibrated.value * (1.0 - g.black_box)
    return Answer(
        d,
        about=f"{d.recording}  {d.robot}, {channels}, {d.seconds:.1f} s",
        headline=effort_sentences.headline(findings),
        aside=(),
        place=effort_sentences.place(findings),
        where=[str(w["sentence"]) for w in d.where],
        causes=effort_sentences.claims(findings),
        no_cause=effort_sentences.without_cause(findings),
        far=("", effort_sentences.distance(findings)),
        black_box="",
        measure=effort_sentences.MEASURE,
        gaps=tables.gaps(g, box),
        notes=d.notes,
        steps=effort_sentences.steps(findings),
    )
