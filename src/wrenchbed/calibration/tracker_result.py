"""Result of a fit to a tracker's readings: geometry with uncertainty, and held-out errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrenchbed.calibration.fit import IdentifiedValue, WrittenFit, entries, head
from wrenchbed.calibration.observability import Observability

SPRINGS, COMPLIANCE = "joint.compliance", "compliance.q"
"""Effect of compliant joints; begin of names of their compliances, before the joint's number."""
MISFIT = 1.5
"""Largest ratio of held-out error to that by noise alone: misfit √(1.5² − 1) = 1.1 × noise."""
FOLLOWS = 0.5
"""Largest held-out error of the stated geometry, over the extent of the measured positions: forces
and torques in their columns leave 0.4 to 0.98, zeros that are 20° off 0.45."""
_LOOSE = 0.02
"""Standard uncertainty of the tracker's rotation [rad] from which its linear fit misleads."""


@dataclass(frozen=True, eq=False)
class TrackerFit(WrittenFit):
    """A fit of a robot's geometry to positions of a target on its flange, measured by a tracker.

    Attributes:
        identified: the free parameters: geometry and compliances.
        theta: all parameters of robot and sensor by name, fitted or fixed.
        gravity: world axes (3,) [m/s²].
        stand: the tracker's pose, rotation vector [rad] and shift [m] from the world to its axes,
            and the target's position in sensor axes [m], by name.
        loose: largest standard uncertainty of the tracker's rotation about an axis [rad].
        covariance: covariance of the identified parameters (K, K).
        noise: standard deviation of the fit's residual per axis [m], free parameters counted.
        repeats: noise of a pose's mean by its rows [m]; None without repeats.
        held_out: rms distance of poses from fits without them [m].
        before: ``held_out`` of the stated geometry; only tracker and target positions are fitted.
        bound: expectation of ``held_out`` by noise and number of poses alone (Cramér–Rao) [m].
        accuracy: rms error [m] of the fitted positions at these poses, by the fit's covariance.
        extent: rms distance of the measured positions from their mean [m].
        residual: measured minus fitted positions (H, 3) [m].
    """

    recording: str
    robot: str
    converged: bool
    iterations: int
    identified: tuple[IdentifiedValue, ...]
    theta: Mapping[str, float]
    gravity: tuple[float, ...]
    stand: Mapping[str, float]
    loose: float
    covariance: np.ndarray
    noise: float
    repeats: float | None
    held_out: float
    before: float
    bound: float
    accuracy: float
    extent: float
    residual: np.ndarray
    poses: int
    rows: int
    observability: Observability

    @property
    def compliance(self) -> dict[str, float]:
        """Compliance of each joint by name, ``compliance.q2`` [rad/(N·m); m/N for slides]."""
        return {p.name: p.value for p in self.identified if p.name.startswith(COMPLIANCE)}

    @property
    def errors(self) -> tuple[tuple[str, float], ...]:
        """Labels and values [m] of the rms position errors that a report compares."""
        return (
            ("held-out poses, geometry as stated", self.before),
            ("held-out poses, geometry as fitted", self.held_out),
            ("of that, noise and number of poses", self.bound),
            ("fit from the true places, by its covariance", self.accuracy),
        )

    @property
    def cannot_tell(self) -> tuple[str, ...]:
        """Sentences on parameters that these poses do not determine."""
        hidden, rest = list(self.observability.no_effect), list[str]()
        for r in self.observability.redundancies:
            of_arm = [n for n in r.names if n not in self.stand]
            if len(of_arm) < len(r.names):
                hidden += of_arm
            else:
                rest.append(r.sentence)
        known = f"where tracker and target stand takes up {', '.join(sorted(set(hidden)))}"
        return (*([known] if hidden else []), *rest)

    @property
    def refuted(self) -> str | None:
        """Sentence on why the data refute the fitted geometry; None if they do not."""
        follows = self.before <= FOLLOWS * self.extent
        if not self.converged and self.loose > _LOOSE and follows:
            turn = min(np.rad2deg(self.loose), 180.0)
            return (
                f"these poses leave the tracker's turn free by ± {turn:.0f}°, as places along a "
                f"line do: not converged after {self.iterations} steps. Record places in all "
                "directions; --force gives values for poses like these alone, "
                f"{1e3 * self.held_out:.3g} mm off held out, {1e3 * self.before:.3g} mm as stated"
            )
        if not self.converged:
            return f"not converged after {self.iterations} steps: are these this robot's joints?"
        if not follows:
            return (
                f"mx my mz do not follow this arm: it leaves {1e3 * self.before:.3g} mm of "
                f"{1e3 * self.extent:.3g} mm. Is this the robot, and are these places in metres?"
            )
        if self.held_out >= self.before and self.noise >= MISFIT * (self.repeats or 0.0):
            return (
                f"poses that no fit saw are {1e3 * self.held_out:.3g} mm off, no nearer than with "
                f"the stated geometry ({1e3 * self.before:.3g} mm): --free fewer parameters, take "
                "the tolerances as a --prior, or record more poses"
            )
        return None

    @property
    def status(self) -> str:
        """Sentence on how far the fit can be trusted."""
        if self.refuted is not None:
            return f"refuted: {self.refuted}"
        text = (
            f"poses that no fit saw are {1e3 * self.held_out:.3g} mm off, {1e3 * self.before:.3g} "
            f"mm as stated; noise and {self.poses} poses make {1e3 * self.bound:.3g} mm of it"
        )
        if self.held_out >= self.before:
            text += ": the stated geometry holds, what is fitted is no more than noise"
        elif self.held_out > MISFIT * self.bound:
            text += ": the geometry does not hold all of it, diagnose the recording"
        elif self.repeats and self.noise > MISFIT * self.repeats:
            text += (
                f"; the noise is {1e3 * self.noise:.2g} mm a pose, rows within poses show "
                f"{1e3 * self.repeats:.2g} mm: something else moves, diagnose the recording"
            )
        return text

    def to_json(self) -> dict[str, Any]:
        """Return the content of the fit's JSON file."""
        o, springs = self.observability, {"effect": SPRINGS, "parameters": self.compliance}
        in_metres = ("held_out", "before", "bound", "accuracy", "noise", "repeats")
        return head(self.recording, self.robot, self.status, self.refuted) | {
            "channels": "pose",
            "converged": self.converged,
            "poses": self.poses,
            "rows": self.rows,
            "parameters": entries(self.identified),
            **{name: getattr(self, name) for name in in_metres},
            "stand": dict(self.stand),
            "rank": o.rank,
            "cannot_tell": list(self.cannot_tell),
            "covariance": self.covariance.tolist(),
            "theta": dict(self.theta),
            "gravity": list(self.gravity),
            "effects": [springs] if self.compliance else [],
        }
