"""What a motion without joints shows apart from its averages: a touch, and a tool that trembles."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from wrenchbed.diagnosis import oriented, touching, trembling
from wrenchbed.diagnosis.prepare import Prepared, prepare
from wrenchbed.diagnosis.result import Diagnosis
from wrenchbed.diagnosis.rows import RowFinding
from wrenchbed.diagnosis.search import NONE, UNKNOWN
from wrenchbed.diagnosis.touching import CONTACT, SURE, Touch
from wrenchbed.recording import Recording

LEAST = 0.9
"""Probability that another cause needs beside a touch: few rows are left to tell it from others."""


@dataclass(frozen=True, eq=False)
class Apart:
    """What is told beside the causes of the averages.

    Attributes:
        touch: of the tool; its rows took no part in the analysis.
        trembling: as a cause that shows between rows.
    """

    touch: Touch | None = None
    trembling: tuple[RowFinding, ...] = ()

    def told(self, d: Diagnosis) -> Diagnosis:
        """The diagnosis of the rows that nothing touched, with the touch."""
        t = self.touch
        if t is None:
            return d
        left = f"the other answers are of the {int((~t.rows).sum())} averages without it"
        notes = (*d.notes, t.sentence, left)
        if t.parameters is None:
            spare = {UNKNOWN: 1.0}
            return replace(d, verdict=UNKNOWN, which=[], probabilities=spare, notes=notes)
        cause = {
            "effect": CONTACT,
            "probability": SURE,
            "rivals": [],
            "parameters": t.parameters,
            "closed_share": None,
        }
        kept = [w for w in d.which if float(w["probability"]) >= LEAST]
        lost = [f"{w['effect']} (" for w in d.which if w not in kept]
        other = [w for w in d.where if not any(name in str(w["sentence"]) for name in lost)]
        p_value = 1.0 - SURE
        entry = {
            "subsystem": "environment", "detail": t.detail, "share": t.share, "p_value": p_value,
            "sentence": f"{100 * t.share:.0f} % of the squared force that weight and inertia leave "
            f"lies in the environment: {CONTACT} ({t.detail}).",
        }  # fmt: skip
        return replace(
            d,
            verdict="identified" if d.verdict in (NONE, UNKNOWN) else d.verdict,
            which=[cause, *kept],
            where=[entry, *(_scaled(w, 1.0 - t.share) for w in other)],
            probabilities={CONTACT: SURE}
            | {k: (1.0 - SURE) * v for k, v in d.probabilities.items()},
            notes=notes,
        )


def parted(recording: Recording, seed: int = 0) -> tuple[Prepared, Apart]:
    """A recording made ready, without the rows in which something touches a bare tool.

    Raises:
        DiagnosisError: the data cannot answer, and why.
    """
    if not oriented.applies(recording):
        return prepare(recording, seed), Apart()
    prepared = oriented.prepare(recording, seed)
    touch, shaken = touching.find(prepared), trembling.find(prepared)
    few = prepared if touch is None else touching.without(prepared, touch.rows)
    return few, Apart(touch, () if shaken is None else (shaken,))


def _scaled(entry: Mapping[str, Any], share: float) -> dict[str, Any]:
    """An entry of ``where`` with its share of what a touch leaves."""
    return dict(entry) | {
        "share": share * float(entry["share"]),
        "sentence": f"{str(entry['sentence']).rstrip('.')}, untouched.",
    }
