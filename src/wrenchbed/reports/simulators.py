"""What a report draws: each simulator against the recording, channel by channel."""

from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.explain.outliers import pose_numbers
from wrenchbed.diagnosis.gap.closure import calibrated
from wrenchbed.diagnosis.gap.held_out import HeldOut
from wrenchbed.diagnosis.prepare.configuration import STATED
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.twin.twin import Twin

SECOND_CHANNEL = 0.1
"""A second channel is drawn if it holds this share of what the first one does."""


@dataclass(frozen=True, eq=False)
class Claim:
    """A claimed cause, apart from all others.

    Attributes:
        name: of the effect, or of the stated numbers that are wrong.
        active: the effect as fitted, None for stated numbers.
        rest: the diagnosed simulator without it.
        effect: what it adds to the readings (H, 6), in the simulator.
        measured: minus the simulator without it (H, 6), by fits that did not see the rows.
    """

    name: str
    active: ActiveEffect | None
    rest: Twin
    effect: np.ndarray
    measured: np.ndarray


class Evidence:
    """Readings of the simulators at the observations (H, 6), by fits that did not see them."""

    def __init__(self, findings: Findings) -> None:
        a = findings.analysis
        self.findings, self.prepared, self.twin = findings, a.prepared, findings.diagnosis.twin
        self.ids = _numbers(a.prepared)
        self.std = np.sqrt(np.diagonal(a.prepared.covariance))
        claimed = findings.diagnosis.gap.with_effects is not None
        wrong_only = claimed and not self.twin.active
        self.first = "as configured" if wrong_only else "calibrated"
        self.start = Twin(a.prepared.model, a.prepared.theta) if wrong_only else calibrated(a)
        readings = {k: v[a.prepared.scene.held] for k, v in findings.diagnosis.gap.readings.items()}
        self.calibrated = readings["calibrated"]
        self.before = self.of(self.start) if wrong_only else self.calibrated
        self.after = readings.get("with_effects")

    def channels(self) -> tuple[dict[str, float], dict[str, float], str]:
        """Gap of each channel on held-out rows, before and after (empty without a claim), and what
        the simulator is before."""
        known = self.findings.diagnosis.gap.per_channel
        before = {c: float(v["before"]) for c, v in known.items()}
        if self.first == "as configured":
            gaps = HeldOut(self.prepared).channels(self.start.wrench(self.prepared.scene))
            before = dict(zip(CHANNELS, map(float, gaps), strict=True))
        after = {c: float(v["after"]) for c, v in known.items() if v.get("after") is not None}
        return before, after, self.first

    def claims(self) -> list[Claim]:
        """What is claimed and shows in the means: active effects, then wrong stated numbers."""
        if self.after is None:
            return []
        twin, p = self.twin, self.prepared
        result = []
        for k, active in enumerate(twin.active):
            others = tuple(x for i, x in enumerate(twin.active) if i != k)
            rest = replace(twin, active=others)
            result.append(self._claim(active.effect.name, active, rest))
        named = [str(w["effect"]) for w in self.findings.diagnosis.which]
        wrong = [n for n in named if n in STATED]
        if wrong:
            result.append(self._claim(" and ".join(wrong), None, replace(twin, theta=p.theta)))
        return result

    def of(self, twin: Twin) -> np.ndarray:
        """Readings (H, 6) of a simulator at the observations."""
        return np.asarray(twin.wrench(self.prepared.scene)[self.prepared.scene.held])

    def _claim(self, name: str, active: ActiveEffect | None, rest: Twin) -> Claim:
        assert self.after is not None
        effect = self.of(self.twin) - self.of(rest)
        return Claim(name, active, rest, effect, self.prepared.y - self.after + effect)

    def variable(self) -> tuple[np.ndarray, str, str]:
        """A joint where one is to blame or seen, else `along`: values (H,), axis, words."""
        p = self.prepared
        joints = p.model.robot.joints if p.scene.jointed else ()
        for k in _blamed(self.findings):
            if 1 <= k <= len(joints):
                x, turns = p.poses[:, k - 1], joints[k - 1].unit == "rad"
                label = f"joint {k} [{'°' if turns else 'mm'}]"
                return (np.rad2deg(x) if turns else 1e3 * x), label, f"over joint {k}"
        return along(p)


def along(p: Prepared) -> tuple[np.ndarray, str, str]:
    """What observations are drawn over: values (H,), label of the axis, words.

    Poses have the numbers that the recording gives them, as in diagnosis.json.
    """
    if p.moving or p.averaged:
        return p.scene.t[p.scene.held], "time [s]", "over time"
    return pose_numbers(p), "number of the pose", "over the poses"


def _numbers(p: Prepared) -> np.ndarray:
    """Numbers of the observations (H,): of poses as in `along`, of samples their order from 0."""
    return np.arange(len(p.y)) if p.moving or p.averaged else pose_numbers(p)


def _blamed(findings: Findings) -> list[int]:
    """Joints that may tell most: of a claim, of the best unknown, of what is seen."""
    told = [w["parameters"].get("joint", {}).get("value") for w in findings.diagnosis.which]
    names = [f.variable for f in findings.places if f.seen and f.share > 0.05][:1]
    if findings.diagnosis.verdict == "unknown":
        names.insert(0, findings.analysis.ranking.kernel)
    told += [int(n.split()[-1]) for n in names if n.startswith("joint ")]
    return [k for k in told if isinstance(k, int)]


def largest(effect: np.ndarray) -> list[int]:
    """One or two channels in which an effect (H, 6) shows most."""
    size = ((effect - effect.mean(axis=0)) ** 2).sum(axis=0) + (effect**2).sum(axis=0)
    first, second = (int(k) for k in np.argsort(-size)[:2])
    return [first, second] if size[second] > SECOND_CHANNEL * size[first] else [first]
