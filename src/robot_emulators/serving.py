"""The emulators by name, and how one is served while a block runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path

from robot_emulators.base import faults as timed
from robot_emulators.base.emulator import Emulator, Options
from robot_emulators.base.real_time import given_way
from robot_emulators.errors import SettingError
from robot_emulators.plant import Plant, PlantMaker

EMULATORS = {
    "medrue": "robot_emulators.medrue.server:MedrueEmulator",
    "netft": "robot_emulators.netft_box.box:NetftEmulator",
    "ur5": "robot_emulators.ur.server:UREmulator",
}
"""Name → module and class, imported on use."""


def load(name: str) -> type[Emulator]:
    """An emulator's class by name.

    Raises:
        SettingError: there is no such emulator; lists what exists.
    """
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
    """Serve an emulated robot or sensor while the block runs.

    Args:
        kind: a name of `EMULATORS`, or a class.
        plant: the robot behind it, or what makes it; the built-in kinematic one if None.
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


@contextmanager
def ur5(
    plant: Plant | PlantMaker | None = None, host: str = "127.0.0.1", **setting: str
) -> Iterator[str]:
    """Serve a UR5 while the block runs; the address at which clients find it.

    Args:
        plant: the robot behind it, or what makes it; the built-in kinematic one if None.
        host: address of this machine, 127.0.0.1 … 127.255.255.254.
        setting: of the controller, as ``series="e"``.
    """
    with serve("ur5", plant, Options(host, setting=setting)):
        yield host


def _maker(plant: Plant | PlantMaker | None) -> PlantMaker:
    if plant is None:
        from robot_emulators.kinematic_plant import kinematic_plant

        return kinematic_plant
    return plant if callable(plant) else lambda request: plant
