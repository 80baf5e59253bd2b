"""A diagnosis of a wrench in words."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from wrenchbed.diagnosis.decision.decide import LARGEST_NONE, small
from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.diagnosis.next.blind import unseen
from wrenchbed.diagnosis.prepare.contact import CONTACT
from wrenchbed.pages import numbers
from wrenchbed.reports.answer import MOST_HEADLINE, TOO_MANY, Answer, the
from wrenchbed.reports.claim import capital, joints_or
from wrenchbed.reports.claim import place as place_of

LEAST_SHARE = 0.006
"""Share of the residual below which a variable is not mentioned."""
MOST_SEEN = 3
"""Most variables that are named where their part of the residual is too small for a cause."""
_KERNELS = {
    "orientation": "the sensor's orientation",
    "position": "the sensor's position",
    "direction": "the direction from which the joints came",
    "speed": "speed and acceleration",
}
_GAP = "the gap"
_ROWS = "how rows scatter"
_BLIND = ". These data cannot show "


class WrenchAnswer(Answer):
    """A diagnosis of a wrench in words.

    Attributes:
        row_effects: names of claimed effects that show in single rows, not in poses' means.
        row_sentences: sentences on all effects that show in single rows only.
        variable: phrase for the variable on which an unexplained residual depends most.
    """

    def __init__(self, findings: Findings) -> None:
        super().__init__(findings.diagnosis, findings.verdict.alike)
        self.findings = findings
        usual = findings.analysis.prepared.channels[0].usual
        self.fitted = f"{usual} fitted, as every user does"
        self.row_effects = frozenset(r.effect for r in findings.rows)
        self.row_sentences = [r.sentence for r in findings.rows]
        self.notes = list(dict.fromkeys([*self.row_sentences, *self.notes]))
        local = [f.variable for f in findings.places if f.seen and " between " in f.variable]
        self._kernel = local[0] if local else findings.analysis.ranking.kernel
        self.variable = _KERNELS.get(self._kernel, self._kernel)

    @property
    def about(self) -> str:
        d = self.d
        return f"{', '.join((d.recording, *d.others))}  {d.robot}, {d.seconds:.1f} s"

    @property
    def only_rows(self) -> bool:
        """Whether all claimed causes show only in how a pose's rows scatter, not in their mean."""
        return bool(self.row_effects) and all(c.name in self.row_effects for c in self.causes)

    @property
    def no_claim(self) -> str:
        if self.d.verdict == NONE:
            text = "No cause found: the residual is within normal imperfections"
            small = ", ".join(str(e["effect"]) for e in self.d.minor)
            text += f"; detected, but below what counts: {small}" if small else ""
            names = unseen(self.d.blind, MOST_HEADLINE - len(text) - len(_BLIND))
            return f"{text}{_BLIND}{names}." if names else f"{text}."
        if self.alike:
            return TOO_MANY
        follows = self._unexplained == _GAP and self._follows and self._agrees
        varies = f": it varies with {self.variable}" if follows else ""
        within = self.loudest if self._unexplained == _GAP else ""
        if self._unexplained == _ROWS:
            within = f": {self.findings.scattered.partition('. ')[0]}"
        return f"No known effect explains {self._unexplained}{within}{varies}."

    @property
    def no_cause(self) -> str:
        if self.d.verdict == NONE:
            return (
                f"With probability {self.chance_of(NONE)} nothing counts as a cause: many small "
                "imperfections together are normal, and a cause adds a gap of at least 1."
            )
        if self.alike:
            return f"{self.d.cannot_tell[0]}: no choice is made."
        return self.unknown(self._unexplained)

    @property
    def place(self) -> str:
        if not self.d.which:
            return self._hint
        phrases = []
        for w in self.d.which:
            places = dict.fromkeys(map(place_of, (w, *w["rivals"])))
            phrases.append(" or ".join(f"in {the(place)}" for place in places))
        known = listed(dict.fromkeys(phrases), "and")
        return f"Mostly not {known}" if self.d.verdict == "partial" else capital(known)

    @property
    def _hint(self) -> str:
        if self._most is not None:
            detail, part = str(self._most["detail"]), str(self._most["subsystem"])
            if detail in self.d.gap.per_channel:
                part = f"channel {detail}"
            return f"Only a hint: {the(detail if detail[-1:].isdigit() else part)}"
        if self.d.where:
            subsystems = dict.fromkeys(the(str(w["subsystem"])) for w in self.d.where)
            return f"Only in single rows: {listed(subsystems, 'and')}"
        return "Too little for a cause" if self._seen else "No place differs from noise"

    @property
    def _most(self) -> Mapping[str, Any] | None:
        """Entry of ``where`` in diagnosis.json (joints, channels …) with the largest share of the
        gap; None if none has one."""
        shares = (w for w in self.d.where if float(w["share"]) > 0.0)
        return max(shares, key=lambda w: float(w["share"]), default=None)

    @property
    def _agrees(self) -> bool:
        """False if ``where`` in diagnosis.json puts another variable first than that which explains
        the residual best."""
        leading = "" if self._most is None else str(self._most["detail"])
        others = {f.variable for f in self.findings.places} - {self._kernel}
        return leading not in others or self._kernel.startswith(f"{leading} ")

    @property
    def where(self) -> Sequence[str]:
        phrases = [str(w["sentence"]) for w in self.d.where]
        if self.d.which:
            alike = {e for w in self.d.which if joints_or(w)[1:] for e in w["elements"]}
            seen = [f.sentence for f in self.findings.places if f.seen and f.share > LEAST_SHARE
                    and not any(e in f.variable for e in alike)]  # fmt: skip
            return phrases if self.only_rows or small(self.d.gap) else phrases + seen[:2]
        phrases = phrases[:2]
        if self.d.verdict == UNKNOWN and self._agrees:
            text = f"Of all recorded variables, the residual follows {self.variable} best"
            phrases.insert(0, f"{text}{'' if self._follows else ', but not significantly'}.")
        if self._seen and not phrases:
            more = [f"{len(self._seen) - MOST_SEEN} more"] * (len(self._seen) > MOST_SEEN)
            least = listed([*self._seen[:MOST_SEEN], *more], "and")
            phrases.append(f"What is left beyond noise is too small for a cause: {least}.")
        return phrases or ["No channel, joint or variable carries more than noise."]

    @cached_property
    def far(self) -> tuple[str, str]:
        g = self.d.gap
        if g.with_effects is not None:
            return self.shrinks()
        figure = f"Gap {numbers.gap(g.calibrated.value)}"
        if self.d.verdict == UNKNOWN and self._unexplained == _GAP:
            return figure, f"{self.stays} {self.black_box}".strip()
        text = f"This is the gap of the calibrated simulator {self.on}"
        own = f"{numbers.gap(min(g.floor, g.calibrated.value))} of it is how single rows scatter"
        if self.only_rows and self.causes:
            names = " and ".join(c.name for c in self.causes)
            if g.floor > LARGEST_NONE:
                return figure, f"{text}. {own}: the detected cause ({names})."
            text += f". The detected cause ({names}) scatters single rows; the means have no gap to"
            return figure, f"{text} close."
        if self.causes:
            return figure, f"{text}. Rows in which something touches the tool took no part."
        if g.floor > LARGEST_NONE:
            return figure, f"{text}. {own}; no cause is named."
        if g.calibrated.value - max(g.floor, 0.0) > LARGEST_NONE:
            ends = f"{numbers.gap(g.calibrated.low)} … {numbers.gap(g.calibrated.high)}"
            text += f". It is not significantly above 1: its 95 % interval is {ends}"
        return figure, f"{text}. No cause is named; there is nothing to close."

    @property
    def advice_without_experiment(self) -> str:
        closed = self.d.gap.closed is None or self.d.gap.closed.value > 0.0
        if self.d.verdict == NONE:
            return (
                "Nothing: the calibrated simulator in twin.json is as good as noise and normal "
                "imperfections allow."
            )
        places = self.place.removeprefix("In ").replace(" in ", " ")
        if self.d.verdict != "identified":
            check = f": check {places}" if self.d.verdict == "ambiguous" else ""
            return f"No experiment of the kinds considered would show more within minutes{check}."
        if self.distrusted or not closed:
            return "Do not use twin.json yet: record more poses, and diagnose both together."
        twin = (
            "holds the corrected simulator"
            if self.causes[0].name != CONTACT
            else "is without the contact"
        )
        return f"Nothing more has to be recorded: check {places}; twin.json {twin}."

    @property
    def black_box(self) -> str:
        share = self.d.gap.black_box
        if share is None or self.d.gap.calibrated.value < 1.0:
            return ""
        if share <= 0.0:
            return "A black-box model closes nothing of the calibrated gap."
        many = f"{'' if share >= 0.5 else 'only '}{numbers.percent(share)} % of the calibrated gap"
        text = f"A black-box model closes {many}"
        return f"{text}, so it repeats with what was recorded." if share >= 0.5 else f"{text}."

    @property
    def observations(self) -> str:
        p = self.findings.analysis.prepared
        return f"{int(p.judged.sum()):,} {p.observed}"

    @property
    def _seen(self) -> list[str]:
        """Names of channels and variables on which the residual depends significantly."""
        return [f.variable for f in self.findings.places if f.seen]

    @property
    def _follows(self) -> bool:
        """Whether the residual depends significantly on the variable that explains it best."""
        kernel = self._kernel
        return kernel in self._seen or (
            kernel == "direction" and any(v.startswith("direction") for v in self._seen)
        )

    @property
    def _unexplained(self) -> str:
        """Phrase for what no effect explains: the gap, or single rows if poses' means have none."""
        if self.d.verdict == UNKNOWN and small(self.d.gap):
            if self.findings.scattered:
                return _ROWS
            if self.findings.analysis.prepared.touch is not None:
                return "what comes while something touches the tool"
        return _GAP
