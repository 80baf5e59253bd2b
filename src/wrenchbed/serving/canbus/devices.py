"""The devices of this process on a bus: who hears which id, and what happens when one fails.

A device whose code fails harms nobody else: its exception is handed on, and the bus goes on.
"""

from collections.abc import Callable

from wrenchbed.serving.canbus.wire import Frame

Heard = Callable[[float, Frame], None]
"""Called with the time at which a frame was complete (`time.monotonic`) and the frame."""
_IDS = 2048


class Devices:
    """Callbacks by number, each with the ids that it hears.

    Args:
        failed: told every exception of a device.
    """

    def __init__(self, failed: Callable[[Exception], None]) -> None:
        self._failed = failed
        self._all: dict[int, tuple[Heard, frozenset[int] | None]] = {}
        self._audience: dict[int, tuple[tuple[int, Heard], ...]] = {}

    def add(self, number: int, heard: Heard, ids: frozenset[int] | None) -> None:
        """One more; it hears all ids if None."""
        self._all[number] = (heard, ids)
        self._audience.clear()

    def hear(self, t: float, sender: int, frame: Frame) -> None:
        """Hand a frame, complete at t [s], to all who hear its id but its sender."""
        for number, heard in self._hearing(frame.can_id):
            if number != sender:
                try:
                    heard(t, frame)
                except Exception as error:
                    self._failed(error)

    def _hearing(self, can_id: int) -> tuple[tuple[int, Heard], ...]:
        if can_id not in self._audience:
            if len(self._audience) > _IDS:
                self._audience.clear()
            self._audience[can_id] = tuple(
                (number, heard)
                for number, (heard, ids) in self._all.items()
                if ids is None or can_id in ids
            )
        return self._audience[can_id]
