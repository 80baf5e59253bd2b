"""How long a server runs, and where it may listen."""

import ipaddress
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from wrenchbed.errors import ParameterError


def check_local(host: str) -> None:
    """Refuse addresses that other machines could reach.

    Raises:
        ParameterError: not one of 127.0.0.0/8.
    """
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local:
        raise ParameterError(f"--host {host}: a twin serves this machine only: give 127.0.0.x")


@contextmanager
def until_told() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set; the handlers before are put back."""
    told = threading.Event()
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda *_: told.set()) for kind in kinds}
    try:
        yield told
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
