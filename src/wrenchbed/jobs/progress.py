"""The callback by which long work reports its progress."""

from typing import Protocol


class Progress(Protocol):
    """Called when further steps are done."""

    def __call__(self, count: int, label: str = "", /) -> None:
        """Report ``count`` further steps; ``label`` names the last one."""


def silent(count: int, label: str = "", /) -> None:
    """Report nothing."""
