"""Six CiA 402 drives behind a bus that answers at once, and a sensor that is well."""

import struct
import time

import numpy as np

from wrenchbed.errors import LinkError
from wrenchbed.hardware.device_base import Health

T = 0.004
RAMP = 3e5
"""Deceleration of a servo [count/s²], with or without voltage."""
BEAT = 0x77F
GUARDS = {(0x6007, 0): 1, (0x605A, 0): 0, (0x1016, 1): 0, (0x1029, 1): 1}


class Servo:
    """A drive: dictionary, state machine, and an axis that needs time to stop."""

    def __init__(self, node, position):
        self.node, self.position, self.speed, self.ramp = node, position, 0.0, RAMP
        self.state, self.rpdo = 0x40, (0, round(position))
        self.mute, self.stops_in = False, None  # seconds, where RAMP is not to hold
        self.stubborn = {}
        self.stepped = time.monotonic()
        self.running, self.lost = False, 0  # NMT commands that it does not hear
        told = {(0x1000, 0): 402, (0x6502, 0): 1 << 7}
        others = ((0x1400, 3), (0x1400, 5), (0x1006, 0), (0x1017, 0), (0x6060, 0))
        groups = [(i, s) for i in (0x1400, 0x1600, 0x1800, 0x1A00, 0x60C2) for s in range(4)]
        self.objects = dict.fromkeys([*groups, *others], 0) | told

    def control(self, word):
        climb = {0x06: 0x21, 0x07: 0x23, 0x0F: 0x27}
        if not word & 0x02:
            self.state = 0x40
        elif not word & 0x04:
            self.state = 0x07 if self.state in (0x27, 0x07) else 0x40
        elif self.state != 0x07:
            self.state = climb.get(word & 0x0F, self.state)

    def step(self):
        word, target = self.rpdo
        self.control(word)
        now = time.monotonic()
        passed, self.stepped = max(now - self.stepped, 1e-4), now
        if self.state == 0x27:
            self.speed, self.position = (target - self.position) / max(passed, T), target
            self.ramp = RAMP if self.stops_in is None else abs(self.speed) / self.stops_in
        else:
            self.speed -= np.clip(self.speed, -self.ramp * passed, self.ramp * passed)
            self.position += self.speed * passed
        return struct.pack("<Hi", self.state | 1 << 4, round(self.position))

    def nmt(self, command):
        if self.lost:
            self.lost -= 1
        else:
            self.running = command == 0x01

    def sdo(self, data):
        command, index, sub = struct.unpack_from("<BHB", data)
        if self.running and command >> 5 == 1 and index in (0x1400, 0x1600, 0x1800, 0x1A00):
            return struct.pack("<BHBI", 0x80, index, sub, 0x08000022)
        if (index, sub) not in self.objects:
            return struct.pack("<BHBI", 0x80, index, sub, 0x06020000)
        if command >> 5 == 2:
            return struct.pack("<BHBI", 0x43, index, sub, self.objects[index, sub])
        size = 4 - (command >> 2 & 3)
        value = int.from_bytes(data[4 : 4 + size], "little")
        self.objects[index, sub] = self.stubborn.get((index, sub), value)
        return struct.pack("<BHB4x", 0x60, index, sub)


class Bus:
    """Stands for a `Link`; drives answer at once. Keeps who was told what, when, how fast."""

    def __init__(self, servos):
        self.servos, self.dead, self.silent = servos, "", False
        self.error_frames = self.failures = self.full = self.beats = 0
        self.heard, self.told = (), []

    def listen(self, heard):
        self.heard = (*self.heard, heard)

    def leave(self, heard):
        self.heard = tuple(one for one in self.heard if one != heard)

    def close(self):
        self.dead = self.dead or "closed"

    def send(self, can_id, data):
        if self.dead:
            raise LinkError(self.dead)
        self.beats += (can_id, data) == (BEAT, b"\x05")
        for servo in self.servos:
            if can_id == 0x200 + servo.node:
                servo.rpdo = struct.unpack("<Hi", data)
                self.told.append((servo.node, servo.rpdo[0], servo.speed, time.monotonic()))
            elif can_id == 0x080 and not self.silent:
                self._answer(0x180 + servo.node, servo.step(), servo)
            elif can_id == 0x000 and data[1] in (0, servo.node):
                servo.nmt(data[0])
            elif can_id == 0x600 + servo.node:
                self._answer(0x580 + servo.node, servo.sdo(data), servo)

    def _answer(self, can_id, data, servo):
        for heard in () if servo.mute else self.heard:
            heard(time.monotonic(), can_id, data)

    def voltage_off(self, since=0.0):
        """Speeds and times at which a drive was told to switch its voltage off."""
        return [(abs(v), t) for _, word, v, t in self.told if not word & 0x02 and t > since]


class Sensor:
    """A transducer that is well, unless it is broken."""

    def __init__(self):
        self.broken, self.open = False, False

    def use(self, link):
        pass

    def poll(self):
        pass

    def connect(self):
        if self.broken:
            raise LinkError("no board")
        self.open = True

    def close(self):
        self.open = False

    def health(self):
        return Health("ok" if self.open else "closed")
