"""RTDE: named outputs over a connection of its own, and the robot's newest state from them. The
controller reports the type of each output, which says how it is packed. A state is used only if
its time stamp is new and its values are possible for a robot. Source of the protocol: Universal
Robots, "RTDE guide": header uint16 size, uint8 type, big endian."""

import contextlib
import math
import os
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.device_base import connected

PORT = 30004
"""TCP port of RTDE; source: Universal Robots, "RTDE guide"."""
NATIVE_HZ = {False: 125.0, True: 500.0}
"""Whether an e-Series → states per second; source: Universal Robots, "RTDE guide"."""
ANSWER_S = 2.0
"""Time within which the controller must start its stream [s]; a healthy one needs 10 ms."""
PRIORITY = -10
"""Nice value of the thread that receives states: ahead of other programs, behind real-time ones."""
_HEADER = struct.Struct(">HB")
_PROTOCOL, _VERSION, _TEXT = ord("V"), ord("v"), ord("M")
_OUTPUTS, _START, _DATA = ord("O"), ord("S"), ord("U")
_LONGEST = 4096
"""Bytes of the longest packet that is accepted; a longer one is not RTDE."""
_TYPES = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
"""RTDE type → its packing in `struct`; source: Universal Robots, "RTDE guide"."""
_MISSING = "NOT_FOUND"
_FIELDS = {
    "stamp": "timestamp", "q": "actual_q", "qd": "actual_qd", "current": "actual_current",
    "target_q": "target_q", "target_qd": "target_qd", "target_moment": "target_moment",
    "temperatures": "joint_temperatures", "pose": "actual_TCP_pose", "force": "actual_TCP_force",
    "scaling": "speed_scaling", "mode": "robot_mode", "safety": "safety_mode",
    "bits": "safety_status_bits", "runtime": "runtime_state", "raw": "ft_raw_wrench",
}  # fmt: skip
"""Field of a `Snapshot` → output of the controller."""
_OPTIONAL = {"ft_raw_wrench"}
"""Outputs that older controllers lack: e-Series have it from 5.9 on."""
_SPEED, _SLACK = 7.0, 0.05
"""Fastest joint [rad/s], above the 6.3 of a UR3's wrists, and jump beyond it [rad] that are
plausible, since arrival and time stamp may differ by some milliseconds."""
_LARGEST = {
    "q": 7.0, "target_q": 7.0, "qd": 50.0, "target_qd": 50.0, "current": 500.0,
    "target_moment": 1e4, "temperatures": 200.0, "pose": 10.0, "force": 1e5,
}  # fmt: skip
"""Field → largest plausible value [rad, rad/s, A, N·m, °C, m and rad, N and N·m] of any UR."""
_TINY = 1e-200
"""Magnitude below which a number other than zero is bytes of something else."""
_PLAYING = 2
_PROTECTIVE = 1 << 2
_KEPT = 512
"""Number of recent states that are stored for late readers: a second of an e-Series."""
_RESTART_S = 1.0
"""Least backward step of a restarted controller's clock [s]; smaller: states out of order."""
_GAP = 1.5
"""Step between two time stamps, in periods, from which states are missing between them."""
Values = tuple[float, ...]
_ZERO, _NAN = (0.0,) * 6, (math.nan,) * 6


class Outputs:
    """Outputs that a UR controller streams over RTDE, its data link; use as a context manager.

    Args:
        host: address of the controller.
        names: output names; those that the controller lacks are left out.
        timeout: time within which the stream must start [s].
        rate: rate of the stream [Hz]; the controller's own if None.

    Attributes:
        names, version, rate: outputs received, software in four numbers, rate [Hz].

    Raises:
        LinkError: the controller cannot be reached, or does not answer in time.
        DriverError: its answer is not RTDE, or it has none of the outputs.
    """

    def __init__(
        self, host: str, names: Sequence[str], timeout: float, rate: float | None = None
    ) -> None:
        end = time.monotonic() + timeout
        try:
            self._link = connected(host, PORT, timeout)
        except OSError as error:
            raise LinkError(error.strerror or str(error)) from error
        try:
            if self._ask(_PROTOCOL, struct.pack(">H", 2), end) != b"\x01":
                raise DriverError("the controller refuses protocol version 2 of RTDE")
            answer = self._ask(_VERSION, b"", end)
            if len(answer) != 16:
                raise DriverError(f"the controller's version has {len(answer)} bytes instead of 16")
            self.version: tuple[int, ...] = struct.unpack(">IIII", answer)
            self.rate = rate or NATIVE_HZ[self.version[0] > 3]
            self._choose(names, end)
        except BaseException:
            self._link.close()
            raise

    def _choose(self, names: Sequence[str], end: float) -> None:
        """Subscribe to the outputs ``names`` that the controller has; start them by ``end`` [s]."""
        wanted, types = list(names), [_MISSING]
        while _MISSING in types:
            body = struct.pack(">d", self.rate) + ",".join(wanted).encode()
            types = self._ask(_OUTPUTS, body, end)[1:].decode("latin-1").split(",")
            if len(types) != len(wanted):
                raise DriverError(
                    f"the controller names {len(types)} types for {len(wanted)} outputs"
                )
            known = [name for name, kind in zip(wanted, types, strict=True) if kind != _MISSING]
            if not known:
                raise DriverError("the controller has none of the outputs")
            wanted = known
        if unknown := [kind for kind in types if kind not in _TYPES]:
            raise DriverError(f"the controller names a type {unknown[0][:20]!r}")
        self.names = tuple(wanted)
        self._packing = [struct.Struct(">" + _TYPES[kind]) for kind in types]
        if self._ask(_START, b"", end) != b"\x01":
            raise LinkError("the controller refuses to start: it sends no states")

    def next(self, end: float = math.inf) -> tuple[float, dict[str, Values] | None]:
        """Receive the next data packet: arrival [s], and name → value, None if its length is wrong.
        A `LinkError` if none comes by ``end`` (`time.monotonic`, [s]), a `DriverError` if one is
        not RTDE."""
        kind, content = self._packet(end)
        while kind != _DATA:
            kind, content = self._packet(end)
        arrival = time.monotonic()
        if len(content) != 1 + sum(packing.size for packing in self._packing):
            return arrival, None
        values, at = {}, 1
        for name, packing in zip(self.names, self._packing, strict=True):
            values[name] = tuple(map(float, packing.unpack_from(content, at)))
            at += packing.size
        return arrival, values

    def close(self) -> None:
        """End the stream, also for a thread that waits in `next`; may be called twice."""
        with contextlib.suppress(OSError):
            self._link.shutdown(socket.SHUT_RDWR)
        self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, kind: int, body: bytes, end: float) -> bytes:
        """Send an RTDE request of type ``kind`` with ``body``; return the body of its answer, due
        by ``end`` (`time.monotonic`, [s]); skip text messages before it."""
        try:
            self._link.sendall(_HEADER.pack(_HEADER.size + len(body), kind) + body)
        except OSError as error:
            raise LinkError(error.strerror or str(error)) from error
        answered, content = self._packet(end)
        while answered == _TEXT:
            answered, content = self._packet(end)
        if answered != kind:
            raise DriverError(f"the controller answered with a packet of type {answered}")
        return content

    def _packet(self, end: float) -> tuple[int, bytes]:
        size, kind = _HEADER.unpack(self._exactly(_HEADER.size, end))
        if not _HEADER.size <= size <= _LONGEST:
            raise DriverError(f"the controller sent a packet of {size} bytes: this is no RTDE")
        return kind, self._exactly(size - _HEADER.size, end)

    def _exactly(self, n: int, end: float) -> bytes:
        data = b""
        while len(data) < n:
            remaining = end - time.monotonic()
            if remaining <= 0.0:
                raise LinkError("the controller accepts connections and does not answer")
            try:
                self._link.settimeout(remaining if math.isfinite(remaining) else None)
                part = self._link.recv(n - len(data))
            except TimeoutError:
                continue
            except OSError as error:
                raise LinkError(error.strerror or str(error)) from error
            if not part:
                raise LinkError("the controller closed the connection")
            data += part
        return data


class Snapshot(NamedTuple):
    """One state of the robot, with counts of the stream up to it.

    Attributes:
        t: `time.monotonic` when the state arrived [s].
        stamp: time on the controller's own clock [s].
        q, qd, current: angles, speeds and motor currents (6,) of the joints [rad, rad/s, A].
        target_q, target_qd, target_moment: joint angles, speeds and torques (6,) that the
            controller commands [rad, rad/s, N·m].
        temperatures: temperatures of the joints (6,) [°C].
        pose: pose of the TCP in the base (6,), x y z [m] and rotation vector [rad].
        force: ``actual_TCP_force`` (6,) [N, N·m], as the controller reports it.
        raw: ``ft_raw_wrench`` (6,) [N, N·m], NaN if the controller has none.
        scaling: speed scaling 0 … 1.
        mode, safety, bits, runtime: RTDE's ``robot_mode``, ``safety_mode``,
            ``safety_status_bits`` and ``runtime_state``.
        major: first number of the controller's software version.
        protective: `time.monotonic` when a protective stop was first seen [s], 0 without one.
        halts: how often a program stopped playing.
        received, skipped, bad: number of states received, known to be lost, and refused.
        wrong: why the newest received state was refused; empty if it was not.
        back: step by which the controller's clock went back [s], 0 if it never did.
    """

    t: float = 0.0
    stamp: float = 0.0
    q: Values = _ZERO
    qd: Values = _ZERO
    current: Values = _ZERO
    target_q: Values = _ZERO
    target_qd: Values = _ZERO
    target_moment: Values = _ZERO
    temperatures: Values = _ZERO
    pose: Values = _ZERO
    force: Values = _ZERO
    raw: Values = _NAN
    scaling: float = 1.0
    mode: float = -1.0
    safety: float = 0.0
    bits: float = 0.0
    runtime: float = 0.0
    major: float = 0.0
    protective: float = 0.0
    halts: float = 0.0
    received: float = 0.0
    skipped: float = 0.0
    bad: float = 0.0
    wrong: str = ""
    back: float = 0.0

    def followed_by(self, new: "Snapshot", period: float) -> "Snapshot":
        """Check and count the next state ``new``, a ``period`` [s] later; return it, or this state
        with the refusal noted."""
        wrong = implausible(new, self)
        if wrong:
            return self._replace(bad=self.bad + 1, wrong=wrong)
        back, skipped, step = self.back, self.skipped, new.stamp - self.stamp
        if self.t > 0.0 and step < -_RESTART_S:
            back = -step
        elif self.t > 0.0 and step > _GAP * period:
            skipped += round(step / period) - 1
        halted = int(self.runtime) == _PLAYING and int(new.runtime) != _PLAYING
        protective = (self.protective or new.t) if int(new.bits) & _PROTECTIVE else 0.0
        return new._replace(
            major=self.major, halts=self.halts + halted, received=self.received + 1,
            skipped=skipped, bad=self.bad, back=back, protective=protective,
        )  # fmt: skip


class StateReceiver:
    """Thread that receives the states of a robot.

    Args:
        rate: rate of the states [Hz], the controller's own if None.
        before: newest state of an earlier connection, whose counts are continued.
        published: called with each new state, in the thread.

    Attributes:
        newest: the newest state; its ``t`` is 0 before the first one arrived.
        recent: the last states, the newest one at the end.
        ended: reason why no more states will come; empty while the stream goes on.

    Raises:
        LinkError: the controller cannot be reached, or does not answer within `ANSWER_S`.
        DriverError: its answer cannot be used.
    """

    def __init__(
        self, host: str, rate: float | None, before: Snapshot, published: Callable[[Snapshot], None]
    ) -> None:
        self._stream = stream = Outputs(host, list(_FIELDS.values()), ANSWER_S, rate)
        if missing := {*_FIELDS.values()} - _OPTIONAL - {*stream.names}:
            stream.close()
            raise DriverError(f"the controller has no output {', '.join(sorted(missing))}")
        self.ended = ""
        self.newest = before._replace(t=0.0, wrong="", back=0.0, major=float(stream.version[0]))
        self.recent: deque[Snapshot] = deque(maxlen=_KEPT)
        self._published = published
        self._thread = threading.Thread(target=self._run, name="rtde states", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the stream and its thread; may be called twice."""
        self._stream.close()
        self._thread.join(1.0)

    def _run(self) -> None:
        with contextlib.suppress(OSError):  # where the system allows it
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), PRIORITY)
        try:
            while True:
                self._take(*self._stream.next())
        except (DriverError, OSError) as error:
            self.ended = f"the stream of states ended: {error}"

    def _take(self, arrival: float, values: dict[str, Values] | None) -> None:
        """Count a packet that came at ``arrival`` [s]; publish its state if its stamp is new."""
        last = self.newest
        if values is None:
            self.newest = last._replace(bad=last.bad + 1, wrong="data of a wrong length")
            return
        sent = {field: values[name] for field, name in _FIELDS.items() if name in values}
        plain = {field: v if len(v) > 1 else v[0] for field, v in sent.items()}
        state = Snapshot(arrival, **plain)  # type: ignore[arg-type]
        if state.stamp != last.stamp or last.t == 0.0:
            self.newest = last.followed_by(state, 1.0 / self._stream.rate)
            if not self.newest.wrong:
                self.recent.append(self.newest)
            self._published(self.newest)


def implausible(new: Snapshot, last: Snapshot) -> str:
    """Reason why no robot can have sent the state ``new`` after ``last``; empty if a robot can."""
    sixes = [(most, getattr(new, name)) for name, most in _LARGEST.items()]
    if not all(math.isfinite(v) for _, six in sixes for v in six) or not math.isfinite(new.stamp):
        return "numbers that are not finite"
    modes = -1 <= new.mode <= 8 and 1 <= new.safety <= 13 and 0 <= new.runtime <= 5
    odd = any(abs(v) > most or 0.0 < abs(v) < _TINY for most, six in sixes for v in six)
    if not modes or odd:
        return "values or modes that no robot has"
    if last.t == 0.0 or new.stamp < last.stamp - _RESTART_S:
        return ""
    if new.stamp < last.stamp:
        return "time stamps that go back"
    reach = _SPEED * max(new.stamp - last.stamp, new.t - last.t) + _SLACK
    jumps = max(abs(a - b) for a, b in zip(new.q, last.q, strict=True)) > reach
    return "joints that jump faster than any robot" if jumps else ""
