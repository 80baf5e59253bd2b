"""Times of a live recording: rows at equal steps of the robot's clock. A network delivers states
unevenly and drops some, but each carries the robot's time. Between two states joints follow the
cubic that has their values and speeds (Hermite); the wrench is that of the same moment on this
machine's clock, onto which the robot's clock is fitted."""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wrenchbed.errors import LinkError
from wrenchbed.hardware.device_base import STALE_S, ClockFit
from wrenchbed.hardware.drivers.base import ArmSample

_LATEST = 64
"""Number of states stored for interpolation: half a second at 125 Hz, longer than rows wait."""
_STRETCH_S = 0.4
"""Stretch whose least late state fits the clocks [s]: at 125 Hz, 1 of 50 states is on time."""
_SAME_S = 1e-9
"""Difference below which two times are equal [s], far above the rounding of a sum of periods."""
Pair = tuple[np.ndarray, np.ndarray]


class EvenRow(NamedTuple):
    """One row on an even time grid.

    Attributes:
        t: time of the row on the robot's clock [s].
        host: the same moment on this machine's clock [s].
        q, qd: joint values and speeds (J,), interpolated by a cubic.
        extra_columns: further columns as in `ArmSample`, interpolated linearly.
    """

    t: float
    host: float
    q: np.ndarray
    qd: np.ndarray
    extra_columns: Mapping[str, np.ndarray]


class Resampler:
    """Resamples a robot's states to rows at equal steps of the robot's clock, at a rate [Hz].

    Attributes:
        newest: arrival of the newest state (`time.monotonic`, [s]); states that arrived at
            ``begin`` or before are left out.
    """

    def __init__(self, rate: float, begin: float = -np.inf) -> None:
        self.newest = self._begin = begin
        self._period, self._count = 1.0 / rate, 0
        self._states: deque[ArmSample] = deque(maxlen=_LATEST)
        self._clock = ClockFit(_STRETCH_S)
        self._first = self._origin = 0.0

    def add(self, arm: ArmSample) -> None:
        """Add a state; it is ignored if it is not newer than the last one."""
        t = controller_time(arm)
        if arm.t <= self._begin or (self._states and t <= controller_time(self._states[-1])):
            return
        if not self._states:
            self._first, self._origin = t, arm.t
        self.newest = max(self.newest, arm.t)
        self._states.append(arm)
        self._clock.add(t - self._first, arm.t - self._origin)

    def rows(self, most: int) -> list[EvenRow]:
        """Return the next rows between states received so far, at most ``most``; a `LinkError` if
        two states are too far apart to interpolate."""
        states = list(self._states)
        times = np.array([controller_time(state) for state in states]) - self._first
        due = self._period * np.arange(self._count, self._count + most)
        due = due[due <= times[-1] + _SAME_S] if len(states) > 1 else due[:0]
        after = np.clip(np.searchsorted(times, due + _SAME_S), 1, max(len(states) - 1, 1))
        rows: list[EvenRow] = []
        for t, k in zip(due, after, strict=True):
            before, then, span = states[k - 1], states[k], times[k] - times[k - 1]
            if span > STALE_S and t > times[k - 1] + _SAME_S:
                raise LinkError(f"the robot's states have a gap of {span:.3f} s in the motion")
            s = float(np.clip((t - times[k - 1]) / span, 0.0, 1.0))
            extra_columns = {
                name: value + s * (then.extra_columns[name] - value)
                for name, value in before.extra_columns.items()
            }
            host = self._origin + self._clock.host(float(t))
            q, qd = hermite((before.q, then.q), (before.qd, then.qd), span, s)
            rows.append(EvenRow(self._origin + float(t), host, q, qd, extra_columns))
        self._count += len(rows)
        return rows


def controller_time(arm: ArmSample) -> float:
    """Time of a state on the robot's clock [s]; its arrival on this machine if it has no clock."""
    return arm.t if arm.device_time is None else arm.device_time


def hermite(q: Pair, qd: Pair, span: float, s: float) -> Pair:
    """Joint values and speeds (J,) on the cubic through two states, at a fraction s, 0 … 1, of the
    ``span`` [s] between them; ``q`` and ``qd`` are the pairs (first, second) of their values and
    speeds. CAN drives are commanded along it too (`can.setpoints`): a change moves robots."""
    ahead, behind = s * (1 - s) ** 2, s * s * (s - 1)
    between = (1 + 2 * s) * (1 - s) ** 2 * q[0] + s * s * (3 - 2 * s) * q[1]
    slope, into, out = 6 * s * (s - 1) / span, (1 - s) * (1 - 3 * s), s * (3 * s - 2)
    return (
        between + span * (ahead * qd[0] + behind * qd[1]),
        slope * (q[0] - q[1]) + into * qd[0] + out * qd[1],
    )
