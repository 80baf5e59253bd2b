"""The worker that receives states: copies each new one into shared memory with its arrival time.

ur_rtde gives its last values for ever after a loss, and garbage after a short packet: a state
counts only when its time stamp is new, no other one arrived while it was copied, and its values
are those of a robot.
"""

import math
import os
import signal
import time
from importlib import import_module
from typing import Any

from wrenchbed.drivers.rtde import probe
from wrenchbed.drivers.rtde.clock import Clock
from wrenchbed.drivers.rtde.record import Shared, Snapshot
from wrenchbed.drivers.rtde.wire import Closed, Wire
from wrenchbed.drivers.rtde.worker import LOST, Printed, settle

FIELDS = (
    "timestamp", "target_q", "actual_q", "actual_qd", "actual_current", "actual_TCP_pose",
    "actual_TCP_force", "robot_mode", "safety_mode", "speed_scaling", "runtime_state",
    "robot_status_bits", "safety_status_bits",
)  # fmt: skip
"""All of ur_rtde's own decoding table: it does not skip what it does not know, but shifts."""
RAW = "ft_raw_wrench"
WRONG = (
    "", "numbers that are not finite", "joint angles or modes that no robot has",
    "joints that jump faster than any robot", "time stamps that go back",
)  # fmt: skip
_SPEED, _SLACK, _PLAYING = 7.0, 0.05, 2
_RESTART_S = 1.0
"""By how much the clock of a controller that was restarted goes back at least [s]."""
_POLL_S = 0.0005
_PROBE_S = 2.0


def run(setting: dict[str, Any], shared: Shared, wire: Wire) -> None:
    """Connect, say so, and copy states until the driver or the controller is gone."""
    printed = Printed(lambda why: settle(wire, "lost", why, LOST))
    host, frequency = str(setting["host"]), setting["frequency"]
    try:
        version = probe.version(host, _PROBE_S)
    except OSError as error:
        return settle(wire, "refused", error.strerror or str(error), 1)
    except probe.Unfit as error:
        return settle(wire, "failed", str(error), 1)
    receive = import_module("rtde_receive").RTDEReceiveInterface
    signal.alarm(setting["alarm"])  # a constructor that hangs holds Python's lock
    has_raw = version[0] == 5 and version[:2] >= (5, 9)
    names = [*FIELDS, RAW] if has_raw else list(FIELDS)
    link = receive(host, -1.0 if frequency is None else frequency, names)
    if len(link.getActualQ()) != 6 or link.getTimestamp() == 0.0:
        return settle(wire, "refused", "the controller sends no states", 1)
    signal.alarm(0)
    native = 125.0 if version[0] <= 3 else 500.0
    copier = Copier(link, has_raw, version[0], 1.0 / (frequency or native), shared)
    wire.send({"event": "ready", "version": version})
    try:
        _copy(link, copier, shared, wire, printed)
    except Closed:
        os._exit(0)


def _copy(link: Any, copier: "Copier", shared: Shared, wire: Wire, printed: Printed) -> None:
    beat = 0.0
    while True:
        if copier.look():
            time.sleep(0.5 * copier.period)
        else:
            time.sleep(_POLL_S)
        now = time.monotonic()
        if now - beat > 0.02:
            beat = now
            shared.beat("state")
            if not link.isConnected():
                why = printed.lines[-1] if printed.lines else "no data for 2.5 s"
                settle(wire, "lost", why, LOST)
            message = wire.receive(0.0)
            if message is not None and message.get("do") == "quit":
                os._exit(0)


class Copier:
    """Copies whole and plausible states."""

    def __init__(
        self,
        link: Any,
        has_raw: bool,
        major: int,
        period: float,
        shared: Shared,
    ) -> None:
        self.period = period
        self._link, self._has_raw, self._shared = link, has_raw, shared
        last = shared.read() or Snapshot()
        self._last = Snapshot(
            major=major, received=last.received, skipped=last.skipped, bad=last.bad,
            protective=last.protective, halts=last.halts, runtime=last.runtime,
        )  # fmt: skip
        self._stamp = -1.0
        self._clock = Clock()

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
        """A state that no other one overtook while it was read; None where that goes on."""
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
        elif last.t > 0.0 and step > 1.5 * self.period:
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
    """What no robot can have sent, as an index of `WRONG`; 0 where all is well."""
    sixes = (new.q, new.qd, new.current, new.target_q, new.pose, new.force)
    if not all(math.isfinite(v) for six in sixes for v in six) or not math.isfinite(new.stamp):
        return 1
    modes = -1 <= new.mode <= 8 and 1 <= new.safety <= 13 and 0 <= new.runtime <= 5
    if not modes or any(abs(v) > 7.0 for v in new.q) or any(len(six) != 6 for six in sixes):
        return 2
    if last.t == 0.0 or new.stamp < last.stamp - _RESTART_S:
        return 0
    if new.stamp < last.stamp:
        return 4
    reach = _SPEED * max(new.stamp - last.stamp, new.t - last.t) + _SLACK
    return 3 if max(abs(a - b) for a, b in zip(new.q, last.q, strict=True)) > reach else 0
