"""Serve a robot's protocols on this machine."""

import sys
import threading
from pathlib import Path
from typing import Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli import console as life
from wrenchbed.cli import console as settings
from wrenchbed.emulators.base import faults as timed
from wrenchbed.emulators.base.emulator import EmulatorOptions
from wrenchbed.errors import DriverError

_LOOK_S = 0.2


def twin(
    name: tyro.conf.Positional[Literal["ur5", "medrue", "netft"]],
    /,
    host: str = "127.0.0.1",
    parameters: Path | None = None,
    noise: Literal["real", "white", "off"] = "real",
    effect: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    faults: str | None = None,
    table: float | None = None,
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
    seed: int = 0,
) -> None:
    """Serve a robot's or sensor's protocols on this machine, backed by MuJoCo.

    Prints one line `ready …` with its addresses when clients may connect; Ctrl-C ends it.

    Args:
        name: Of the device.
        host: Address of this machine, 127.0.0.1 … 127.255.255.254; several twins need several.
        parameters: JSON {name: value} in SI: what the robot truly is.
        noise: Of the sensor.
        effect: ID[:name=value,…] of an effect on the robot, see `wrenchbed list effects`. May be
            repeated.
        faults: TOML script of timed faults (docs/how-to/hardware.md); `-` takes them as JSON lines
            on standard input.
        table: Height of a plate that the tool may press on [m].
        set: NAME=VALUE of a setting that this twin alone has; a wrong NAME lists them.
        seed: Of the noise.
    """
    console.check_seed(seed)
    options = EmulatorOptions(
        host, console.parameters(parameters), noise, seed, effect, table, settings.pairs(set)
    )
    server = wb.load("emulators", name)(options)
    script = timed.read(faults) if faults not in (None, "-") else ()
    server.faults.check(script, str(faults))
    with life.until_signal() as told:
        try:
            addresses = server.start()
            print("ready " + " ".join(f"{k}={v}" for k, v in addresses.items()), flush=True)
            server.faults.start(script, str(faults))
            if faults == "-":
                lock = threading.Lock()

                def answer(text: str) -> None:
                    with lock:
                        print(text, flush=True)

                server.faults.listen(sys.stdin, answer)
            while not told.wait(_LOOK_S) and not server.failed.is_set():
                pass
            if server.failure is not None:
                raise DriverError(f"this twin has broken down: {server.failure!r}")
        finally:
            server.faults.stop()
            server.stop()
