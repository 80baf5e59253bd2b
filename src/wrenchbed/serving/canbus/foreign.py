"""Traffic of others that takes up the wire."""

from wrenchbed.serving.canbus.wire import Frame, Wire

NOBODY = 0
"""Sender of traffic that occupies the wire while everybody's acceptance filter drops it."""
_FRAME = Frame(0x001, bytes(range(8)))


class Foreign:
    """Frames of a very low id that use a share of the wire for some time."""

    def __init__(self) -> None:
        self.interval = 1e-3
        self._until = self._next = 0.0

    def start(self, now: float, seconds: float, share: float, bitrate: int) -> None:
        """Use a share of the wire from now on [s]."""
        self.interval = _FRAME.bits / (bitrate * min(max(share, 0.01), 1.0))
        self._until, self._next = now + seconds, now

    def active(self, now: float) -> bool:
        """Whether they are about."""
        return now < self._until

    def offer(self, now: float, wire: Wire) -> None:
        """Hand the wire what they have sent by now."""
        if not self.active(now):
            return
        while self._next <= now:
            wire.offer(self._next, NOBODY, _FRAME)
            self._next += self.interval
