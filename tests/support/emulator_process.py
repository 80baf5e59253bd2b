"""An emulator in a separate process, and faults injected into it."""

import atexit
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import Any


class EmulatorProcess:
    """A running `wrenchbed twin`: its addresses by link, and `fault` to inject one."""

    def __init__(self, process: subprocess.Popen, addresses: dict[str, str]) -> None:
        self.process, self.addresses = process, addresses

    def fault(self, link: str, kind: str, **values: Any) -> None:
        """Inject one fault and wait until the emulator has done it."""
        self.process.stdin.write(json.dumps({"link": link, "kind": kind} | values) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().strip()
        assert answer == "done", answer


@contextmanager
def running(name: str, host: str, *more: str) -> Iterator[EmulatorProcess]:
    """`wrenchbed twin NAME --host HOST … --faults -` until the block ends."""
    command = [sys.executable, "-m", "wrenchbed", "twin", name, "--host", host, "--faults", "-"]
    process = subprocess.Popen(
        [*command, *more], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        line = process.stdout.readline()
        assert line.startswith("ready "), line
        yield EmulatorProcess(process, dict(part.split("=", 1) for part in line.split()[1:]))
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdin.close()
        process.stdout.close()


_KEPT = ExitStack()
atexit.register(_KEPT.close)


@cache
def shared(name: str, host: str, *more: str) -> EmulatorProcess:
    """The same, until all tests of this process end: files of tests share it."""
    return _KEPT.enter_context(running(name, host, *more))
