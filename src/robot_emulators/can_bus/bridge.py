"""A bridge from the hub to a bus of python-can: ``virtual`` in this process, or ``socketcan``."""

import contextlib

from robot_emulators.can_bus.hub import Hub
from robot_emulators.can_bus.wire import Frame
from robot_emulators.errors import EmulatorError


class Bridge:
    """Passes frames both ways until it is stopped.

    Args:
        hub: with its devices.
        interface: ``virtual`` or ``socketcan``.
        channel: name of the bus.

    Raises:
        EmulatorError: python-can is not installed, or there is no such bus.
    """

    def __init__(self, hub: Hub, interface: str, channel: str) -> None:
        try:
            import can
        except ImportError as error:
            raise EmulatorError("bus: install python-can: pip install python-can") from error
        try:
            bus = can.Bus(interface=interface, channel=channel)
        except (OSError, can.CanError, ValueError, NotImplementedError) as error:
            raise EmulatorError(f"cannot open {interface}:{channel}: {error}") from error

        def to_bus(_: float, frame: Frame) -> None:
            with contextlib.suppress(OSError, can.CanError):
                bus.send(
                    can.Message(
                        arbitration_id=frame.can_id, data=frame.data,
                        is_extended_id=frame.extended, is_remote_frame=frame.remote,
                    ),
                    timeout=0.0,
                )  # fmt: skip

        def to_hub(message: can.Message) -> None:
            if not message.is_error_frame:
                data = bytes(message.data)
                device.send(
                    Frame(
                        message.arbitration_id, data, message.is_extended_id,
                        message.is_remote_frame,
                    )
                )  # fmt: skip

        self._bus, self._device = bus, hub.attach(to_bus)
        device = self._device
        self._notifier = can.Notifier(bus, [to_hub], timeout=0.1)

    def stop(self) -> None:
        """Leave the bus; may be called twice."""
        self._device.heard = None
        self._notifier.stop()
        self._bus.shutdown()
