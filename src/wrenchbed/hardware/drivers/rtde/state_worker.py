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
from importlib import import_module
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
"""Fastest joint [rad/s], above the 6.3 of a UR3's wrists, and jump beyond that [rad] of a plausible
state, since arrival and time stamp may differ by some milliseconds."""
_LARGEST = {
    "q": 7.0, "target_q": 7.0, "qd": 50.0, "target_qd": 50.0, "current": 500.0,
    "target_moment": 1e4, "temperatures": 200.0, "pose": 10.0, "force": 1e5,
}  # fmt: skip
"""Largest plausible values [rad, rad/s, A, N·m, °C, m and rad, N and N·m]: joint angles above the
2π of a UR robot, the others far above what one can have."""
_TINY = 1e-200
"""Numbers nearer to zero, and not zero, are bytes of something else."""
_PLAYING = 2
_RESTART_S = 1.0
"""Least backward step of the clock of a controller that was restarted [s]; smaller ones are states
in the wrong order."""
_GAP = 1.5
"""Step of the time stamps in periods from which states are missing."""
_POLL_S, _BEAT_S = 0.0005, 0.02
"""Time between two looks for a state, which adds to its age, and period of the heartbeat [s], a
third of the silence that counts as hanging."""
_PROBE_S = 2.0
"""Time in which the controller must report its version [s]; a healthy one needs 10 ms."""


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
        back, skipped = last.back, last.skipped
        if last.t > 0.0 and step < -_RESTART_S:
            back = -step
        elif last.t > 0.0 and step > _GAP * self.period:
            skipped += round(step / self.period) - 1
        protective = (last.protective or new.t) if int(new.bits) & 4 else 0.0
        halted = int(last.runtime) == _PLAYING and int(new.runtime) != _PLAYING
        self._last = new._replace(
            halts=last.halts + halted, received=last.received + 1, skipped=skipped, back=back,
            wrong=0.0, protective=protective,
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
