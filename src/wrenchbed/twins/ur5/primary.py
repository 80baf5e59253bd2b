"""Ports 30001 to 30003: they take URScript and send nothing."""

from wrenchbed.twins.ur5.controller import Controller
from wrenchbed.twins.ur5.script import Collector


class ScriptClient:
    """One client that sends programs."""

    def __init__(self, controller: Controller) -> None:
        self._controller, self._collector = controller, Collector()

    def receive(self, data: bytes, now: float) -> bool:
        """Take bytes of programs; False where one grows beyond all measure."""
        scripts = self._collector.feed(data)
        if scripts is None:
            return False
        self._controller.upload(scripts)
        return True

    def end(self) -> None:
        """The client is gone; an unfinished program with it."""
        self._collector = Collector()
