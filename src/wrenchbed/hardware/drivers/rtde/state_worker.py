"""The worker that receives states: copies each new one into shared memory with its arrival time.

ur_rtde gives its last values for ever after a loss, and garbage after a short packet: a state
counts only when its time stamp is new, no other one arrived while it was copied, and its values
are those of a robot.

How fast the controller's clock runs against this machine's; only the standard library.

States arrive late by what the network and this machine add, never early: of each half second the
one that was least late counts.

Ask a controller for its version before ur_rtde is let near it.

ur_rtde's constructors wait for ever for a controller that accepts and is silent, and return
useless objects for one that refuses; two packets of the protocol with deadlines tell first.
Protocol: Universal Robots, "RTDE guide": header uint16 size, uint8 type, big endian.
"""

import math
import os
import signal
import socket
import struct
import time
from collections import deque
from importlib import import_module
from typing import Any

from wrenchbed.hardware.drivers.rtde.shared_state import SharedState, Snapshot
from wrenchbed.hardware.drivers.rtde.worker import LOST, Closed, MessageChannel, Printed, settle

_BIN_S = 0.5
_BINS, _LEAST_BINS = 60, 8


class ControllerClock:
    """Least squares over the last half minute of (arrival, stamp) [s]."""

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
        n = len(self._best)
        if n < _LEAST_BINS:
            return float("nan")
        t0, s0 = self._best[0]
        x = [t - t0 for t, _ in self._best]
        y = [(s - s0) - (t - t0) for t, s in self._best]
        mean_x, mean_y = sum(x) / n, sum(y) / n
        spread = sum((a - mean_x) ** 2 for a in x)
        return 1e6 * sum((a - mean_x) * (b - mean_y) for a, b in zip(x, y, strict=True)) / spread


PORT = 30004
_HEADER = struct.Struct(">HB")
_PROTOCOL, _VERSION, _TEXT = ord("V"), ord("v"), ord("M")
_LONGEST = 4096


class Unfit(Exception):  # noqa: N818
    """A controller that cannot be used; the message says why."""


def controller_version(host: str, timeout: float) -> tuple[int, int, int, int]:
    """Major, minor, bugfix and build of the controller.

    Raises:
        OSError: it cannot be reached.
        TimeoutError: it accepts and does not answer in time [s].
        Unfit: it answers what is no RTDE.
    """
    deadline = time.monotonic() + timeout
    with socket.create_connection((host, PORT), timeout) as link:
        if _ask(link, deadline, _PROTOCOL, struct.pack(">H", 2)) != b"\x01":
            raise Unfit("the controller refuses protocol version 2 of RTDE")
        answer = _ask(link, deadline, _VERSION, b"")
        if len(answer) != 16:
            raise Unfit(f"the controller's version has {len(answer)} bytes instead of 16")
        major, minor, bugfix, build = struct.unpack(">IIII", answer)
        return major, minor, bugfix, build


def _ask(link: socket.socket, deadline: float, kind: int, body: bytes) -> bytes:
    link.sendall(_HEADER.pack(_HEADER.size + len(body), kind) + body)
    while True:
        size, answered = _HEADER.unpack(_exactly(link, deadline, _HEADER.size))
        if not _HEADER.size <= size <= _LONGEST:
            raise Unfit(f"the controller sent a packet of {size} bytes: this is no RTDE")
        content = _exactly(link, deadline, size - _HEADER.size)
        if answered == kind:
            return content
        if answered != _TEXT:
            raise Unfit(f"the controller answered with a packet of type {answered}")


def _exactly(link: socket.socket, deadline: float, n: int) -> bytes:
    data = b""
    while len(data) < n:
        left = deadline - time.monotonic()
        if left <= 0.0:
            raise TimeoutError("the controller accepts connections and does not answer")
        link.settimeout(left)
        try:
            part = link.recv(n - len(data))
        except TimeoutError:
            continue
        if not part:
            raise ConnectionResetError("the controller closed the connection")
        data += part
    return data


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


def run(setting: dict[str, Any], shared: SharedState, wire: MessageChannel) -> None:
    """Connect, say so, and copy states until the driver or the controller is gone."""
    printed = Printed(lambda why: settle(wire, "lost", why, LOST))
    host, frequency = str(setting["host"]), setting["frequency"]
    try:
        version = controller_version(host, _PROBE_S)
    except OSError as error:
        return settle(wire, "refused", error.strerror or str(error), 1)
    except Unfit as error:
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
