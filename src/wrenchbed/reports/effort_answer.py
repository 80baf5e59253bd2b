"""The words of a diagnosis of joint efforts, and its figures: measured and predicted efforts, their
residual, and each joint's friction."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from wrenchbed.diagnosis.decision.decide import LEAST, small
from wrenchbed.diagnosis.efforts.columns import place as place_of
from wrenchbed.diagnosis.efforts.columns import title
from wrenchbed.diagnosis.efforts.diagnose_efforts import EffortFindings
from wrenchbed.diagnosis.efforts.fitted_causes import remaining
from wrenchbed.diagnosis.evidence.search import NONE, UNKNOWN
from wrenchbed.diagnosis.explain.elements import listed
from wrenchbed.pages import numbers
from wrenchbed.pages.chart import Axis, Chart, Kind, Panel, Role, Series, thinned
from wrenchbed.reports.answer import TOO_MANY, Answer, the
from wrenchbed.reports.claim import Claim
from wrenchbed.reports.figures import residual_map

_SHOWN_S = 15.0
"""Time of a motion that is shown [s]: several reversals of each joint are in view."""
_BINS = 24
"""Number of bins of speed in which friction is averaged."""
_SERVOS = {
    "drive.constant": "the stiffness of joint {joint}'s servo is divided by 1 + gain",
    "drive.delay": "the servo of joint {joint} acts late on its command",
}
"""Titles of drive effects where efforts are tracking errors times stiffness, by name."""
_FRICTION: tuple[tuple[str, Kind, Role], ...] = (
    ("measured", "points", "measured"), ("stated", "line", "before"),
    ("with the effects", "line", "after"),
)  # fmt: skip


class EffortAnswer(Answer):
    """A diagnosis of joint efforts in words; ``channels`` says if the wrench is part of it."""

    fitted = "what is not stated fitted; what is stated stays within its ordinary spread"
    observations = "blocks of time"

    def __init__(self, findings: EffortFindings) -> None:
        super().__init__(findings.diagnosis, findings.verdict.alike)
        self.findings = findings
        scene = findings.d.scene
        self.channels = "joint efforts" if scene.wrench is None else "joint efforts and wrench"
        self.channels = "commands and joint values" if scene.commanded else self.channels

    @property
    def about(self) -> str:
        return f"{self.d.recording}  {self.d.robot}, {self.channels}, {self.d.seconds:.1f} s"

    @cached_property
    def causes(self) -> Sequence[Claim]:
        claims, servos = [], _SERVOS if self.findings.d.scene.commanded else {}
        for cause, entry in zip(self.findings.verdict.causes, self.d.which, strict=True):
            first, *others = cause.keys
            words = {k: servos.get(k[0], title(*k)).format(joint=k[1]) for k in cause.keys}
            rivals = [(k[0] if k[0] != first[0] else place_of(k), words[k]) for k in others]
            claims.append(Claim(entry, words[first], rivals))
        return claims

    def claim_of(self, entry: Mapping[str, Any]) -> Claim:
        first, *others = (
            (e["effect"], title(e["effect"], e["parameters"].get("joint", {}).get("value")))
            for e in (entry, *entry["rivals"])
        )
        return Claim(entry, first[1], others)

    @property
    def no_claim(self) -> str:
        if self._sign:
            return f"The gap is small, but no known effect explains this. {self._sign[1]}."
        if self.d.verdict != NONE:
            return TOO_MANY if self.alike else f"No known effect explains the gap{self.loudest}."
        if self.unstated:
            return f"No cause found beside what nobody states and was fitted: {self.unstated}."
        return "No cause found: the residual is within normal imperfections."

    @cached_property
    def _sign(self) -> tuple[str, str] | None:
        """(place, sentence) of what is no ordinary noise although the gap may be noise, if any."""
        if self.d.verdict != UNKNOWN or self.alike or not small(self.d.gap):
            return None
        signs = ((w["detail"], w["sentence"]) for w in self.d.where if not w["share"])
        return next(((at, text.removesuffix(": no cause is claimed.")) for at, text in signs), None)

    @cached_property
    def unstated(self) -> str:
        """Phrase on what was fitted because no metadata state it, a load or joints' friction; empty
        if the gap before that fit is too small to count."""
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
        if self.alike:
            return f"{self.d.cannot_tell[0]}: no choice is made."
        outside = self.findings.outside
        what = f"what {self._sign[0]} shows" if self._sign else "the gap"
        return self.unknown(what, f" It looks most like: {outside}." if outside else "")

    @property
    def place(self) -> str:
        if self.d.which:
            keys = (c.keys for c in self.findings.verdict.causes)
            each = (dict.fromkeys(the(place_of(key)) for key in of_one) for of_one in keys)
            mostly = "Mostly not in" if self.d.verdict == "partial" else "In"
            return f"{mostly} {', '.join(dict.fromkeys(map(' or '.join, each)))}"
        if self.d.where:
            return f"Only a hint: {the(str(self.d.where[0]['detail']))}"
        return "No joint has more than noise and ordinary imperfections"

    @property
    def far(self) -> tuple[str, str]:
        if self.d.gap.with_effects is not None:
            return self.shrinks()
        text = f"This is the gap of the calibrated simulator {self.on}."
        text += " No cause is named; there is nothing to close."
        stays = self.d.verdict != NONE and not self._sign
        return f"Gap {numbers.gap(self.d.gap.calibrated.value)}", self.stays if stays else text

    @property
    def advice_without_experiment(self) -> str:
        if self.d.verdict == NONE and self.unstated:
            gap = numbers.gap(self.d.gap.configured)
            return f"State tool and drives: what is fitted makes up a gap of {gap} and is no cause."
        if self.d.verdict == NONE:
            return "Nothing: with ordinary errors the stated robot predicts all but noise."
        places = dict.fromkeys(the(str(w["detail"])) for w in self.d.where)
        return f"drives.json contains the corrected values; look at {' and '.join(places)}."


def effort_charts(findings: EffortFindings) -> list[Chart]:
    """Charts of efforts over time, then of the friction of joints that are a cause or fit worst."""
    return [_efforts(findings), *(_friction(findings, j) for j in _joints(findings))]


def shown_rows(findings: EffortFindings) -> np.ndarray:
    """Indices (K,), among the rows that were diagnosed, of the stretch of time that is drawn."""
    scene = findings.d.scene
    t = scene.signals.t[scene.kept()]
    return np.flatnonzero(np.abs(t - 0.5 * (t[0] + t[-1])) <= 0.5 * _SHOWN_S)


def residuals_of(findings: EffortFindings) -> dict[str, np.ndarray]:
    """Simulator → residual (M, C) of the diagnosed rows [noise of a row], from fits that did not
    see them; NaN where a joint hardly moves, which does not count."""
    d, counted = findings.d, np.stack([c.use for c in findings.d.channels], axis=-1)
    fits = {"calibrated": findings.simulators.of().each}
    if findings.verdict.causes:
        fits["with the effects"] = findings.fit.each
    return {name: np.where(counted, remaining(d, each), np.nan) for name, each in fits.items()}


def effort_map(findings: EffortFindings) -> Chart:
    """Map of the residuals of all channels over the time of the motion."""
    scene, residuals = findings.d.scene, residuals_of(findings)
    t, names = scene.signals.t[scene.kept()], [column for _, column, _ in scene.channels]
    return residual_map(names, residuals, np.arange(len(t)), (t, Axis("time", "s")), "rows")


def _joints(findings: EffortFindings) -> list[int]:
    """Joints, from 0, whose friction is drawn: those of claimed causes, else the one of largest
    gap."""
    keys = (key for cause in findings.verdict.causes for key in cause.keys)
    named = [j - 1 for name, j in keys if j is not None and name.startswith("drive.")]
    if named or findings.diagnosis.verdict == "none":
        return list(dict.fromkeys(named))[:2]
    gaps = [v["before"] for v in findings.diagnosis.gap.per_channel.values()]
    return [int(np.argmax(gaps[: findings.d.scene.joints]))]


def _efforts(findings: EffortFindings) -> Chart:
    """Chart of efforts of all joints on held-out rows over a stretch of time, beside the residuals
    of the predictions."""
    scene, std = findings.d.scene, [c.std for c in findings.d.channels]
    kept = scene.kept()
    t, rows = scene.signals.t[kept], shown_rows(findings)
    measured = scene.thin(scene.signals.effort)
    roles: tuple[Role, ...] = ("before", "after")
    every = list(zip(roles, residuals_of(findings).items(), strict=False))
    panels, note = [], ""
    for j, joint in enumerate(scene.robot.joints[: scene.joints]):
        efforts = [Series("measured", "line", t[rows], measured[rows, j], ids=rows)]
        residuals = list[Series]()
        for role, (label, residual) in every:
            remainders = residual[rows, j]
            predicted = measured[rows, j] - std[j] * remainders
            for series, y in ((efforts, predicted), (residuals, remainders)):
                series.append(Series(label, "line", t[rows], y, role=role, ids=rows))
        units = (f"joint {j + 1}", joint.own("N·m")), (f"joint {j + 1}, residual", "noise")
        for (label, unit), series in zip(units, (efforts, residuals), strict=True):
            some, note = thinned(series, what="rows")
            axis = Axis(label, unit)
            panels.append(Panel(Axis("time", "s"), axis, some, zero=unit == "noise", height=0.8))
    caption = (
        "On the left efforts, on the right measured minus predicted in units of the noise of a "
        "row. Predictions are by fits that did not see the rows; a joint that hardly moves has "
        "none."
    )
    return Chart("efforts", "Measured and predicted efforts", tuple(panels), 2, True, caption, note)


def _friction(findings: EffortFindings, j: int) -> Chart:
    """Chart of joint j's (from 0) friction over its speed: measured, stated and with the effects.

    The fitted effort of links and load is subtracted.
    """
    d, scene, channel = findings.d, findings.d.scene, findings.d.channels[j]
    speed = scene.q.d[scene.kept(), j]
    stated = scene.thin(scene.friction[:, j])
    arm = d.joint[channel.at] < 0
    measured = stated + channel.y - channel.data[:, arm] @ findings.fit.x[channel.at[arm]]
    efforts = [speed, measured, stated]
    if findings.verdict.causes:
        efforts.append(measured - channel.std * remaining(d, findings.fit.each)[:, j])
    edges = np.unique(np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1)))
    at = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, len(edges) - 2)
    x, *means = (np.bincount(at, values) / np.bincount(at) for values in efforts)
    series = [
        Series(name, kind, x, y, role=role)
        for y, (name, kind, role) in zip(means, _FRICTION, strict=False)
    ]
    unit = scene.robot.joints[j].own
    up = Axis("effort less rigid body", unit("N·m"))
    panel = Panel(Axis("speed", unit("rad/s")), up, tuple(series), zero=True)
    caption = "Means over bins of speed; what depends on angle or load alone averages out."
    return Chart(f"friction-{j + 1}", f"Friction of joint {j + 1}", (panel,), caption=caption)
