"""The socket at which a hub takes its clients."""

import socket

from wrenchbed.errors import DriverError


def listening(host: str, port: int, clients: int) -> socket.socket:
    """A socket that waits for clients and does not block.

    Raises:
        DriverError: the port is taken or not allowed.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        raise DriverError(
            f"cannot serve CAN at {host}:{port}: {error.strerror}; "
            "end the other server or give another host or port"
        ) from error
    listener.listen(clients)
    listener.setblocking(False)
    return listener
