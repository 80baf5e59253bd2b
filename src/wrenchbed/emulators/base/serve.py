"""Serve a device's protocols by name, with timed faults."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wrenchbed import registry
from wrenchbed.emulators.base import faults as timed
from wrenchbed.emulators.base.emulator import Emulator, EmulatorOptions


@contextmanager
def serve(
    name: str, options: EmulatorOptions | None = None, faults: str | Path | None = None
) -> Iterator[Emulator]:
    """Serve an emulated robot or sensor while the block runs.

    Args:
        name: see ``names("emulators")``.
        options: address, true parameters, noise, effects.
        faults: TOML script of timed faults; their time counts from the start of the block.

    Yields:
        The server; ``addresses`` names each link, ``failed`` is set if it breaks down.

    Raises:
        NotFoundError: there is no such emulator.
        MapError: the script of faults is wrong.
        DriverError: a port is taken or not allowed.
    """
    server: Emulator = registry.load("emulators", name)(options or EmulatorOptions())
    script = () if faults is None else timed.read(faults)
    server.faults.check(script, str(faults))
    try:
        server.addresses = server.start()
        server.faults.start(script, str(faults))
        yield server
    finally:
        server.faults.stop()
        server.stop()
