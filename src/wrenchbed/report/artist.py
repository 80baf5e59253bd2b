"""Figures drawn beside the main work, in processes that make ready while it goes on."""

import signal
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from types import TracebackType
from typing import Self

from wrenchbed.errors import MissingExtraError
from wrenchbed.report import figures

HANDS = 2
"""Processes: figures take half of the time that one takes, on two cores."""


class Artist:
    """Draws figures in other processes; they load what draws as soon as the context is entered.

    ```
    with Artist() as artist:
        figure = artist.draw(figures.gaps, rows)
        ...
        svg = figure.result()
    ```
    """

    def __enter__(self) -> Self:
        # forked at once: what is loaded here need not be loaded again
        self._pool = ProcessPoolExecutor(HANDS, get_context("fork"), _ready)
        for _ in range(HANDS):
            self._pool.submit(_rehearse)
        return self

    def draw(self, figure: Callable[..., str], *given: object) -> "Future[str]":
        """SVG of a figure to come."""
        return self._pool.submit(figure, *given)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._pool.shutdown(cancel_futures=True)


def at_once(figure: Callable[..., str], *given: object) -> "Future[str]":
    """SVG of a figure, drawn here and now."""
    drawn: Future[str] = Future()
    drawn.set_result(figure(*given))
    return drawn


def _ready() -> None:
    """Who stops the main work stops it alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _rehearse() -> None:
    """Load libraries and fonts."""
    try:
        figures.gaps([("ready", 1.0, "sim")])
    except MissingExtraError:
        return  # told where it is missed
