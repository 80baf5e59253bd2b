"""The worker that receives states: it copies each new one into shared memory with its arrival time.

After a lost link ur_rtde repeats its last values for ever, and after a short packet it returns
garbage. So a state counts only when its time stamp is new, no other one arrived while it was
copied, and its values are possible for a robot.

ur_rtde's constructors wait for ever for a silent controller and return useless objects for one that
refuses. So the controller's version is asked for first, with a deadline. Only the standard library
is imported, so that the worker starts quickly.
"""

import math
import os
import signal
import time
from collections import deque
from importlib import import_module
from statistics import linear_regression
from typing import Any

from wrenchbed.hardware.drivers.rtde.outputs import NATIVE_HZ, Unfit, controller_version
from wrenchbed.hardware.drivers.rtde.shared_state import SharedState, Snapshot
from wrenchbed.hardware.drivers.rtde.worker import (
    LOST,
    Closed,
    MessageChannel,
    Printed,
    end_process,
)

_BIN_S = 0.5
"""Time of whose states the least late one counts [s]; estimate."""
_BINS, _LEAST_BINS = 60, 8
"""Most and fewest such states of a fit; estimates."""


class ControllerClock:
    """Drift of the controller's clock: least squares over half a minute of (arrival, stamp) [s].

    Network and machine make states late, never early: the least late one of each bin counts.
    """

    def __init__(self) -> None:
        self._best: deque[tuple[float, float]] = deque(maxlen=_BINS)
        self._begun: float | None = None
        self._least = (0.0, 0.0)

    def add(self, t: float, stamp: float) -> bool:
        """Take in a state; whether another half second is complete."""
        jump = abs((stamp - self._least[1]) - (t - self._least[0]))
        if self._begun is None or jump > _BIN_S:
            self._best.clear()
            self._begun, self._least = t, (t, stamp)
            return False
        if t - self._begun < _BIN_S:
            if t - stamp < self._least[0] - self._least[1]:
                self._least = (t, stamp)
            return False
        self._best.append(self._least)
        self._begun, self._least = t, (t, stamp)
        return True

    def drift(self) -> float:
        """Parts per million by which the controller's clock is faster; NaN for too short a time."""
        if len(self._best) < _LEAST_BINS:
            return float("nan")
        t0, s0 = self._best[0]
        x = [t - t0 for t, _ in self._best]
        y = [(s - s0) - (t - t0) for t, s in self._best]
        return _MILLION * linear_regression(x, y).slope


FIELDS = (
    "timestamp", "target_q", "target_qd", "target_moment", "actual_q", "actual_qd",
    "actual_current", "joint_temperatures", "actual_TCP_pose", "actual_TCP_force",
    "robot_mode", "safety_mode", "speed_scaling", "runtime_state",
    "robot_status_bits", "safety_status_bits",
)  # fmt: skip
"""Fields of the states; ur_rtde's decoder would shift the values after an unknown field."""
RAW = "ft_raw_wrench"
WRONG = (
    "", "numbers that are not finite", "values or modes that no robot has",
    "joints that jump faster than any robot", "time stamps that go back",
)  # fmt: skip
"""Reasons to refuse a state; the index is stored in `Snapshot.wrong`."""
_SPEED, _SLACK = 7.0, 0.05
"""Fastest joint [rad/s] and jump beyond that [rad] of a plausible state; estimates."""
_LARGEST = {
    "q": 7.0, "target_q": 7.0, "qd": 50.0, "target_qd": 50.0, "current": 500.0,
    "target_moment": 1e4, "temperatures": 200.0, "pose": 10.0, "force": 1e5,
}  # fmt: skip
"""Largest plausible values [rad, rad/s, A, N·m, °C, m and rad, N and N·m]; estimates, joint angles
above the 2π of a UR robot."""
_TINY = 1e-200
"""Numbers nearer to zero, and not zero, are bytes of something else; estimate."""
_PLAYING = 2
_RESTART_S = 1.0
"""Least backward step of the clock of a controller that was restarted [s]; estimate."""
_GAP = 1.5
"""Step of the time stamps in periods from which states are missing; estimate."""
_POLL_S, _BEAT_S = 0.0005, 0.02
"""Time between two looks for a state, and period of the heartbeat [s]; estimates."""
_PROBE_S = 2.0
"""Time in which the controller must report its version [s]; estimate."""
_MILLION = 1e6  # by definition of ppm


def run(setting: dict[str, Any], shared: SharedState, wire: MessageChannel) -> None:
    """Connect, report it, and copy states until the driver or the controller is gone."""
    printed = Printed(lambda why: end_process(wire, "lost", why, LOST))
    host, frequency = str(setting["host"]), setting["frequency"]
    try:
        version = controller_version(host, _PROBE_S)
    except OSError as error:
        return end_process(wire, "refused", error.strerror or str(error), 1)
    except Unfit as error:
        return end_process(wire, "failed", str(error), 1)
    receive = import_module("rtde_receive").RTDEReceiveInterface
    signal.alarm(setting["alarm"])  # a constructor that hangs holds Python's lock
    has_raw = version[0] == 5 and version[:2] >= (5, 9)
    names = [*FIELDS, RAW] if has_raw else list(FIELDS)
    link = receive(host, -1.0 if frequency is None else frequency, names)
    if len(link.getActualQ()) != 6 or link.getTimestamp() == 0.0:
        return end_process(wire, "refused", "the controller sends no states", 1)
    signal.alarm(0)
    period = 1.0 / (frequency or NATIVE_HZ[version[0] > 3])
    copier = Copier(link, has_raw, version[0], period, shared)
    wire.send({"event": "ready", "version": version})
    try:
        _copy(link, copier, shared, wire, printed)
    except Closed:
        os._exit(0)


def _copy(
    link: Any, copier: "Copier", shared: SharedState, wire: MessageChannel, printed: Printed
) -> None:
    beat = 0.0
    while True:
        if copier.look():
            time.sleep(0.5 * copier.period)
        else:
            time.sleep(_POLL_S)
        now = time.monotonic()
        if now - beat > _BEAT_S:
            beat = now
            shared.beat("state")
            if not link.isConnected():
                why = printed.lines[-1] if printed.lines else "no data for 2.5 s"
                end_process(wire, "lost", why, LOST)
            message = wire.receive(0.0)
            if message is not None and message.get("do") == "quit":
                os._exit(0)


class Copier:
    """Copies complete and plausible states."""

    def __init__(
        self,
        link: Any,
        has_raw: bool,
        major: int,
        period: float,
        shared: SharedState,
    ) -> None:
        self.period = period
        self._link, self._has_raw, self._shared = link, has_raw, shared
        last = shared.read() or Snapshot()
        self._last = Snapshot(
            major=major, received=last.received, skipped=last.skipped, bad=last.bad,
            protective=last.protective, halts=last.halts, runtime=last.runtime,
        )  # fmt: skip
        self._stamp = -1.0
        self._clock = ControllerClock()

    def look(self) -> bool:
        """Copy the newest state if there is a new one."""
        stamp = self._link.getTimestamp()
        if stamp == self._stamp:
            return False
        t = time.monotonic()
        state = self._take(stamp)
        if state is None:
            return False
        self._stamp = state.stamp
        self._publish(state._replace(t=t))
        return True

    def _take(self, stamp: float) -> Snapshot | None:
        """A state during whose reading no other one arrived; None after five attempts."""
        for _ in range(5):
            state = self._read(stamp)
            again = self._link.getTimestamp()
            if again == stamp:
                return state
            stamp = again
        return None

    def _read(self, stamp: float) -> Snapshot:
        link = self._link
        state = self._last._replace(
            stamp=stamp, q=tuple(link.getActualQ()), qd=tuple(link.getActualQd()),
            current=tuple(link.getActualCurrent()), target_q=tuple(link.getTargetQ()),
            target_qd=tuple(link.getTargetQd()), target_moment=tuple(link.getTargetMoment()),
            temperatures=tuple(link.getJointTemperatures()),
            pose=tuple(link.getActualTCPPose()), force=tuple(link.getActualTCPForce()),
            scaling=link.getSpeedScaling(), mode=float(link.getRobotMode()),
            safety=float(link.getSafetyMode()), bits=float(link.getSafetyStatusBits()),
            runtime=float(link.getRuntimeState()),
        )  # fmt: skip
        return state._replace(raw=tuple(link.getFtRawWrench())) if self._has_raw else state

    def _publish(self, new: Snapshot) -> None:
        last = self._last
        wrong = implausible(new, last)
        if wrong:
            self._last = last._replace(bad=last.bad + 1, wrong=float(wrong))
            self._shared.write(self._last)
            return
        step = new.stamp - last.stamp
        back, skipped, drift = last.back, last.skipped, last.drift
        if last.t > 0.0 and step < -_RESTART_S:
            back = -step
        elif last.t > 0.0 and step > _GAP * self.period:
            skipped += round(step / self.period) - 1
        if self._clock.add(new.t, new.stamp):
            drift = self._clock.drift()
        protective = (last.protective or new.t) if int(new.bits) & 4 else 0.0
        halted = int(last.runtime) == _PLAYING and int(new.runtime) != _PLAYING
        self._last = new._replace(
            halts=last.halts + halted, received=last.received + 1, skipped=skipped, back=back,
            wrong=0.0, drift=drift, protective=protective,
        )  # fmt: skip
        self._shared.write(self._last)


def implausible(new: Snapshot, last: Snapshot) -> int:
    """Why a robot cannot have sent this state, as an index of `WRONG`; 0 if it can."""
    sixes = [(most, getattr(new, name)) for name, most in _LARGEST.items()]
    if not all(math.isfinite(v) for _, six in sixes for v in six) or not math.isfinite(new.stamp):
        return 1
    modes = -1 <= new.mode <= 8 and 1 <= new.safety <= 13 and 0 <= new.runtime <= 5
    odd = any(len(six) != 6 for _, six in sixes) or any(
        abs(v) > most or 0.0 < abs(v) < _TINY for most, six in sixes for v in six
    )
    if not modes or odd:
        return 2
    if last.t == 0.0 or new.stamp < last.stamp - _RESTART_S:
        return 0
    if new.stamp < last.stamp:
        return 4
    reach = _SPEED * max(new.stamp - last.stamp, new.t - last.t) + _SLACK
    return 3 if max(abs(a - b) for a, b in zip(new.q, last.q, strict=True)) > reach else 0
