"""A drive of the emulator on a bus without real time."""

import struct
import threading

from robot_emulators.can_bus import Frame
from robot_emulators.medrue.cia402_node import DriveEmulator, rated

NODE = 3
RATINGS = rated(-1_000_000, 1_000_000, 20_000, 4e6, 4e5, 8e5, 2.0)
STEP, CYCLE = 0.001, 4
OFF = 1 << 31


class SimulatedBus:
    """A master of one drive whose axis does at once what it is told; time passes in `wait`."""

    def __init__(self, ratings=RATINGS):
        self.t, self._ticks = 1.0, 0
        self.actual = self._speed = 0.0
        self.frames: list[Frame] = []
        """What the drive has sent since the last request."""
        self.drive = DriveEmulator(NODE, self.frames.append, ratings, 0.0, threading.RLock())
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
