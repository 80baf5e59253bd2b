"""Table of the emulators by name, and context managers that serve one while a block runs. `device`
reads what __main__.py prints (``ready link=address …``, answers to faults): change both
together."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from ipaddress import IPv4Address
from pathlib import Path
from random import randrange

from robot_emulators.base import faults as timed
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.real_time import given_way
from robot_emulators.errors import EmulatorError, FaultError, SettingError
from robot_emulators.plant import Plant, PlantMaker

EMULATORS = {
    "medrue": "robot_emulators.medrue.server:MedrueEmulator",
    "netft": "robot_emulators.netft_box.box:NetftEmulator",
    "ur5": "robot_emulators.ur.server:UREmulator",
}
"""Name of an emulator → module and class, imported on use; wrenchbed's command line lists them."""


def load(name: str) -> type[Emulator]:
    """Return the class of an emulator by its name; a `SettingError` lists the known names."""
    if name not in EMULATORS:
        raise SettingError(f"there is no emulator {name!r}. Known: {', '.join(EMULATORS)}")
    module, _, kind = EMULATORS[name].partition(":")
    emulator: type[Emulator] = getattr(import_module(module), kind)
    return emulator


@contextmanager
def serve(
    kind: str | type[Emulator],
    plant: Plant | PlantMaker | None = None,
    options: Options | None = None,
    faults: str | Path | None = None,
) -> Iterator[Emulator]:
    """Serve an emulated robot or sensor, in this process, while the block runs.

    Args:
        kind: a name of `EMULATORS`, or a class of emulators.
        plant: the robot behind it, or a function that makes one; None: the built-in kinematic one.
        options: address, seed, settings.
        faults: TOML script of timed faults; their time counts from the start of the block.

    Yields:
        The server; ``addresses`` names each link, ``failed`` is set if it breaks down.

    Raises:
        SettingError: there is no such emulator or setting.
        FaultError: the script of faults is wrong.
        EmulatorError: a port is taken or not allowed.
    """
    emulator = load(kind) if isinstance(kind, str) else kind
    server = emulator(options or Options(), _maker(plant))
    script = () if faults is None else timed.read(faults)
    server.faults.check(script, str(faults))
    try:
        server.start()
        server.faults.start(script)
        with given_way():
            yield server
    finally:
        server.faults.stop()
        server.stop()


class Device(str):
    """An emulator under test: a text, its address, whose methods make faults.

    ``robot.protective_stop()`` makes that fault now; ``robot.drop(0.2)`` one that lasts 0.2 s,
    ``robot.drop()`` one without end. ``link="dashboard"`` names the link that fails, else it is the
    first that has the fault; further values are keywords. ``host`` is the address as plain text,
    ``addresses`` maps link → address.
    """

    host: str
    addresses: Mapping[str, str]
    _order: Callable[[dict[str, object]], None]

    def __getattr__(self, kind: str) -> Callable[..., None]:
        if kind.startswith("_"):
            raise AttributeError(kind)

        def happen(seconds: float = 0.0, **values: object) -> None:
            self._order({"kind": kind, "seconds": seconds} | values)

        return happen


@contextmanager
def device(
    kind: str, plant: Plant | PlantMaker | None = None, host: str = "", **setting: str
) -> Iterator[Device]:
    """Serve an emulator while the block runs; yield its address, with its faults as methods.

    Args:
        kind: a name of `EMULATORS`.
        plant: the robot behind it, or a function that makes one, served in this process; None: the
            built-in one in its own process, as client libraries may hold Python's lock.
        host: address of this machine; if empty one of 16 million, so that many serve at once.
        setting: settings of the emulator, as ``series="e"``.
    """
    result = Device(host or IPv4Address("127.1.0.1") + randrange(250 << 16))
    result.host = host = str(result)
    if plant is not None:
        with serve(kind, plant, Options(host, setting=setting)) as server:
            result.addresses = server.addresses
            result._order = lambda raw: server.faults.inject(timed.parse(raw, "fault"))
            yield result
        return
    words = [f"--host={host}", "--faults=-", *(f"--set={n}={v}" for n, v in setting.items())]
    command, pipe = [sys.executable, "-m", "robot_emulators", kind, *words], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdin and process.stdout and process.stderr
        said, asked, wrong = process.stdout, process.stdin, process.stderr

        def order(raw: dict[str, object]) -> None:
            asked.write(json.dumps(raw) + "\n")
            asked.flush()
            if (answer := said.readline().strip()) != "done":
                raise FaultError(answer)

        try:
            ready, *links = said.readline().split() or [""]
            if not ready:
                raise EmulatorError(wrong.read().strip())
            result.addresses = dict(link.split("=", 1) for link in links)
            result._order = order
            yield result
        finally:
            process.terminate()


ur5, netft, medrue = (partial(device, kind) for kind in ("ur5", "netft", "medrue"))
"""Context managers that serve a UR5, a Net F/T box, or CiA 402 drives and a sensor board on CAN."""


def _maker(plant: Plant | PlantMaker | None) -> PlantMaker:
    if plant is None:
        from robot_emulators.kinematic_plant import kinematic_plant

        return kinematic_plant
    return plant if callable(plant) else lambda request: plant
