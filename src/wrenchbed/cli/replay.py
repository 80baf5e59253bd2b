"""`wrenchbed replay`: kept packets for drivers again."""

from pathlib import Path

import tyro

from wrenchbed.cli import console
from wrenchbed.cli.console import Flag
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.hardware.device import only_here

_LOOK_S = 0.2


def replay(
    folder: tyro.conf.Positional[Path],
    /,
    host: str = "127.0.0.9",
    http_port: int = 8080,
    once: Flag = False,
) -> None:
    """Play packets that `record --raw DIR` kept to a driver again, in their own time.

    Prints one line `ready …` with its addresses when a driver may connect; Ctrl-C ends it.

    Args:
        folder: DIR of the packets.
        host: Address of this machine, 127.0.0.1 … 127.255.255.254, to serve at.
        http_port: Of the box's page.
        once: End when a stream was played to its end.
    """
    from wrenchbed.hardware.packet_capture.playback import Playback

    if not only_here(host):
        raise ParameterError(f"--host {host}: give an address of this machine, 127.x")
    try:
        with console.until_signal() as stopped, Playback(folder, host, http_port) as played:
            words = " ".join(f"{name}={place}" for name, place in played.addresses.items())
            print(f"ready {words}", flush=True)
            while not stopped.wait(_LOOK_S) and not (once and played.done.is_set()):
                pass
    except OSError as error:
        raise DriverError(f"{host}: {error.strerror}: end what uses its ports") from error
