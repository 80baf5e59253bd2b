"""A diagnosis in words, for page, terminal and rerun: what wrenches and joint efforts share."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.diagnosis.explain.verdict import Key
from wrenchbed.diagnosis.next.blind import sentences
from wrenchbed.diagnosis.result import Diagnosis
from wrenchbed.pages import numbers
from wrenchbed.reports.claim import MOST_SIZES, Claim

BADGES = {"none": "✓", "identified": "●", "ambiguous": "◐", "partial": "◔", "unknown": "?"}
"""Symbol by verdict, shown beside its colour."""
MOST_HEADLINE = 160
"""Most characters of a headline: two lines of a terminal."""
MOST_CANDIDATES, LEAST_CANDIDATE = 8, 0.005
"""Most listed candidate causes, and least probability of one: below it prints as 0 %."""
LEAST_SCATTER = 0.05
"""Least gap by scatter of single rows that is stated apart from noise: below it prints as 0.0."""
LEAST_NEAREST = 0.05
"""Least probability at which the nearest cause is named beside "unknown": below, it is a guess."""
_DISTRUST = "do not trust the twin"
"""Text by which `Answer.distrusted` recognises the note on causes that leave much of the gap."""
_NAMED = ("all ", "channel ", "link ")
_COUNT = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")
_MEANING = {NONE: "none: normal imperfections", UNKNOWN: "unknown: something else"}


TOO_MANY = "More than five effects explain the gap alike; these data cannot tell them apart."
LOUD, MOST_LOUD = 2.0 / 3.0, 3
"""Channels are named that hold this share of the gap together, if they are at most so many."""


def the(place: str) -> str:
    """Name of a place with "the"; numbered places and channels have no article."""
    return place if place[-1].isdigit() or place.startswith(_NAMED) else f"the {place}"


class Answer(ABC):
    """Puts a diagnosis into words.

    Attributes:
        d: the diagnosis.
        fitted: phrase on the parameters that were fitted in the calibrated simulator.
        notes: further sentences for the reader.
        alike: causes that explain the gap equally well, where they are too many for a claim.
    """

    fitted: str

    def __init__(self, d: Diagnosis, alike: Sequence[Key]) -> None:
        self.d, self.alike = d, alike if d.verdict == UNKNOWN else ()
        self.notes = [*d.notes, *self.fitted_load]

    @property
    @abstractmethod
    def about(self) -> str:
        """Text on the diagnosed recordings, their robot and duration."""

    @cached_property
    def causes(self) -> Sequence[Claim]:
        """The causes that the diagnosis claims, in words, in the order of its JSON's ``which``."""
        return [self.claim_of(w) for w in self.d.which]

    @property
    @abstractmethod
    def no_claim(self) -> str:
        """Headline where no cause is claimed: the verdict in a sentence."""

    @property
    @abstractmethod
    def no_cause(self) -> str:
        """Text shown in place of a cause where none is claimed."""

    @property
    @abstractmethod
    def place(self) -> str:
        """Where in the robot the cause lies, in a few words."""

    @property
    def where(self) -> Sequence[str]:
        """Sentences on where in the robot the gap lies, the most important first."""
        return [str(w["sentence"]) for w in self.d.where]

    @property
    @abstractmethod
    def far(self) -> tuple[str, str]:
        """(number as text, may be empty; sentences) on how far the gap shrinks with the causes."""

    @property
    @abstractmethod
    def advice_without_experiment(self) -> str:
        """Sentence on what to do where no further experiment is proposed."""

    @property
    @abstractmethod
    def observations(self) -> str:
        """Text of the observations on which the gap was measured, such as ``20 poses``."""

    @property
    def on(self) -> str:
        """Phrase at the end of a sentence: on which held-out observations the gap is measured."""
        return f"on {self.observations} that were held out of every fit"

    @property
    def measure(self) -> str:
        """Phrase on the unit of a gap, and on what was fitted in the calibrated simulator."""
        as_noise = all(s.material == s.noise for s in self.d.scale.values())
        unit, noise = ("the noise of one row", "that") if as_noise else ("what counts", "one row's")
        return (
            f"gap: mean square of measured minus simulated in units of {unit}, minus {noise} "
            f"noise; calibrated: {self.fitted}"
        )

    @property
    def headline(self) -> str:
        """The verdict in sentences, as many values of each claim as two lines of a terminal hold,
        and what the claims leave open."""
        if not self.causes:
            return self.no_claim
        shapes = (MOST_SIZES, True), (1, True), (1, False), (0, True), (0, False)
        texts = [self._claims(*shape) for shape in shapes]
        return next((text for text in texts if len(text) <= MOST_HEADLINE), texts[-1])

    def _claims(self, most: int, ties: bool) -> str:
        """All claims as one text, each with at most ``most`` of its quantities; with ``ties`` it
        explains what “or” means."""
        phrases = [c.sentence(most) for c in self.causes]
        if len(phrases) > 1:
            phrases.insert(0, f"{_COUNT[len(phrases)]} causes.")
        if ties and self.d.verdict == "ambiguous":
            phrases.append("This recording does not distinguish the causes joined by “or”.")
        elif ties and any(c.rivals for c in self.causes):
            phrases.append("Without contact, the causes joined by “or” have the same effect.")
        if self.d.verdict == "partial":
            phrases.append("Most of the gap has another cause, which is unknown.")
        return " ".join(phrases)

    @property
    def steps(self) -> list[str]:
        """Sentences on what to do next."""
        return [str(n["sentence"]) for n in self.d.next] or [self.advice_without_experiment]

    @property
    def loudest(self) -> str:
        """Phrase on the channels that hold two thirds of the gap: ``, 91 % in fy and fx``; empty if
        more than `MOST_LOUD` share them."""
        gaps = {c: max(g["before"], 0.0) for c, g in self.d.gap.per_channel.items()}
        order = sorted(gaps, key=lambda c: -gaps[c])
        for k in range(1, MOST_LOUD + 1):
            part = sum(gaps[c] for c in order[:k])
            if part >= LOUD * sum(gaps.values()) > 0.0:
                return f", {part / sum(gaps.values()):.0%} in {listed(order[:k], 'and')}".replace(
                    "%", " %"
                )
        return ""

    @property
    def blind(self) -> tuple[str, ...]:
        """Sentences on effects that the recording could not have shown."""
        return sentences(self.d.blind)

    def claim_of(self, entry: Mapping[str, Any]) -> Claim:
        """Put an entry of ``which`` or ``minor``, lists of causes in diagnosis.json, into words."""
        return Claim(entry)

    @property
    def minor(self) -> list[str]:
        """Sentences on effects that were detected and are too small to count."""
        return [
            f"{self.claim_of(e).sentence()} Gap {numbers.gap(float(e['gap']))}, probability "
            f"{numbers.chance(float(e['probability']))}."
            for e in self.d.minor
        ]

    @property
    def fitted_load(self) -> list[str]:
        """Sentences on the fitted load, and on what further recordings carry beyond that."""
        result = []
        for k, number in enumerate(self.d.fitted):
            value = numbers.quantity("mass", number)
            if number["name"] == "tool.mass":
                known = number["stated"]
                stated = "none is stated" if known is None else f"{known:.4g} kg is stated"
                result.append(f"a load of {value} was fitted; {stated}")
            if number["name"] == "added.mass":
                centre = [numbers.quantity("cog", n) for n in self.d.fitted[k + 1 : k + 4]]
                result.append(
                    f"{number['recording']} carries {value} more than the first, its centre at "
                    f"({', '.join(centre)}), whatever the links weigh"
                )
        return result

    @property
    def black_box(self) -> str:
        """Sentence on the share of the gap that a black-box model closes; empty without a gap."""
        return ""

    @property
    def distrusted(self) -> bool:
        """Whether the causes leave so much of the gap that the corrected simulator is of no use."""
        return any(_DISTRUST in note for note in self.d.notes)

    @property
    def stays(self) -> str:
        """Sentences that say that the sim-to-real gap stays, where no cause is named."""
        own = f" {numbers.gap(self.d.gap.floor)} of it is how single rows scatter beyond noise."
        own *= self.d.gap.floor >= LEAST_SCATTER
        return f"It stays {self.on}: without a cause there is nothing to close it with.{own}"

    def shrinks(self) -> tuple[str, str]:
        """(number as text, sentences) on the share of the gap that the claimed causes close."""
        g = self.d.gap
        assert g.with_effects is not None
        start = f"The {g.closed_from} gap"
        both = f"from {numbers.gap(g.start)} to {numbers.gap(g.with_effects.value)}"
        if g.closed is None:
            return "", f"{start} goes {both} {self.on}; both are within the noise."
        if g.closed.value <= 0:
            text = f"The named effects make the {g.closed_from} gap larger, {both}, {self.on}"
            return "Not closed", f"{text}: do not use this twin."
        closed, low, high = (
            numbers.percent(min(x, 1.0)) for x in (g.closed.value, g.closed.low, g.closed.high)
        )
        text = f"{start} shrinks {both} {self.on}."
        text += f" 95 % interval of the share closed: {low} … {high} %."
        text += " Much of it is left: do not trust this twin." if self.distrusted else ""
        return f"{closed} % closed", text

    @property
    def distance(self) -> str:
        """Sentences on how far the gap shrinks, and on the share that a black-box model closes."""
        figure, text = self.far
        text = text if self.black_box in text else f"{text} {self.black_box}"
        return f"{figure}. {text}" if figure else text

    @property
    def bars(self) -> list[tuple[str, str]]:
        """(label, text of the gap) of each simulator and of noise alone, for a chart of bars."""
        g = self.d.gap
        rows = [("as configured", g.configured), ("calibrated", g.calibrated.value)]
        if g.with_effects is not None:
            rows.append(("with the effects", g.with_effects.value))
        alone = "rows' own scatter" if g.floor >= LEAST_SCATTER else "noise alone"
        rows.append((alone, g.floor))
        return [(label, numbers.gap(value)) for label, value in rows]

    @property
    def candidates(self) -> list[dict[str, str]]:
        """Texts of the leading causes by probability, always with "none" and "unknown"."""
        ranked = sorted(self.d.probabilities.items(), key=lambda kv: -kv[1])
        kept = [(k, p) for k, p in ranked if p >= LEAST_CANDIDATE][:MOST_CANDIDATES]
        kept += [(k, p) for k, p in ranked if k in _MEANING and (k, p) not in kept]
        return [
            {
                "key": k.replace("|", " or "),
                "name": _MEANING.get(k, k.replace("|", " or ")),
                "p": numbers.chance(p),
                "width": f"{100 * p:.1f}",
            }
            for k, p in kept
        ]

    @property
    def leading(self) -> str:
        """Text of the leading causes with probabilities, and of those likely to act together."""
        ranked = ", ".join(f"{c['key']} {c['p']}" for c in self.candidates)
        likely = ", ".join(self.d.set90)
        return f"leading cause: {ranked}; at least 90 % together: {likely}"

    @property
    def nearest(self) -> tuple[str, float]:
        """(name, probability) of the likeliest effect or look-alike effects; ("", 0) if none."""
        known = {k: p for k, p in self.d.probabilities.items() if k not in _MEANING}
        return max(known.items(), key=lambda kv: kv[1], default=("", 0.0))

    def chance_of(self, name: str) -> str:
        """Text of the probability of ``name``, which is ``none`` or ``unknown``."""
        return numbers.chance(self.d.probabilities.get(name, 0.0))

    def unknown(self, gap: str, hint: str = "") -> str:
        """Sentences: no known effect explains ``gap`` (a phrase); ``hint``; the nearest effect."""
        nearest, p = self.nearest
        text = f"No known effect explains {gap}. Probability that it is something unknown: "
        text += f"{self.chance_of(UNKNOWN)}.{hint}"
        if p >= LEAST_NEAREST:
            text += f" The nearest is {nearest.replace('|', ' or ')} with {numbers.chance(p)}."
        return text
