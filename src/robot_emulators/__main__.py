"""`python -m robot_emulators NAME`: serve a device with the built-in kinematic plant."""

import argparse
import os
import signal
import sys
import threading
from functools import partial

from robot_emulators.base.emulator import Options
from robot_emulators.errors import EmulatorError
from robot_emulators.serving import EMULATORS, serve

_LOOK_S = 0.2


def main(words: list[str] | None = None) -> int:
    """Serve the device that the command line names until Ctrl-C or SIGTERM; return exit status."""
    parser = argparse.ArgumentParser("python -m robot_emulators", description=__doc__)
    parser.add_argument("name", choices=sorted(EMULATORS))
    parser.add_argument("--host", default="127.0.0.1", help="127.0.0.1 … 127.255.255.254")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="setting")
    parser.add_argument("--faults", help="TOML script of timed faults; - takes JSON, a line each")
    asked = parser.parse_args(words)
    live = asked.faults == "-"
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    try:
        options = Options(asked.host, setting=dict(w.partition("=")[::2] for w in asked.setting))
        with serve(asked.name, options=options, faults=None if live else asked.faults) as server:
            parent, say = os.getppid(), partial(print, flush=True)
            say("ready", *(f"{k}={v}" for k, v in server.addresses.items()))
            if live:
                server.faults.listen(sys.stdin, say)
            while not ended.wait(_LOOK_S) and not server.failed.is_set():
                if live and os.getppid() != parent:  # whoever gave it faults was killed
                    break
            if server.failure is not None:
                raise EmulatorError(f"this emulator has broken down: {server.failure!r}")
    except EmulatorError as error:
        sys.stderr.write(f"robot_emulators: error: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
