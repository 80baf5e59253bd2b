"""The twin: hub, drives, sensor board and plant, started and stopped together."""

import threading
from typing import ClassVar

import numpy as np

from wrenchbed.robots.base import Joint
from wrenchbed.serving.body import Options as BodyOptions
from wrenchbed.serving.canbus.bridge import Bridge
from wrenchbed.serving.canbus.hub import Hub
from wrenchbed.twins.base import Options, TwinServer
from wrenchbed.twins.medrue.arm import Arm
from wrenchbed.twins.medrue.axis import Ratings
from wrenchbed.twins.medrue.board import Board
from wrenchbed.twins.medrue.drive import Drive
from wrenchbed.twins.medrue.mischief import Mischief
from wrenchbed.twins.medrue.plant import CYCLE_S, Plant
from wrenchbed.twins.medrue.settings import KNOWN, read

WINDOW = {"m": 0.02, "rad": 0.1}
"""Largest following error; the simulated servos follow 24 ms behind, so at 80 % of top speed it
is reached only by a fault."""
_QUICK_S = 0.1
"""A quick stop from top speed takes so long [s]."""


class MedrueTwin(TwinServer):
    """Six CiA 402 drives and an ATI Mini40 with NETCANOEM on one CAN bus."""

    name = "medrue"
    title = "MedRUE: CiA 402 drives and ATI Mini40 on CAN (socketcand)"
    settings: ClassVar = KNOWN

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.setting = setting = read(options.setting)
        self.hub = Hub(
            options.host, setting.port, setting.channel, setting.bitrate, setting.wire, self.fail
        )
        body = Arm(
            BodyOptions(
                "medrue", options.parameters, options.noise, options.seed, options.effects,
                options.table,
            ),
            CYCLE_S,
        )  # fmt: skip
        lock = threading.RLock()
        counts = setting.per_unit(body.robot)
        self.plant = Plant(body, counts, lock, self.fail)
        self.drives = [
            self._drive(setting.nodes[j], joint, counts[j], body.q[j], lock)
            for j, joint in enumerate(body.robot.joints)
        ]
        self.plant.drives = self.drives
        self.board = self._board()
        self._bridge: Bridge | None = None
        Mischief(self.faults, self.hub, self.drives, self.board)

    def start(self) -> dict[str, str]:
        self.hub.start()
        try:
            kind, _, channel = self.setting.bus.partition(":")
            if kind:
                self._bridge = Bridge(self.hub, kind, channel)
        except BaseException:
            self.hub.stop()
            raise
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
    ) -> Drive:
        ratings = Ratings(
            lower=int(np.ceil(joint.lower * counts)),
            upper=int(np.floor(joint.upper * counts)),
            window=round(WINDOW[joint.unit] * counts),
            quick=joint.speed * counts / _QUICK_S,
            speed=joint.speed * counts,
            acceleration=2.0 * joint.speed * counts,
            torque=self.setting.rated_force if joint.unit == "m" else self.setting.rated_torque,
        )
        heard: list[Drive] = []
        ids = frozenset((0x000, 0x080, 0x200 + node, 0x600 + node))
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame), ids)
        heard.append(Drive(node, send, ratings, q * counts, self.setting.watchdog, lock))
        return heard[0]

    def _board(self) -> Board:
        heard: list[Board] = []
        send = self.hub.attach(lambda t, frame: heard[0].hear(t, frame))
        setting = self.setting
        heard.append(
            Board(
                send, setting.base, setting.slot, setting.counts, self.plant.wrench,
                setting.bitrate,
            )
        )  # fmt: skip
        return heard[0]
