"""Who draws charts: here and now, or in another process beside what else is done."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from wrenchbed.errors import MissingExtraError
from wrenchbed.jobs.workers import workers
from wrenchbed.pages import Drawn
from wrenchbed.pages.chart import Axis, Chart, Panel, Series
from wrenchbed.pages.draw import svg

Artist = Callable[[Chart], Callable[[], Drawn]]
"""Takes a chart; what it returns waits for the figure."""


def draw(chart: Chart) -> Drawn:
    """A chart with its SVG."""
    return Drawn(chart, svg(chart))


def at_once(chart: Chart) -> Callable[[], Drawn]:
    """An `Artist` that draws when the figure is asked for."""
    return partial(draw, chart)


@contextmanager
def beside() -> Iterator[Artist]:
    """An `Artist` that draws in another process, which loads what draws as the block begins."""
    with workers(1, forked=True) as pool:  # forked at once: what is loaded here is not loaded again
        pool.submit(_rehearse)
        yield lambda chart: pool.submit(draw, chart).result


def _rehearse() -> None:
    """Load libraries and fonts."""
    try:
        line = Series("", "line", np.arange(2.0), np.arange(2.0))
        draw(Chart("", "", (Panel(Axis("x"), Axis("y"), (line,)),)))
    except MissingExtraError:
        return  # told where it is missed
