"""A drive of the emulator on a bus without real time, and drives that are wrong on purpose."""

import struct
import threading

from robot_emulators.can_bus.socketcand import Frame
from robot_emulators.medrue.drive import DriveEmulator
from robot_emulators.medrue.profile import Ratings

NODE = 3
RATINGS = Ratings(-1_000_000, 1_000_000, 20_000, 4e6, 4e5, 8e5, 2.0)
STEP, CYCLE = 0.001, 4
OFF = 1 << 31


class SimulatedBus:
    """A master of one drive whose axis does at once what it is told; time passes in `wait`."""

    def __init__(self, kind=DriveEmulator, ratings=RATINGS):
        self.t, self._ticks = 1.0, 0
        self.actual = self._speed = 0.0
        self.frames: list[Frame] = []
        """What the drive has sent since the last request."""
        self.drive = kind(NODE, self.frames.append, ratings, 0.0, 0.1, threading.RLock())
        self.drive.boot()
        self.frames.clear()

    def hear(self, can_id, data=b""):
        """Send the drive a frame."""
        self.drive.hear(self.t, Frame(can_id, data))

    def heard(self, can_id, seconds=0.0):
        """Data of what it has sent with an id since the last request, or sends within a time."""
        if seconds:
            self.wait(seconds)
        found = [frame.data for frame in self.frames if frame.can_id == can_id]
        self.frames.clear()
        return found

    def wait(self, seconds):
        for _ in range(round(seconds / STEP)):
            self.t += STEP
            self._ticks += 1
            if self._ticks % CYCLE == 0:
                before, passed = self.actual, STEP * CYCLE
                self.actual = self.drive.track(self.t, passed, before, self._speed, (0.0, 0.0))
                self._speed = (self.actual - before) / passed
            self.drive.tick(self.t)

    def ask(self, request):
        """The answer to an SDO request, None where none came."""
        self.frames.clear()
        self.hear(0x600 + NODE, request)
        return next((data for data in self.heard(0x580 + NODE)), None)

    def write(self, index, sub, value, size):
        """Write an object; the abort code, 0 where it was taken."""
        raw = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, sub)
        answer = self.ask(raw + struct.pack("<Q", value % (1 << 64))[:size].ljust(4, b"\0"))
        return struct.unpack_from("<I", answer, 4)[0] if answer[0] == 0x80 else 0

    def read(self, index, sub=0):
        answer = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert answer[0] & 0xE0 == 0x40
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little", signed=True)

    def control(self, word):
        """Write the controlword; the statusword a moment later."""
        assert self.write(0x6040, 0, word, 2) == 0
        self.wait(2 * STEP * CYCLE)
        return self.read(0x6041)

    def nmt(self, command):
        self.frames.clear()
        self.hear(0x000, bytes([command, NODE]))

    def map(self, parameters, can_id, *entries):
        """Change a PDO's mapping; the first abort code, 0 where all was taken."""
        mapping = parameters + 0x200
        codes = [self.write(parameters, 1, OFF | can_id, 4), self.write(mapping, 0, 0, 1)]
        codes += [self.write(mapping, k + 1, entry, 4) for k, entry in enumerate(entries)]
        codes += [self.write(mapping, 0, len(entries), 1), self.write(parameters, 1, can_id, 4)]
        return next((code for code in codes if code), 0)


def answered(change):
    """A drive whose SDO answers are changed on their way out."""

    class Changed(DriveEmulator):
        def send(self, can_id, data):
            if can_id == 0x580 + self.node:
                data = change(data)
            super().send(can_id, data)

    return Changed


def sent(change):
    """A drive whose frames are changed, or dropped where None comes back."""

    class Changed(DriveEmulator):
        def send(self, can_id, data):
            changed = change(self, can_id, data)
            if changed is not None:
                super().send(can_id, changed)

    return Changed


def abort(code, other):
    """Answers with one abort code in place of another."""

    def change(data):
        told = data[0] == 0x80 and struct.unpack_from("<I", data, 4)[0] == code
        return data[:4] + struct.pack("<I", other) if told else data

    return answered(change)


def _patched(**methods):
    """A drive with other methods."""
    return type("Patched", (DriveEmulator,), methods)


def _climbs(self, word):
    """0x0F climbs from SWITCH ON DISABLED."""
    if word & 0x8F == 0x0F and self.axis.state.name == "DISABLED":
        DriveEmulator._control(self, word & ~0x09)
    DriveEmulator._control(self, word)


def _own_toggle(data):
    """Segments of an upload whose toggle bit stays 0."""
    return bytes([data[0] & ~0x10]) + data[1:] if data[0] >> 5 == 0 else data


def _writable(index):
    """An object that must be read-only may be written."""

    class Writable(DriveEmulator):
        def boot(self, everything=True):
            super().boot(everything)
            self.objects.entry((index, 0)).access = "rw"

    return Writable


class _NoStop(DriveEmulator):
    """NMT STOP is ignored."""

    def _nmt(self, data):
        if data[0] != 0x02:
            super()._nmt(data)


def _level_reset(self, word):
    """Bit 7 resets a fault also where it was set before."""
    if word & 0x80:
        self.axis._word &= ~0x80
    DriveEmulator._control(self, word)


class _QuickStopBit(DriveEmulator):
    """Bit 5 stays set in QUICK STOP ACTIVE."""

    def refresh(self, t):
        super().refresh(t)
        if self.axis.state.name == "QUICK_STOP":
            self.objects[0x6041, 0] |= 0x20


class _NoConsumer(DriveEmulator):
    """A heartbeat that stays away is not noticed."""

    def _watch_others(self, t):
        pass


class _NoSyncNeeded(DriveEmulator):
    """Synchronous RPDOs act when they come."""

    def _receive(self, t, rpdo, data):
        super()._receive(t, rpdo, data)
        if rpdo.waiting is not None:
            values, rpdo.waiting = rpdo.waiting, None
            self._apply(values)


def _without(bits, mode):
    """Bits of the controlword that one mode ignores."""

    def control(self, word):
        ignored = bits if self.axis.set.mode == mode else 0
        DriveEmulator._control(self, word & ~ignored)

    return _patched(_control=control)


class _NoHome(DriveEmulator):
    """Bit 12 never tells that homing has ended."""

    def refresh(self, t):
        super().refresh(t)
        if self.axis.set.mode == 6:
            self.objects[0x6041, 0] &= ~0x1000


class _ShowsCyclic(DriveEmulator):
    """The shown mode is always cyclic synchronous position."""

    def refresh(self, t):
        super().refresh(t)
        self.objects[0x6061, 0] = 8


def _too_far_down(self, word):
    """DISABLE OPERATION leads to READY TO SWITCH ON."""
    enabled = self.axis.state.name == "ENABLED"
    DriveEmulator._control(self, 0x06 if enabled and word & 0x8F == 0x07 else word)


DEFECTS = {
    "another abort code for no object": abort(0x06020000, 0x08000000),
    "another abort code for no subindex": abort(0x06090011, 0x06020000),
    "0x0F climbs from SWITCH ON DISABLED": _patched(_control=_climbs),
    "segments of an upload do not toggle": answered(_own_toggle),
    "no EMCY": sent(lambda drive, i, data: None if i == 0x80 + drive.node else data),
    "TPDOs are a byte too long": sent(
        lambda drive, i, data: (data + b"\0")[:8] if i == 0x180 + drive.node else data
    ),
    "bit 5 of the statusword in a quick stop": _QuickStopBit,
    "the error code may be written": _writable(0x603F),
    "no boot-up message": sent(
        lambda drive, i, data: None if i == 0x700 + drive.node and data == b"\0" else data
    ),
    "NMT STOP is ignored": _NoStop,
    "a fault is reset by a level": _patched(_control=_level_reset),
    "a lost heartbeat is not noticed": _NoConsumer,
    "synchronous RPDOs act at once": _NoSyncNeeded,
    "halt does nothing in profile position mode": _without(0x100, 1),
    "relative set-points are absolute": _without(0x40, 1),
    "homing is never attained": _NoHome,
    "the shown mode is always 8": _ShowsCyclic,
    "0x07 leads from OPERATION ENABLED to READY": _patched(_control=_too_far_down),
}
