"""A Net F/T box on a body's sensor: RDT over UDP, web pages over HTTP, and their faults."""

import socket
import traceback
from collections.abc import Callable

from robot_emulators.base import arguments
from robot_emulators.base.arguments import Argument
from robot_emulators.base.event_loop import LoopThread
from robot_emulators.base.faults import Faults, LinkFaults, TimedFault
from robot_emulators.errors import EmulatorError
from robot_emulators.netft_box.pages import Pages, Reply
from robot_emulators.netft_box.rdt import Pace, Rdt
from robot_emulators.netft_box.sensing import BoxSettings, Sensing
from robot_emulators.netft_box.web import Web
from robot_emulators.plant import Plant

_SHARE = {"share": arguments.number(0.0, 1.0, 0.1)}
_RDT: dict[str, dict[str, Argument]] = {
    "drop": _SHARE, "duplicate": _SHARE, "swap": _SHARE, "buffered": {}, "freeze": {}, "stall": {},
    "short": {}, "garbage": {}, "foreign": {},
    "saturate": {"channel": arguments.integer(0, 5, 0)},
    "status": {"bits": arguments.integer(0, 2**32 - 1, 2**31)},
    "skew": {"factor": arguments.number(0.5, 2.0, 1.01)},
    "wrong_counts": {"factor": arguments.number(1e-6, 1e6, 10.0)},
}  # fmt: skip
_HTTP: dict[str, dict[str, Argument]] = {
    "stall": {}, "unlisten": {}, "garbage": {},
    "missing_field": {"name": arguments.text("cfgcpf")},
    "other_counts": {"factor": arguments.number(1e-6, 1e6, 10.0)},
}  # fmt: skip


class Box:
    """Serves the readings of a body's sensor; someone else steps the body in real time.

    Faults of link ``rdt``: ``drop``, ``duplicate``, ``swap`` (each with ``share``), ``buffered``,
    ``freeze``, ``stall``, ``short``, ``garbage``, ``foreign``, ``restart``, ``saturate``
    (``channel`` 0 … 5), ``status`` (``bits``), ``skew`` (``factor``) and ``wrong_counts``
    (``factor``). Of link ``http``: ``stall``, ``unlisten``, ``garbage``, ``missing_field``
    (``name``, for instance ``cfgcpf``) and ``other_counts`` (``factor``). ``seconds`` 0 lasts until
    the next fault of this kind.

    Args:
        body: whose sensor; its `Plant.readings` are this box's alone.
        host: address of this machine to serve at.
        faults: where its faults are registered.
        settings: of the box.
        seed: of faults that draw at random.
        failed: called with an error of the box itself.
    """

    def __init__(
        self,
        body: Plant,
        host: str,
        faults: Faults,
        settings: BoxSettings | None = None,
        seed: int = 0,
        failed: Callable[[Exception], None] = traceback.print_exception,
    ) -> None:
        self.settings = settings or BoxSettings()
        self._host, self._seed = host, seed
        self._rdt_faults = LinkFaults(faults, "rdt", _RDT)
        self._web_faults = LinkFaults(faults, "http", _HTTP)
        self._pace = Pace(self.settings.rate, self.settings.buffer)
        self._sensing = Sensing(body, self.settings, self._rdt_faults)
        self._pages = Pages(self.settings, self._pace, self._sensing)
        self._thread = LoopThread("netft box", failed)
        self._missing = ""
        self._socket: socket.socket | None = None
        self._rdt: Rdt | None = None
        self._web: Web | None = None
        faults.on("rdt", "restart", self._restart)
        self._web_faults.at_once("missing_field", self._leave_out)

    def start(self) -> dict[str, str]:
        """Serve from now on; the addresses of ``rdt`` and ``http``.

        Raises:
            EmulatorError: a port is taken or not allowed; names it.
        """
        try:
            self._socket = self._bind()
            self._web = self._listen()
        except EmulatorError:
            self.stop()
            raise
        self._sensing.warm_up()
        self._thread.start()
        self._rdt = Rdt(
            self._thread, self._socket, self._sensing, self._pace, self._rdt_faults, self._seed
        )
        self._thread.soon(self._rdt.start)
        host, port = self._socket.getsockname()
        return {"rdt": f"{host}:{port}", "http": "{}:{}".format(*self._web.address)}

    def stop(self) -> None:
        """Close both ports; may be called twice."""
        if self._web is not None:
            self._web.stop()
        if self._rdt is not None and self._thread.running:
            self._thread.call(self._rdt.stop)
        self._thread.stop()
        if self._socket is not None:
            self._socket.close()
        self._rdt = self._web = self._socket = None

    @property
    def counters(self) -> dict[str, int]:
        """Records ``sent``, ``dropped``, ``duplicated`` …, and datagrams."""
        return dict(self._rdt.counters) if self._rdt is not None else {}

    def _bind(self) -> socket.socket:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            sock.bind((self._host, self.settings.rdt_port))
        except OSError as error:
            sock.close()
            raise EmulatorError(
                f"UDP port {self._host}:{self.settings.rdt_port}: {error.strerror}: "
                "end what uses it, or serve at another 127.x address"
            ) from error
        return sock

    def _listen(self) -> Web:
        ports = [self.settings.http_port] if self.settings.http_port else [80, 8080]
        why: OSError | None = None
        for port in ports:
            try:
                return Web((self._host, port), self._page, self._web_faults)
            except PermissionError as error:
                why = error
            except OSError as error:
                why = error
                break
        reason = why.strerror if why else "refused"
        raise EmulatorError(
            f"TCP port {self._host}:{port}: {reason}: end what uses it, set another http_port, "
            "or serve at another 127.x address"
        ) from why

    def _page(self, target: str, body: str) -> Reply:
        missing = self._missing if self._web_faults.now("missing_field") is not None else ""
        other = self._web_faults.now("other_counts")
        return self._pages.answer(target, body, other["factor"] if other else 1.0, missing)

    def _restart(self, fault: TimedFault) -> None:
        if self._rdt is not None:
            self._rdt.forget()
        self._sensing.restart()

    def _leave_out(self, fault: TimedFault) -> None:
        self._missing = fault.values["name"]
