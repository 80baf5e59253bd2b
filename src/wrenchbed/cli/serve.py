"""`wrenchbed twin`: serve a robot's protocols on this machine with an emulator."""

import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli import console as set_options
from wrenchbed.cli.console import Repeated
from wrenchbed.errors import DriverError

_LOOK_S = 0.2


@dataclass(frozen=True)
class EmulatorArguments:
    """The emulated device.

    Attributes:
        host: Address of this machine, 127.0.0.1 … 127.255.255.254; several twins need several.
        parameters: JSON {name: value} in SI: what the robot truly is.
        noise: Of the sensor.
        effect: ID[:name=value,…] of an effect on the robot, see `wrenchbed list effects`. May be
            repeated.
        table: Height of a plate that the tool may press on [m].
        set: NAME=VALUE of a setting that this twin alone has; a wrong NAME lists them.
        seed: Of the noise.
    """

    host: str = "127.0.0.1"
    parameters: Path | None = None
    noise: Literal["real", "white", "off"] = "real"
    effect: Repeated = ()
    table: float | None = None
    set: Repeated = ()
    seed: int = 0

    def options(self) -> "wb.EmulatorOptions":
        """The emulator's options."""
        console.check_seed(self.seed)
        parameters, words = console.parameters(self.parameters), set_options.pairs(self.set)
        return wb.EmulatorOptions(
            self.host, parameters, self.noise, self.seed, self.effect, self.table, words
        )


def twin(
    name: tyro.conf.Positional[str],
    /,
    device: EmulatorArguments,
    faults: str | None = None,
) -> None:
    """Serve a robot's or sensor's protocols on this machine, backed by MuJoCo.

    Prints one line `ready …` with its addresses when clients may connect; Ctrl-C ends it.

    Args:
        name: Of the device, see `wrenchbed list twins`.
        faults: TOML script of timed faults (docs/how-to/hardware.md); `-` takes them as JSON lines
            on standard input.
    """
    script = None if faults in (None, "-") else faults
    with console.until_signal() as stopped, wb.serve(name, device.options(), script) as server:
        print("ready " + " ".join(f"{k}={v}" for k, v in server.addresses.items()), flush=True)
        if faults == "-":
            lock = threading.Lock()

            def answer(text: str) -> None:
                with lock:
                    print(text, flush=True)

            server.faults.listen(sys.stdin, answer)
        while not stopped.wait(_LOOK_S) and not server.failed.is_set():
            pass
        if server.failure is not None:
            raise DriverError(f"this twin has broken down: {server.failure!r}")
