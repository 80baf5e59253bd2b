"""The robot's newest state in memory that driver and workers share.

A sequence lock with a checksum: the writer makes the sequence odd, writes, makes it even; a reader
takes a copy whose sequence is even and whose checksum fits, whatever the machine's memory ordering.
Three heartbeats follow it. Only the standard library, since the workers import this.
"""

import mmap
import os
import struct
import time
import zlib
from typing import NamedTuple, Self

Six = tuple[float, ...]
_ZERO = (0.0,) * 6
_NAN = (float("nan"),) * 6
_HEAD = struct.Struct("@qq")
_BEAT = struct.Struct("@d")
BEATS = ("driver", "state", "control")
"""Owners of the heartbeats."""
_TRIES = 20
"""Attempts at a consistent copy; a write takes some microseconds, a copy a few more."""
_WORD = 0xFFFFFFFF
"""Mask of 32 bits, by definition of CRC-32."""


class Snapshot(NamedTuple):
    """One state of the robot.

    Attributes:
        t: `time.monotonic` when it arrived [s].
        stamp: the controller's own clock [s].
        q: joint angles [rad].
        qd: their speeds [rad/s].
        current: of the motors [A].
        target_q: where the controller wants its joints [rad].
        target_qd: their speeds there [rad/s].
        target_moment: the controller's own torques for that [N·m].
        temperatures: of the joints [°C].
        pose: of the TCP in the base, x y z [m] and rotation vector [rad].
        force: ``actual_TCP_force`` [N, N·m], as the controller gives it.
        raw: ``ft_raw_wrench`` [N, N·m], NaN where the controller has none.
        scaling: speed scaling 0 … 1.
        mode: ``robot_mode``.
        safety: ``safety_mode``.
        bits: ``safety_status_bits``.
        runtime: ``runtime_state``.
        major: version of the controller.
        protective: `time.monotonic` when a protective stop was first seen, 0 without one [s].
        halts: how often a program stopped playing.
        received: states received.
        skipped: states known to be lost.
        bad: states that were refused.
        wrong: why the newest was refused, an index of `WRONG`; 0: it was not.
        back: by how much the controller's clock went back [s], 0 if it never did.
    """

    t: float = 0.0
    stamp: float = 0.0
    q: Six = _ZERO
    qd: Six = _ZERO
    current: Six = _ZERO
    target_q: Six = _ZERO
    target_qd: Six = _ZERO
    target_moment: Six = _ZERO
    temperatures: Six = _ZERO
    pose: Six = _ZERO
    force: Six = _ZERO
    raw: Six = _NAN
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
    wrong: float = 0.0
    back: float = 0.0


_WIDTH = [6 if isinstance(v, tuple) else 1 for v in Snapshot()]
_PAYLOAD = struct.Struct(f"={sum(_WIDTH)}d")
_BEATS = _HEAD.size + _PAYLOAD.size
SIZE = _BEATS + len(BEATS) * _BEAT.size


class SharedState:
    """The memory, of a descriptor that child processes inherit."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._memory = mmap.mmap(descriptor, SIZE)
        self._sequence = _HEAD.unpack_from(self._memory, 0)[0] | 1
        self._newest: Snapshot | None = None

    @classmethod
    def create(cls) -> Self:
        """New memory; it is freed when the last process that has it ends."""
        descriptor = os.memfd_create("wrenchbed-rtde")
        os.ftruncate(descriptor, SIZE)
        return cls(descriptor)

    def close(self) -> None:
        """Release it; may be called twice."""
        if self.descriptor >= 0:
            self._memory.close()
            os.close(self.descriptor)
            self.descriptor = -1

    def write(self, state: Snapshot) -> None:
        """Publish a state; only one process may write."""
        flat: list[float] = []
        for value in state:
            flat.extend(value) if isinstance(value, tuple) else flat.append(value)
        payload = _PAYLOAD.pack(*flat)
        odd = self._sequence
        self._sequence += 2
        check = zlib.crc32(payload, (odd + 1) & _WORD)
        self._put(0, _HEAD.pack(odd, 0))
        self._put(_HEAD.size, payload)
        self._put(0, _HEAD.pack(odd + 1, check))

    def read(self) -> Snapshot | None:
        """The newest complete state; None before the first.

        While a writer is within a state, or died there, the state before is returned.
        """
        for _ in range(_TRIES):
            raw = self._memory[:_BEATS]
            sequence, check = _HEAD.unpack_from(raw, 0)
            if sequence == 0:
                break
            payload = raw[_HEAD.size :]
            if sequence % 2 == 0 and check == zlib.crc32(payload, sequence & _WORD):
                self._newest = _snapshot(_PAYLOAD.unpack(payload))
                break
        return self._newest

    def beat(self, who: str) -> None:
        """Write the heartbeat of one of `BEATS`."""
        self._put(_place(who), _BEAT.pack(time.monotonic()))

    def silence(self, who: str) -> float:
        """Age of the heartbeat of one of `BEATS` [s]."""
        beat: float = _BEAT.unpack_from(self._memory, _place(who))[0]  # first: the clock is later
        return time.monotonic() - beat

    def _put(self, place: int, data: bytes) -> None:
        """One copy; `struct.pack_into` would let readers see zeros first."""
        self._memory[place : place + len(data)] = data


def _place(who: str) -> int:
    return _BEATS + BEATS.index(who) * _BEAT.size


def _snapshot(flat: tuple[float, ...]) -> Snapshot:
    values: list[float | Six] = []
    at = 0
    for width in _WIDTH:
        values.append(flat[at] if width == 1 else flat[at : at + width])
        at += width
    return Snapshot(*values)  # type: ignore[arg-type]
