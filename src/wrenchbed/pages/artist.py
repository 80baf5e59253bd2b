"""Who draws charts: here and now, or the `Artist`, beside what else is done."""

from concurrent.futures import Future
from contextlib import ExitStack
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from wrenchbed.errors import MissingExtraError
from wrenchbed.jobs.workers import workers
from wrenchbed.pages import Drawn
from wrenchbed.pages.chart import Axis, Chart, Panel, Series
from wrenchbed.pages.draw import svg


def draw(chart: Chart) -> Drawn:
    """A chart with its SVG."""
    return Drawn(chart, svg(chart))


class Draws(Protocol):
    """Whoever draws charts, now or beside."""

    def draw(self, chart: Chart) -> "Future[Drawn]":
        """A figure to come."""


class AtOnce:
    """Draws here and now."""

    def draw(self, chart: Chart) -> "Future[Drawn]":
        """A figure, drawn."""
        drawn: Future[Drawn] = Future()
        drawn.set_result(draw(chart))
        return drawn


class Artist:
    """Draws figures in another process, which loads what draws as soon as the context is entered.

    ```
    with Artist() as artist:
        figure = artist.draw(chart)
        ...
        drawn = figure.result()
    ```
    """

    def __enter__(self) -> Self:
        # forked at once: what is loaded here need not be loaded again
        self._pools = ExitStack()
        self._pool = self._pools.enter_context(workers(1, forked=True))
        self._pool.submit(_rehearse)
        return self

    def draw(self, chart: Chart) -> "Future[Drawn]":
        """A figure to come."""
        return self._pool.submit(draw, chart)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._pools.__exit__(kind, error, trace)


def _rehearse() -> None:
    """Load libraries and fonts."""
    try:
        line = Series("", "line", np.arange(2.0), np.arange(2.0))
        draw(Chart("", "", (Panel(Axis("x"), Axis("y"), (line,)),)))
    except MissingExtraError:
        return  # told where it is missed
