"""Result of a fit of joint torques: values with uncertainty, and errors on held-out rows."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from wrenchbed.calibration.fit import IdentifiedValue, WrittenFit, entries, head
from wrenchbed.channels.effort import GAIN
from wrenchbed.channels.holding_torques import LINK_CENTRE, LINK_MASS

EFFORT_FIT, COMMAND_FIT = "effort", "command"
"""What was fitted: joint efforts, or tracking errors of servos."""
LEAST_SHOWN = 0.01
"""Least size of links' errors, in ordinary ones (`LINK_MASS`, `LINK_CENTRE`), that is stated."""
BY_ERRORS = "by_errors"
"""Field of a fit's file: ``size`` of errors, `DriveFit.link_errors`, and `DriveFit.by_errors`."""
_INERTIA = tuple(f"tool.inertia.{a}" for a in ("xx", "yy", "zz"))
POSITIVE = (
    "tool.mass", "drive.constant", "drive.coulomb", "drive.viscous", "servo.stiffness", *_INERTIA,
)  # fmt: skip
"""Values, or groups of them, that cannot be negative."""
_NEAR_0 = 2.0
"""Half widths of its 95 % interval below 0 that refute a tool's inertia, which is often near 0: one
in fifteen sound fits has one of three such values below by a single half width."""


@dataclass(frozen=True)
class JointError:
    """Rms errors of one joint in the filter's band [N·m, of slides N; A], over the rows used.

    Attributes:
        joint: number of the joint, from 1.
        measured: standard deviation of the torque or current itself.
        nominal: rms residual of the nominal robot; None of currents, whose constant is unknown.
        left: rms residual of the fit.
        held_out: rms residual on blocks of time left out of the fit.
    """

    joint: int
    unit: str
    rows: int
    measured: float
    nominal: float | None
    left: float
    held_out: float

    @property
    def explained(self) -> float:
        """Share of the effort's rms that the fit explains on rows left out of it; ≤ 0 for none."""
        return 1.0 - self.held_out / self.measured if self.measured else 0.0


@dataclass(frozen=True)
class AtRest:
    """Results that only a drive fit to poses at rest has.

    Attributes:
        poses: count of the poses.
        noise: standard deviation (J,) of each effort from pose to pose, friction at rest included.
        ordinary: size of the errors that every robot has, by kind (``links``: of masses …), over
            the usual size.
    """

    poses: int
    noise: tuple[float, ...]
    ordinary: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class DriveFit(WrittenFit):
    """Result of a fit of joint torques, motor currents or servo commands.

    Attributes:
        unit: of the measured effort: ``N·m`` (``N`` of prismatic joints, slides), ``A`` or ``rad``.
        identified: the free parameters; friction in N·m, of slides in N.
        covariance: of the identified parameters (K, K).
        cutoff: edge of the low-pass filter of efforts [Hz]; None at rest.
        refuted: why the held-out rows refute these values, None if they do not.
        constants: drive constants, where they were stated (J,) [N·m/A, of slides N/A].
        channels: `EFFORT_FIT`, or `COMMAND_FIT`, whose errors are in rad, of slides in m.
        cannot_tell: sentences on what a fit of servo commands cannot determine.
        link_errors: size of errors of links and sensors that uncertainties include, over ordinary.
        by_errors: change of the identified parameters (H, K) by an ordinary error of the mass and
            of each coordinate of the centre of each link, of each joint's friction after reversals,
            and of each torque's gain (0 where a constant is free); None where it is not known.
        gravity: other than the stated one that explains the efforts far better [m/s²], or None.
    """

    recording: str
    robot: str
    unit: str
    identified: tuple[IdentifiedValue, ...]
    joints: tuple[JointError, ...]
    covariance: np.ndarray
    cutoff: float | None
    seconds: float
    rows: int
    refuted: str | None = None
    constants: tuple[float, ...] | None = None
    rest: AtRest | None = None
    channels: str = EFFORT_FIT
    cannot_tell: tuple[str, ...] = ()
    link_errors: float = 0.0
    by_errors: np.ndarray | None = None
    gravity: tuple[float, ...] | None = None

    @property
    def about(self) -> str:
        """Text on the amount of data, as "30 s, 900 rows below 5 Hz"."""
        if self.rest is not None:
            return f"{self.rest.poses} poses at rest, {self.rows} rows"
        return f"{self.seconds:.0f} s, {self.rows} rows below {self.cutoff:.3g} Hz"

    @property
    def word(self) -> str:
        """Word for the fitted quantity: tracking error or effort."""
        return "tracking error" if self.channels == COMMAND_FIT else "effort"

    @property
    def explained(self) -> float:
        """Share of the rms of all efforts that the fit explains on held-out rows."""
        whole = np.square([e.measured for e in self.joints]).sum()
        return 1.0 - float(np.sqrt(self.misfit / whole))

    @property
    def misfit(self) -> float:
        """Sum over the joints of the mean squared error on held-out rows."""
        return sum(e.held_out**2 for e in self.joints)

    @property
    def status(self) -> str:
        """Sentence on how far to trust the fit."""
        if self.refuted is not None:
            return f"refuted: {self.refuted}"
        worst = min(self.joints, key=lambda e: e.explained)
        untold = [p.name for p in self.identified if p.std is None]
        names = {p.name.partition(".")[0] for p in self.identified}
        data = "this motion does" if self.rest is None else "these poses do"
        untold_text = f"; {data} not tell {', '.join(untold)}" if untold else ""
        for p in self.identified:
            if p.name == "tool.mass" and p.interval95 is not None and p.value < p.interval95:
                most = p.value + p.interval95
                untold_text += f"; the tool's mass is known only to be below {most:.2g} kg (95 %)"
        if self.rest is not None:
            low, high = min(self.rest.noise), max(self.rest.noise)
            return (
                f"on poses that no fit saw it explains {np.floor(1e4 * self.explained) / 100:.2f} "
                f"% of the efforts; friction of unknown sign at rest and noise are {low:.2g} to "
                f"{high:.2g} {self.unit} a pose; uncertainties also hold what ordinary errors of "
                f"{', '.join(self.rest.ordinary)} would move: diagnosed beside a recording without "
                f"the load, those of links drop out{untold_text}"
            )
        text = (
            f"on rows that no fit saw it explains {np.floor(1e4 * worst.explained) / 100:.2f} % or "
            f"more of each joint's {self.word}, least of joint {worst.joint}"
        )
        if self.channels == COMMAND_FIT:
            text += (
                "; what is in N·m and kg holds as far as the model's link masses do; drive.viscous "
                "is the damping of servo and joint together"
            )
        elif self.link_errors >= LEAST_SHOWN:
            size = self.link_errors
            text += (
                f"; uncertainties hold errors of {100 * LINK_MASS * size:.2g} % of each link's "
                f"mass and {1e3 * LINK_CENTRE * size:.2g} mm of its centre"
            )
            if not any(p.name.startswith("drive.constant") for p in self.identified):
                text += f", and {100 * GAIN * size:.2g} % of each torque's gain"
        elif "link" not in names and "tool" in names:
            text += "; the tool and drive constants hold as far as the model's link masses do"
        return text + untold_text

    def _changes(self, changes: np.ndarray) -> dict[str, Any]:
        names = [p.name for p in self.identified]
        return {"size": self.link_errors, **dict(zip(names, changes.T.tolist(), strict=True))}

    def to_json(self) -> dict[str, Any]:
        """Contents of the fit's JSON file."""
        return head(self.recording, self.robot, self.status, self.refuted) | {
            "channels": self.channels,
            **({} if self.constants is None else {"constants": list(self.constants)}),
            "unit": self.unit,
            "cutoff_hz": self.cutoff,
            "seconds": self.seconds,
            "rows": self.rows,
            **({} if self.rest is None else asdict(self.rest)),
            "parameters": entries(self.identified),
            **({"cannot_tell": list(self.cannot_tell)} if self.cannot_tell else {}),
            "joints": [asdict(e) | {"explained": e.explained} for e in self.joints],
            "covariance": self.covariance.tolist(),
            **({} if self.by_errors is None else {BY_ERRORS: self._changes(self.by_errors)}),
        }


def joint_errors(
    y: np.ndarray, nominal: np.ndarray | None, left: np.ndarray, unseen: np.ndarray,
    use: np.ndarray, units: Sequence[str],
) -> tuple[JointError, ...]:  # fmt: skip
    """Rms errors of each joint over the rows used.

    Args:
        y: measured efforts (M, J).
        nominal: residual of the nominal robot (M, J), where known.
        left, unseen: residual of the fit, and of fits without the row's block (M, J).
        use: whether to use each row (M, J), boolean.
        units: of each joint's effort.
    """

    def rms(error: np.ndarray, joint: int) -> float:
        return float(np.sqrt(np.mean(error[use[:, joint], joint] ** 2)))

    return tuple(
        JointError(
            j + 1, unit, int(use[:, j].sum()), float(y[use[:, j], j].std()),
            None if nominal is None else rms(nominal, j), rms(left, j), rms(unseen, j),
        )
        for j, unit in enumerate(units)
    )  # fmt: skip


def impossible(values: Sequence[IdentifiedValue]) -> str | None:
    """Sentence on the first value that cannot be negative (`POSITIVE`) but surely is; else None."""
    free, made = "drive", "the effort has the opposite sign, less what the controller knows"
    if any(p.name.startswith("servo") for p in values):
        free, made = "servo", "the controller adds the weight itself, as no plain servo does"
    for p in values:
        half = p.interval95
        least = _NEAR_0 if p.name in _INERTIA else 1.0
        if p.name.startswith(POSITIVE) and half is not None and p.value + least * half < 0.0:
            why = (
                "this motion, with what is held, does not tell it. Record a longer and faster "
                f"one, free drive.inertia too, or state the tool and --free {free}"
                if p.name in _INERTIA
                else f"{made}, another robot made it, or links weigh otherwise than the model's: "
                f"state the tool and --free {free}"
            )
            return (
                f"{p.name} comes out as {p.value:.3g} ± {half:.2g} {p.unit}, which cannot be "
                f"negative: {why}"
            )
    return None
