"""A Net F/T box for a plant's sensor, alone or beside a robot: RDT over UDP, pages over HTTP."""

import socket
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from typing import ClassVar

from robot_emulators.base import named_values as rules
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.event_loop import LoopThread, taken
from robot_emulators.base.faults import Faults, TimedFault
from robot_emulators.base.named_values import Argument, described, read
from robot_emulators.base.real_time import CycleThread
from robot_emulators.errors import EmulatorError
from robot_emulators.netft_box.pages import Pages, Reply, Web
from robot_emulators.netft_box.rdt import Pace, Rdt
from robot_emulators.netft_box.sensing import BoxSettings, Sensing
from robot_emulators.plant import Plant, PlantMaker, PlantRequest

_CYCLE = 0.008
_FRACTION = {"share": rules.number(0.0, 1.0, 0.1)}
_FACTOR = {"factor": rules.number(1e-6, 1e6, 10.0)}
_KINDS: dict[str, dict[str, dict[str, Argument]]] = {
    "rdt": {
        "drop": _FRACTION, "duplicate": _FRACTION, "swap": _FRACTION, "buffered": {},
        "freeze": {}, "stall": {}, "short": {}, "garbage": {}, "foreign": {},
        "saturate": {"channel": rules.integer(0, 5, 0)},
        "status": {"bits": rules.integer(0, 2**32 - 1, 2**31)},
        "skew": {"factor": rules.number(0.5, 2.0, 1.01)},
        "wrong_counts": _FACTOR,
    },
    "http": {
        "stall": {}, "unlisten": {}, "garbage": {},
        "missing_field": {"name": rules.text("cfgcpf")},
    },
}  # fmt: skip
"""Link → kinds of fault that last, with their arguments."""


class Box:
    """An emulated Net F/T box (ATI) with a plant's sensor readings; the caller steps the plant.

    Args:
        body: plant whose `Plant.readings` are served.
        host: address of this machine to serve at.
        faults: registry of the emulator's faults, to which the box adds its own.
        settings: units, counts, rate and ports; None: defaults.
        seed: seed of random faults.
        failed: called with an error that stops the box.
    """

    def __init__(
        self, body: Plant, host: str, faults: Faults, settings: BoxSettings | None = None,
        seed: int = 0, failed: Callable[[Exception], None] = traceback.print_exception,
    ) -> None:  # fmt: skip
        self.settings = settings or BoxSettings()
        self._host, self._seed, self._faults = host, seed, faults
        for link, kinds in _KINDS.items():
            for kind, more in kinds.items():
                faults.on(link, kind, None, more)
        faults.on("rdt", "restart", self._restart)
        self._pace = Pace(self.settings.rate)
        sensing = self._sensing = Sensing(body, self.settings, faults)
        faults.on("rdt", "recalibrate", lambda f: sensing.rescale(f.values["factor"]), _FACTOR)
        self._pages = Pages(self.settings, self._pace, self._sensing)
        self._thread = LoopThread("netft box", failed)
        self._socket: socket.socket | None = None
        self._rdt: Rdt | None = None
        self._web: Web | None = None

    def start(self) -> dict[str, str]:
        """Begin to serve; return link → address of ``rdt`` (records by UDP) and ``http`` (web
        pages). Raises an `EmulatorError` if a port is taken or not allowed."""
        try:
            self._socket = self._bind()
            self._web = self._listen()
        except EmulatorError:
            self.stop()
            raise
        self._sensing.warm_up()
        self._thread.start()
        self._rdt = Rdt(
            self._thread, self._socket, self._sensing, self._pace, self._faults, self._seed
        )
        self._thread.soon(self._rdt.start)
        host, port = self._socket.getsockname()
        return {"rdt": f"{host}:{port}", "http": "{}:{}".format(*self._web.address)}

    def stop(self) -> None:
        """Close the box's ports for records (RDT, UDP) and web pages; may be called twice."""
        if self._web is not None:
            self._web.stop()
        if self._rdt is not None:
            self._thread.call(self._rdt.stop)
        self._thread.stop()
        if self._socket is not None:
            self._socket.close()
        self._rdt = self._web = self._socket = None

    @property
    def counters(self) -> Counter[str]:
        """Number of records (RDT) ``sent``, ``dropped``, ``duplicated`` …, and of ``datagrams``."""
        return Counter() if self._rdt is None else self._rdt.counters

    def _bind(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.bind((self._host, self.settings.rdt_port))
        except OSError as error:
            sock.close()
            raise taken("RDT (UDP)", self._host, self.settings.rdt_port, error) from error
        return sock

    def _listen(self) -> Web:
        ports = [self.settings.http_port] if self.settings.http_port else [80, 8080]
        for port in ports:
            try:
                return Web((self._host, port), self._page, self._faults)
            except OSError as error:
                if not isinstance(error, PermissionError) or port == ports[-1]:
                    raise taken("HTTP (TCP)", self._host, port, error) from error
        raise AssertionError("a port is served or refused")

    def _page(self, target: str, body: str) -> Reply:
        missing = self._faults.now("http", "missing_field")
        return self._pages.answer(target, body, missing["name"] if missing else "")

    def _restart(self, fault: TimedFault) -> None:
        if self._rdt is not None:
            self._rdt.forget()
        self._sensing.restart()


class NetftEmulator(Emulator):
    """Emulator of ATI's Net F/T sensor box; the sensor is on a UR5 at rest in its home pose."""

    name = "netft"
    title = "ATI Net F/T: RDT over UDP, netftapi2.xml over HTTP"
    settings: ClassVar[Mapping[str, str]] = described(BoxSettings)

    def __init__(self, options: Options, make_plant: PlantMaker) -> None:
        super().__init__(options, make_plant)
        (settings,) = read(options.setting, BoxSettings)
        self.body = make_plant(PlantRequest("ur5", _CYCLE))
        self.box = Box(self.body, options.host, self.faults, settings, options.seed, self.fail)
        self._thread = CycleThread("netft body", _CYCLE, 2.0 * _CYCLE, self._step, self.fail)
        self._home = self.body.arm.home

    def serve(self) -> dict[str, str]:
        self._thread.start()
        return self.box.start()

    def stop(self) -> None:
        self._thread.stop()
        self.box.stop()

    def _step(self, due: float) -> None:
        self.body.step(self._home, due)
