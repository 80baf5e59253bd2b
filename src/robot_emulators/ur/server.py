"""The UR5 emulator: ports, controller and faults of robot and links around one real-time loop."""

import struct
import time
import traceback
from collections.abc import Callable, Mapping
from functools import partial
from typing import ClassVar

from robot_emulators.base import named_values as rules
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.event_loop import LoopThread
from robot_emulators.base.faults import Handler
from robot_emulators.base.named_values import Argument, described, read
from robot_emulators.base.real_time import CycleClock
from robot_emulators.errors import EmulatorError
from robot_emulators.netft_box.box import Box
from robot_emulators.netft_box.sensing import BoxSettings
from robot_emulators.plant import PlantMaker, PlantRequest
from robot_emulators.ur import rtde_packets
from robot_emulators.ur.controller import Controller
from robot_emulators.ur.dashboard import Dashboard
from robot_emulators.ur.network import Conversation, Peer, Port
from robot_emulators.ur.outputs import Outputs, Timestamp
from robot_emulators.ur.primary import Primary
from robot_emulators.ur.realtime import Realtime
from robot_emulators.ur.rtde import Offer, Rtde
from robot_emulators.ur.settings import ControllerSettings

_BROKEN = {
    "short_header": struct.pack(">HB", 1, rtde_packets.DATA),
    "empty_data": rtde_packets.packet(rtde_packets.DATA),
    "short_data": rtde_packets.packet(rtde_packets.DATA, bytes([1]) + bytes(11)),
    "unknown_type": rtde_packets.packet(ord("?"), b"what is this"),
    "garbage": bytes(range(255, 0, -7)),
}
_PORTS = {"rtde": 30004, "dashboard": 29999, "primary": 30001, "secondary": 30002, "script": 30003}
"""Link → its TCP port, which clients expect; source: "Remote control via TCP/IP" of the maker."""
_LATE_S = 0.05
"""Lag [s] beyond which overdue control cycles are run without pauses between them."""
_PAUSE = 0.25
"""Pause before an overdue control cycle [periods], while the lag is below `_LATE_S`: without it, a
client that keeps only the newest state misses those between."""
_INJECT_S = 2.0


class UREmulator(Emulator):
    """Emulator of a UR controller with its arm, by default a UR5, and a Net F/T box beside it."""

    name = "ur5"
    title = "Universal Robots UR5 and its kin: RTDE, dashboard and script ports"
    settings: ClassVar[Mapping[str, str]] = described(ControllerSettings, BoxSettings)

    def __init__(self, options: Options, make_plant: PlantMaker) -> None:
        super().__init__(options, make_plant)
        settings, box = read(options.setting, ControllerSettings, BoxSettings)
        self._thread = LoopThread("ur5 emulator", self._break_down)
        self._clock: CycleClock
        self._settings: ControllerSettings = settings
        request = PlantRequest(
            settings.model, settings.cycle, drives=True, wrench_error=settings.wrench_error
        )
        self.plant = self.make_plant(request)
        self.controller = Controller(settings, self.plant)
        self._outputs = Outputs(self.controller, shared=not settings.box)
        self.timestamp = Timestamp(self.plant)
        self.controller.address = options.host
        self.primary = Primary(self.controller, self.timestamp)
        self._realtime = Realtime(self.controller, self.timestamp)
        offer = Offer(
            settings.version, 1.0 / settings.cycle, self.controller.fields, self.controller.inputs,
            partial(self.faults.now, "rtde"),
        )  # fmt: skip
        self.rtde = Rtde(offer)
        answers: dict[str, Callable[[Peer], Conversation]] = {
            "rtde": self.rtde.answer,
            "dashboard": lambda peer: Dashboard(
                self.controller, peer, lambda: self._thread.soon(lambda: self.restart(float("inf")))
            ),
            "primary": self.primary.primary,
            "secondary": self.primary.secondary,
            "script": self._realtime.answer,
        }
        self.ports = {
            name: Port(self._thread, (options.host, _PORTS[name]), self.faults, name, answer)
            for name, answer in answers.items()
        }
        self._register()
        self._box: Box | None = None
        if settings.box:
            self._box = Box(self.plant, options.host, self.faults, box, options.seed, self.fail)

    def serve(self) -> dict[str, str]:
        served = dict(self.ports)
        if self._settings.series == "x":  # PolyScope X has no dashboard server
            del served["dashboard"]
        self.controller.modes.tick(time.monotonic())  # clients are heard before the first cycle
        self._thread.start()
        for port in served.values():
            port.open()
        more = self._box.start() if self._box is not None else {}
        self._thread.soon(self._begin)
        return {name: "{}:{}".format(*port.address) for name, port in served.items()} | more

    def stop(self) -> None:
        self._thread.soon(self._close_ports)
        self._thread.stop()
        if self._box is not None:
            self._box.stop()

    def soon(self, task: Callable[[], None]) -> None:
        """Run ``task`` in the loop's thread and wait until it is done. Raises an `EmulatorError` if
        the loop has broken down or does not get to it in time.
        """
        why: object = self.failure
        if why is None:
            try:
                self._thread.call(task, _INJECT_S)
                return
            except TimeoutError:
                why = self.failure or f"it does not answer within {_INJECT_S:g} s"
        raise EmulatorError(f"the emulator's loop has stopped: {why}")

    def _register(self) -> None:
        """Register the faults of ports and robot; their handlers run in the loop's thread."""
        rtde, controller, timestamp = self.rtde, self.controller, self.timestamp
        named = Argument(lambda v: str(v) in controller.fields, "an output's name")
        for kind in ("freeze", "drop", "burst", "refuse_start", "in_use", "not_found"):
            self.faults.on("rtde", kind, None, {"field": named} if kind == "not_found" else None)
        at_once: dict[str, dict[str, Handler]] = {
            name: port.handlers() for name, port in self.ports.items()
        }
        at_once["rtde"] |= {
            "malformed": lambda f: rtde.inject(_BROKEN[f.values["how"]]),
            "text": lambda f: rtde.say(f.values["message"], rtde_packets.WARNING),
            "timestamp_jump": lambda f: timestamp.jump(float(f.values["by"])),
        }
        at_once["control"] = {
            "fin": lambda f: rtde.hang_up(reset=False),
            "rst": lambda f: rtde.hang_up(reset=True),
        }
        at_once["robot"] = {
            "protective_stop": lambda f: controller.protective_stop(),
            "emergency_stop": lambda f: controller.emergency_stop(f.end),
            "program_stop": lambda f: controller.stop_program(),
            "power_off": lambda f: controller.power_off(),
            "script_never_starts": lambda f: setattr(controller, "script_denied_until", f.end),
            "restart": lambda f: self.restart(f.seconds),
        }
        more = {
            "malformed": {"how": rules.word(_BROKEN)},
            "text": {"message": rules.text("this is a fault that was asked for")},
            "timestamp_jump": {"by": rules.number(-1e6, 1e6)},
        }
        for link, handlers in at_once.items():
            for kind, handler in handlers.items():
                self.faults.on(link, kind, self._in_loop(handler), more.get(kind))

    def _in_loop(self, handler: Handler) -> Handler:
        return lambda fault: self.soon(lambda: handler(fault))

    def restart(self, seconds: float) -> None:
        """Switch the control box off for ``seconds`` (all ports are closed), then boot it."""
        until = time.monotonic() + seconds
        self.controller.reboot()
        self._outputs.restart()
        self.faults.clear("rtde")
        for port in self.ports.values():
            port.hang_up()
            port.unlisten(until)
        self.timestamp.restart(until)

    def _begin(self) -> None:
        self._clock = CycleClock(self._settings.cycle)
        self._wait()

    def _wait(self, pause: float = 0.0) -> None:
        """Schedule the next control cycle at its deadline, but at least ``pause`` [s] from now."""
        self._thread.loop.call_at(max(self._clock.due, time.monotonic() + pause), self._turn)

    def _turn(self) -> None:
        """Run one control cycle at its deadline and schedule the next one."""
        clock = self._clock
        lost = clock.lost
        behind = clock.advance()
        self.timestamp.jump(clock.lost - lost)
        self.controller.arm.due = clock.due - clock.period
        self._cycle()
        self._wait(_PAUSE * clock.period if behind * clock.period < _LATE_S else 0.0)

    def _break_down(self, error: Exception) -> None:
        traceback.print_exception(error)
        self.fail(error)
        self._close_ports()

    def _cycle(self) -> None:
        now = time.monotonic()
        self.controller.cycle(now)
        wanted = self.rtde.wanted | self.primary.wanted | self._realtime.wanted
        self._outputs.update(self.timestamp.now(), wanted)
        self.rtde.stream(self.controller.values)
        self.primary.cycle(now)
        self._realtime.cycle()
        for port in self.ports.values():
            port.tick()

    def _close_ports(self) -> None:
        for port in self.ports.values():
            port.close()
