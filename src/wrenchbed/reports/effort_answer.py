"""The words of a diagnosis of joint efforts."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from wrenchbed.diagnosis.decision.decide import LEAST
from wrenchbed.diagnosis.efforts.answer import place as place_of
from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.diagnosis.efforts.names import title
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.pages import numbers
from wrenchbed.reports.answer import Answer
from wrenchbed.reports.claim import Claim, claim


class EffortAnswer(Answer):
    """A diagnosis of joint efforts in words.

    Args:
        findings: from ``diagnose_efforts``.

    Attributes:
        channels: what was diagnosed.
    """

    fitted = "what is not stated fitted; what is stated stays within its ordinary spread"
    observations = "blocks of time"

    def __init__(self, findings: EffortFindings) -> None:
        super().__init__(findings.diagnosis)
        self.findings = findings
        self.notes = [*self.notes, *self.fitted_load]
        alone = findings.d.scene.wrench is None
        self.channels = "joint efforts" if alone else "joint efforts and wrench"

    @property
    def about(self) -> str:
        return f"{self.d.recording}  {self.d.robot}, {self.channels}, {self.d.seconds:.1f} s"

    @cached_property
    def causes(self) -> Sequence[Claim]:
        claims = []
        for cause, entry in zip(self.findings.verdict.causes, self.d.which, strict=True):
            first, *others = cause.keys
            rivals = [(k[0] if k[0] != first[0] else place_of(k)[1], title(*k)) for k in others]
            claims.append(claim(entry, title(*first), rivals))
        return claims

    def claimed(self, entry: Mapping[str, Any]) -> Claim:
        return claim(
            entry, title(entry["effect"], entry["parameters"].get("joint", {}).get("value"))
        )

    @property
    def no_claim(self) -> str:
        if self.d.verdict != NONE:
            return "No known effect explains the gap."
        if self.unstated:
            return f"No cause found beside what nobody states and was fitted: {self.unstated}."
        return "No cause found: the residual is within normal imperfections."

    @cached_property
    def unstated(self) -> str:
        """What a fit makes up that counts, because nobody states it; empty if that is nothing."""
        if self.d.gap.configured < LEAST:
            return ""
        names, scene = [str(number["name"]) for number in self.d.fitted], self.findings.d.scene
        joints = [f"joint {n.rpartition('.')[2]}" for n in names if n.startswith("drive.coulomb.")]
        phrases = [f"friction of {listed(joints, 'and')}"] if joints else []
        if "tool.mass" in names:
            load = numbers.quantity("mass", self.d.fitted[names.index("tool.mass")])
            mass = float(scene.model.robot.tool(scene.theta).mass)
            phrases.insert(0, f"a load of {load} (the robot's model has {mass:.4g} kg)")
        return " and ".join(phrases)

    @property
    def no_cause(self) -> str:
        if self.d.verdict == NONE:
            return f"With probability {self.chance_of(NONE)} nothing counts as a cause."
        outside = self.findings.outside
        return self.unknown("the gap", f" It looks most like: {outside}." if outside else "")

    @property
    def place(self) -> str:
        if self.findings.verdict.causes:
            places = dict.fromkeys(place_of(c.part.key)[1] for c in self.findings.verdict.causes)
            partial = self.d.verdict == "partial"
            return f"{'Mostly not in' if partial else 'In'} {', '.join(places)}"
        if self.d.where:
            return f"Only a hint: {self.d.where[0]['detail']}"
        return "No joint has more than noise and ordinary imperfections"

    @property
    def where(self) -> Sequence[str]:
        return [str(w["sentence"]) for w in self.d.where]

    @property
    def far(self) -> tuple[str, str]:
        g = self.d.gap
        if g.with_effects is None:
            text = f"This is the gap of the calibrated simulator {self.on}"
            return (
                f"Gap {numbers.gap(g.calibrated.value)}",
                f"{text}. No cause is named; there is nothing to close.",
            )
        before = g.configured if self.findings.of_configured else g.calibrated.value
        return self.shrinks(before)

    @property
    def nothing_more(self) -> str:
        if self.d.verdict == NONE and self.unstated:
            gap = numbers.gap(self.d.gap.configured)
            return f"State tool and drives: what is fitted makes up a gap of {gap} and is no cause."
        if self.d.verdict == NONE:
            return "Nothing: the stated robot predicts these efforts as well as noise allows."
        if self.d.verdict == "identified":
            places = dict.fromkeys(str(w["detail"]) for w in self.d.where)
            phrases = [p if p[-1].isdigit() else f"the {p}" for p in places]
            return f"drives.json contains the corrected values; look at {' and '.join(phrases)}."
        return "Record a longer motion of all joints, at several speeds in both directions."
