"""What a report draws: each simulator against the recording, and each cause without the others."""

from dataclasses import dataclass, replace

import numpy as np

from wrenchbed.diagnosis.diagnose import Findings
from wrenchbed.diagnosis.explain.outliers import pose_numbers
from wrenchbed.diagnosis.gap.held_out import calibrated, simulated
from wrenchbed.diagnosis.prepare.configured_simulator import STATED
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.pages.chart import Axis
from wrenchbed.pages.numbers import HUMAN
from wrenchbed.robots.base import Joint
from wrenchbed.twin.twin import Twin


@dataclass(frozen=True, eq=False)
class Cause:
    """A claimed cause in numbers, apart from all others, at H observations of C channels.

    Attributes:
        name: name of the effect, or of the stated numbers that are wrong.
        active: the effect as fitted; None for stated numbers.
        rest: the diagnosed simulator without this cause.
        effect: what the cause adds to the simulated readings (H, C).
        measured: readings minus the simulator without it (H, C), by fits that did not see them.
    """

    name: str
    active: ActiveEffect | None
    rest: Twin
    effect: np.ndarray
    measured: np.ndarray


class HeldOutReadings:
    """Readings of simulators at H observations of C channels, from fits that did not see them.

    Attributes:
        names, units: of the channels (C,).
        ids: numbers of the observations (H,): of the recording's poses, else 0, 1, ….
        std: noise of a row (C,).
        first: name of the simulator without effects, ``calibrated`` or ``as configured``.
        before, after: its readings, and those with the effects (H, C); None without a claim.
    """

    def __init__(self, findings: Findings) -> None:
        a, gap = findings.analysis, findings.diagnosis.gap
        p = a.prepared.leading
        self.findings, self.prepared, self.twin = findings, p, findings.diagnosis.twin
        self.ids = np.arange(len(p.y)) if p.moving or p.averaged else pose_numbers(p)
        self.names, self.units = tuple(p.units), tuple(p.units.values())
        self.std = p.row_sigma
        stated = gap.closed_from == "configured"
        self.first = "as configured" if stated else "calibrated"
        self.start = Twin(p.model, p.theta) if stated else calibrated(a)
        readings = {k: v[p.scene.held] for k, v in gap.readings.items()}
        self.before = self.of(self.start) if stated else readings["calibrated"]
        self.after = readings.get("with_effects")

    @property
    def residuals(self) -> dict[str, np.ndarray]:
        """Name of a simulator → measured minus simulated (H, C) [noise of a row]."""
        readings = {self.first: self.before, "with the effects": self.after}
        y, known = self.prepared.y, readings.items()
        return {name: (y - read) / self.std for name, read in known if read is not None}

    def causes(self) -> list[Cause]:
        """Claimed causes that show in poses' means: active effects, then wrong stated numbers."""
        if self.after is None:
            return []
        rests: list[tuple[str, ActiveEffect | None, Twin]] = []
        for active in self.twin.active:
            others = tuple(x for x in self.twin.active if x is not active)
            rests.append((active.effect.name, active, replace(self.twin, active=others)))
        named = (str(w["effect"]) for w in self.findings.diagnosis.which)
        if wrong := [n for n in named if n in STATED]:
            stated = replace(self.twin, theta=self.prepared.theta)
            rests.append((" and ".join(wrong), None, stated))
        effects = [self.of(self.twin) - self.of(rest) for _, _, rest in rests]
        return [
            Cause(name, active, rest, effect, self.prepared.y - self.after + effect)
            for (name, active, rest), effect in zip(rests, effects, strict=True)
        ]

    def of(self, twin: Twin) -> np.ndarray:
        """Readings (H, C) of a simulator, a `Twin`, at the H observations, in C channels."""
        return simulated(self.prepared, twin)[self.prepared.scene.held]


def joint_axis(joint: Joint, number: int) -> tuple[Axis, float]:
    """Axis of joint ``number`` (from 1) in ° or mm, and the factor to that unit from SI."""
    unit, factor = HUMAN[joint.unit]
    return Axis(f"joint {number}", unit), factor


def along(p: Prepared) -> tuple[np.ndarray, Axis]:
    """Values (H,) and axis over which prepared observations p are drawn: time [s], or the poses'
    numbers in the recording."""
    if p.moving or p.averaged:
        return p.scene.t[p.scene.held], Axis("time", "s")
    return pose_numbers(p), Axis("number of the pose")


def largest(effect: np.ndarray) -> int:
    """Index of the channel in which an effect (H, C), in units of noise, is largest by squares."""
    size = ((effect - effect.mean(axis=0)) ** 2).sum(axis=0) + (effect**2).sum(axis=0)
    return int(np.argmax(size))
