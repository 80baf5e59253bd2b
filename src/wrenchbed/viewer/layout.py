"""How views lie on the screen: a blueprint for each kind of picture."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrenchbed import registry
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.robots.base import SimulatedRobot
from wrenchbed.viewer.elements import BOUNDS
from wrenchbed.viewer.stream import TIME

_SKY = (242, 244, 247)
"""Behind the robot; curves keep the viewer's own ground."""


def scene(robot: str, name: str = "robot") -> Any:
    """The robot from where its arm and sensor are seen best."""
    rr = registry.require("rerun", "view")
    shown = registry.load("robots", robot)
    assert isinstance(shown, SimulatedRobot)  # only such have a scene
    position, target = shown.eye
    return rr.blueprint.Spatial3DView(
        origin="/world",
        name=name,
        background=list(_SKY),
        line_grid=False,
        eye_controls=rr.blueprint.EyeControls3D(
            position=position, look_target=target, eye_up=(0.0, 0.0, 1.0)
        ),
    )


def channels(name: str = "wrench") -> Any:
    """Six curves views, one a channel, that share their time."""
    rr = registry.require("rerun", "view")
    views = [
        curves(f"/wrench/{c}", f"{c} [{u}]", legend=c == CHANNELS[0])
        for c, u in zip(CHANNELS, UNITS, strict=True)
    ]
    return rr.blueprint.Grid(*views, grid_columns=2, name=name)


def curves(origin: str, name: str, reach: float | None = None, *, legend: bool = True) -> Any:
    """Curves over time that move together; with a fixed range ± ``reach``."""
    rr = registry.require("rerun", "view")
    b = rr.blueprint
    return b.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=b.TimeAxis(link=b.components.LinkAxis.LinkToGlobal),
        axis_y=None if reach is None else b.ScalarAxis(range=(-reach, reach)),
        plot_legend=b.PlotLegend(corner=b.Corner2D.RightTop, visible=legend),
    )


def residuals(residual: np.ndarray, name: str = "residual") -> Any:
    """Residual curves whose ranges hold all but one in a thousand of the values (N, 6)."""
    rr = registry.require("rerun", "view")
    reach = [_reach(residual[:, k : k + 3]) for k in (0, 3)]
    return rr.blueprint.Vertical(
        curves("/residual/force", "measured − simulated, force [N]", reach[0]),
        curves("/residual/torque", "measured − simulated, torque [N·m]", reach[1]),
        name=name,
    )


def document(origin: str, name: str) -> Any:
    """Words about what is shown."""
    rr = registry.require("rerun", "view")
    return rr.blueprint.TextDocumentView(origin=origin, name=name)


def bars(origin: str, name: str) -> Any:
    """A bar for each channel."""
    rr = registry.require("rerun", "view")
    return rr.blueprint.BarChartView(origin=origin, name=name)


def heat(name: str) -> Any:
    """The map of residuals."""
    rr = registry.require("rerun", "view")
    b = rr.blueprint
    x, y = BOUNDS
    return b.Spatial2DView(
        origin="/residual/map",
        name=name,
        background=list(_SKY),
        visual_bounds=b.VisualBounds2D(x_range=x, y_range=y),
    )


def page(
    left: Sequence[Any],
    right: Sequence[Any],
    shares: Sequence[float],
    timeline: str = TIME,
    *,
    follow: bool = False,
) -> Any:
    """Scene and map left, tabs right; on request it follows the newest time."""
    rr = registry.require("rerun", "view")
    b = rr.blueprint
    return b.Blueprint(
        b.Horizontal(
            b.Vertical(*left, row_shares=list(shares)),
            b.Tabs(*right, active_tab=0),
            column_shares=[1.0, 1.2],
        ),
        b.TimePanel(
            state="collapsed", timeline=timeline, play_state="following" if follow else "paused"
        ),
        b.BlueprintPanel(state="collapsed"),
        b.SelectionPanel(state="collapsed"),
    )


def _reach(values: np.ndarray) -> float:
    finite = np.abs(values[np.isfinite(values)])
    return float(max(1.1 * np.quantile(finite, 0.999), 1e-6)) if finite.size else 1.0
