"""What a robot says and what was really sent to it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Block = Mapping[str, np.ndarray]
"""Columns of a recording by name, each (n,)."""
Onlooker = Callable[[float, np.ndarray, np.ndarray], None]
"""Is shown what a driver reads anyway, in the thread that reads, and must not block: the time since
`connect` [s], joint values (J,) and wrench (6,) [N, N·m]."""


@dataclass(frozen=True, eq=False)
class ArmSample:
    """State of a robot.

    Attributes:
        t: `time.monotonic` of this machine when it arrived [s]; a simulated robot's own time.
        device_time: on the robot's own clock [s], None where it has none.
        sequence: of the states received.
        age: time between arrival and the call that returned this [s].
        fresh: newer than what the call before returned.
        q: joint values (J,) [rad or m].
        qd: their speeds (J,).
        effort: torque of each joint (J,) [N·m or N], or its current [A] where a robot gives that.
        pose: flange in the robot's base x y z qw qx qy qz, None where it is not told.
        target_q: where the robot's own controller wants its joints (J,).
        mode: ``off``, ``idle``, ``running``, ``fault`` or what the device calls it.
        safety: ``normal``, ``protective stop``, ``emergency stop`` …
        program: ``playing``, ``paused``, ``stopped`` or empty.
        faults: what is wrong, in words.
    """

    t: float
    device_time: float | None
    sequence: int
    age: float
    fresh: bool
    q: np.ndarray
    qd: np.ndarray
    effort: np.ndarray | None = None
    pose: np.ndarray | None = None
    target_q: np.ndarray | None = None
    mode: str = "running"
    safety: str = "normal"
    program: str = ""
    faults: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Applied:
    """What came of a target: joint values (J,) as sent, or None and why they were refused."""

    sent: np.ndarray | None
    reason: str = ""

    @property
    def ok(self) -> bool:
        """Whether anything was sent."""
        return self.sent is not None


def block_of(rows: Sequence[Mapping[str, float]]) -> Block:
    """Rows as columns."""
    whole = {"status": np.uint32, "saturated": np.uint32, "lost": np.int64}
    return {k: np.array([r[k] for r in rows], dtype=whole.get(k, float)) for k in rows[0]}
