"""The twin: ports, controller and fault handlers around one real-time loop.

What this twin alone can be told.
"""

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wrenchbed.emulators import netft_box
from wrenchbed.emulators.base.body import Body
from wrenchbed.emulators.base.emulator import Emulator, EmulatorOptions
from wrenchbed.emulators.base.event_loop import LoopThread
from wrenchbed.emulators.base.real_time import CycleClock, take_priority
from wrenchbed.emulators.netft_box import Box
from wrenchbed.emulators.ur5.controller import Controller
from wrenchbed.emulators.ur5.dashboard import Dashboard, ScriptClient
from wrenchbed.emulators.ur5.faults import Misbehaviour
from wrenchbed.emulators.ur5.modes import Make
from wrenchbed.emulators.ur5.network import Conversation, Peer, Port
from wrenchbed.emulators.ur5.outputs import Outputs, Timestamp
from wrenchbed.emulators.ur5.packets import Version
from wrenchbed.emulators.ur5.rtde import Offer, Rtde
from wrenchbed.emulators.ur5.tool_wrench import OwnSensor, Payload
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.robots.base import INERTIA_AXES

_SERIES: dict[str, tuple[Version, float]] = {
    "cb3": ((3, 15, 8, 106339), 0.008),
    "e": ((5, 11, 1, 108318), 0.002),
}
_SWITCH = {"on": True, "off": False}


@dataclass(frozen=True)
class ControllerSettings:
    """Version and control cycle [s], and the settings below as numbers."""

    version: Version
    cycle: float
    protective_force: float
    slow_reader: float
    powered: bool
    realtime: bool
    box: netft_box.BoxSettings | None


def described() -> dict[str, str]:
    """Name of each setting → what it does and its default."""
    return {
        "series": "cb3 (125 Hz, software 3.15) or e (500 Hz, software 5.11); default cb3",
        "protective_force": "force at the tool from which the robot stops [N]; default 150",
        "slow_reader": "seconds after which a client that takes nothing is closed; default 10",
        "power": "on or off: whether the arm is on with its brakes free at the start; default on",
        "realtime": "on or off: ask the system for real-time scheduling; default off",
        "box": "on or off: a Net F/T box that shows the arm's sensor; default on. Without it "
        "ft_raw_wrench shows that sensor, with it the arm's own",
        **netft_box.HELP,
    }


def parse(given: Mapping[str, str]) -> ControllerSettings:
    """Check settings.

    Raises:
        ParameterError: an unknown name or an impossible value; lists what exists.
    """
    known = described()
    for name in given:
        if name not in known:
            listed = "; ".join(f"{key}: {text}" for key, text in known.items())
            raise ParameterError(f"twin ur5 has no setting {name!r}. Known: {listed}")
    series = given.get("series", "cb3")
    if series not in _SERIES:
        raise ParameterError(f"setting series={series}: give cb3 or e")
    version, cycle = _SERIES[series]
    return ControllerSettings(
        version,
        cycle,
        _positive(given, "protective_force", 150.0),
        _positive(given, "slow_reader", 10.0),
        _switch(given, "power", True),
        _switch(given, "realtime", False),
        _box(given),
    )


def _box(given: Mapping[str, str]) -> netft_box.BoxSettings | None:
    words = {name: text for name, text in given.items() if name in netft_box.HELP}
    return netft_box.BoxSettings.from_words(words) if _switch(given, "box", True) else None


def _positive(given: Mapping[str, str], name: str, default: float) -> float:
    try:
        value = float(given.get(name, default))
    except ValueError:
        value = float("nan")
    if not value > 0.0:
        raise ParameterError(f"setting {name}={given[name]}: give a number above 0")
    return value


def _switch(given: Mapping[str, str], name: str, default: bool) -> bool:
    if name not in given:
        return default
    if given[name] not in _SWITCH:
        raise ParameterError(f"setting {name}={given[name]}: give on or off")
    return _SWITCH[given[name]]


_DASHBOARD, _SCRIPT = 29999, (30001, 30002, 30003)
_LATE_S = 0.05
"""Lag beyond which the loop leaves out packets to catch up [s] …"""
_SHARE = 4
"""… and sends one in so many cycles."""
_INJECT_S = 2.0


class UR5Emulator(Emulator):
    """A Universal Robots UR5 whose controller is served on this machine."""

    name = "ur5"
    title = "Universal Robots UR5: RTDE, dashboard and script ports"
    settings: ClassVar[Mapping[str, str]] = described()

    def __init__(self, options: EmulatorOptions) -> None:
        super().__init__(options)
        self._settings = parse(options.setting)
        self._thread = LoopThread("ur5 emulator", self._break_down, cyclic=True)
        self._clock: CycleClock
        self._sent_at = 0.0
        self._build(options, self._settings)

    def serve(self) -> dict[str, str]:
        for port in self.ports.values():
            port.open()
        found = self._box.start() if self._box is not None else {}
        self.controller.now = time.monotonic()  # clients are heard before the first cycle
        self._thread.soon(self._begin)
        self._thread.start()
        shown = {name: self.ports[name].address for name in ("rtde", "dashboard", "script")}
        return shown | found

    def stop(self) -> None:
        if self._thread.running:
            self._thread.soon(self._close_ports)
            self._thread.stop()
        else:
            self._close_ports()
        if self._box is not None:
            self._box.stop()

    def soon(self, task: Callable[[], None]) -> None:
        """Do something in the loop's thread; returns when it was done.

        Raises:
            DriverError: the loop has broken down or did not get to it in time.
        """
        why: object = self.failure
        if why is None:
            try:
                self._thread.call(task, _INJECT_S)
                return
            except TimeoutError:
                why = self.failure or f"it does not answer within {_INJECT_S:g} s"
        raise DriverError(f"the emulator's loop has stopped: {why}")

    def _build(self, options: EmulatorOptions, settings: ControllerSettings) -> None:
        self.body = Body(options.body("ur5"), settings.cycle)
        make = Make(settings.version, settings.cycle, settings.protective_force, settings.powered)
        own = OwnSensor(self.body, make.e_series, options.effects, options.noise, options.seed)
        self.controller = Controller(make, self.body, _installed(self.body), own.load)
        self._outputs = Outputs(self.controller, shared=settings.box is None)
        self.timestamp = Timestamp(self.body)
        offer = Offer(
            make.version, 1.0 / settings.cycle, self.controller.fields, self.controller.inputs
        )
        host, patience = options.host, settings.slow_reader
        self.rtde = Rtde(self._thread, host, offer, patience)
        self.ports: dict[str, Port] = {
            "rtde": self.rtde.port,
            "dashboard": Port(self._thread, host, _DASHBOARD, self._dashboard, patience),
            **{
                name: Port(self._thread, host, number, self._script, patience)
                for name, number in zip(("primary", "secondary", "script"), _SCRIPT, strict=True)
            },
        }
        self._box: Box | None = None
        if settings.box is not None:
            self._box = Box(self.body, host, self.faults, settings.box, options.seed)
        Misbehaviour(self).register(self.faults)

    def _dashboard(self, peer: Peer) -> Conversation:
        return Dashboard(self.controller, peer, self._shut_down)

    def _script(self, peer: Peer) -> Conversation:
        return ScriptClient(self.controller)

    def _shut_down(self) -> None:
        self._thread.soon(lambda: self.restart(float("inf")))

    def restart(self, seconds: float) -> None:
        """Cut the power of the control box for a time [s]."""
        until = time.monotonic() + seconds
        self.controller.reboot()
        self._outputs.restart()
        self.rtde.restart()
        for port in self.ports.values():
            port.hang_up()
            port.unlisten(until)
        self.timestamp.restart(until)

    def _begin(self) -> None:
        if self._settings.realtime:
            take_priority()
        self._clock = CycleClock(self._settings.cycle)
        self._wait()

    def _wait(self) -> None:
        self._thread.loop.call_at(self._clock.due, self._turn)

    def _turn(self) -> None:
        """Take a control cycle at its deadline."""
        clock = self._clock
        lost = clock.lost
        behind = clock.advance()
        self.timestamp.lost(clock.lost - lost)
        self.body.due = clock.due - clock.period
        self._cycle(behind)
        self.controller.inputs.cycle(time.monotonic(), clock.due)
        self._wait()

    def _break_down(self, error: Exception) -> None:
        traceback.print_exception(error)
        self.fail(error)
        self._close_ports()

    def _cycle(self, behind: int) -> None:
        now = time.monotonic()
        self.controller.cycle(now)
        self._outputs.update(self.timestamp.now(), self.rtde.wanted)
        cycle = self._settings.cycle
        send = behind * cycle < _LATE_S or now - self._sent_at > _SHARE * cycle
        self._sent_at = now if send else self._sent_at
        self.rtde.stream(self.controller.values, send)
        for port in self.ports.values():
            port.tick(now)

    def _close_ports(self) -> None:
        for port in self.ports.values():
            port.close()


def _installed(body: Body) -> Payload:
    """The nominal tool, as a user would have entered it."""
    robot = body.robot
    nominal = robot.parameters.nominal
    tool, values = robot.tool(nominal), robot.values(nominal)
    inertia = np.array([float(values[f"tool.inertia.{axes}"]) for axes in INERTIA_AXES])
    return Payload(float(tool.mass), np.array(tool.cog, dtype=float), inertia)
