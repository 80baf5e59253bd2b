"""The MedRUE emulator: hub, drives, sensor board and plant, started and stopped together."""

import threading
from typing import ClassVar

import numpy as np

from wrenchbed.emulators.base.arguments import described, read
from wrenchbed.emulators.base.emulator import Emulator, EmulatorOptions
from wrenchbed.emulators.can_bus.bridge import Bridge
from wrenchbed.emulators.can_bus.hub import Hub
from wrenchbed.emulators.medrue.axis import Ratings
from wrenchbed.emulators.medrue.board import BoardEmulator
from wrenchbed.emulators.medrue.drive import DriveEmulator
from wrenchbed.emulators.medrue.faults import BusFaults
from wrenchbed.emulators.medrue.plant import CYCLE_S, DrivenArm, RealTimePlant
from wrenchbed.emulators.medrue.settings import BusSettings
from wrenchbed.robots.base import Joint

WINDOW = {"m": 0.02, "rad": 0.1}
"""Largest following error; the simulated servos follow 24 ms behind, so at 80 % of top speed it
is reached only by a fault."""
_QUICK_S = 0.1
"""A quick stop from top speed takes so long [s]."""


class MedrueEmulator(Emulator):
    """Six CiA 402 drives and an ATI Mini40 with NETCANOEM on one CAN bus."""

    name = "medrue"
    title = "MedRUE: CiA 402 drives and ATI Mini40 on CAN (socketcand)"
    settings: ClassVar = described(BusSettings)

    def __init__(self, options: EmulatorOptions) -> None:
        super().__init__(options)
        (setting,) = read(options.setting, BusSettings)
        self.setting: BusSettings = setting
        self.hub = Hub(
            options.host, setting.port, setting.channel, setting.bitrate, setting.wire, self.fail
        )
        body = DrivenArm(options.body("medrue"), CYCLE_S)
        lock = threading.RLock()
        counts = setting.per_unit(body.robot)
        self.plant = RealTimePlant(body, counts, lock, self.fail)
        self.drives = [
            self._drive(setting.nodes[j], joint, counts[j], body.q[j], lock)
            for j, joint in enumerate(body.robot.joints)
        ]
        self.plant.drives = self.drives
        self.board = self._board()
        self._bridge: Bridge | None = None
        BusFaults(self.faults, self.hub, self.drives, self.board)

    def serve(self) -> dict[str, str]:
        self.hub.start()
        kind, _, channel = self.setting.bus.partition(":")
        if kind:
            self._bridge = Bridge(self.hub, kind, channel)
        for drive in self.drives:
            drive.boot()
        self.plant.start()
        return {"can": f"socketcand:{self.hub.host}:{self.hub.port}:{self.hub.channel}"}

    def stop(self) -> None:
        self.plant.stop()
        if self._bridge is not None:
            self._bridge.stop()
        self.hub.stop()

    def _drive(
        self, node: int, joint: Joint, counts: float, q: float, lock: threading.RLock
    ) -> DriveEmulator:
        ratings = Ratings(
            lower=int(np.ceil(joint.lower * counts)),
            upper=int(np.floor(joint.upper * counts)),
            window=round(WINDOW[joint.unit] * counts),
            quick=joint.speed * counts / _QUICK_S,
            speed=joint.speed * counts,
            acceleration=2.0 * joint.speed * counts,
            torque=self.setting.rated_force if joint.unit == "m" else self.setting.rated_torque,
        )
        heard: list[DriveEmulator] = []
        ids = frozenset((0x000, 0x080, 0x200 + node, 0x600 + node))
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame), ids)
        heard.append(DriveEmulator(node, send, ratings, q * counts, self.setting.watchdog, lock))
        return heard[0]

    def _board(self) -> BoardEmulator:
        heard: list[BoardEmulator] = []
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame))
        setting = self.setting
        heard.append(
            BoardEmulator(
                send, setting.base, setting.slot, setting.counts, self.plant.wrench,
                setting.bitrate,
            )
        )  # fmt: skip
        return heard[0]
