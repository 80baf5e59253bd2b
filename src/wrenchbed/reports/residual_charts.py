"""Figures where no single cause stands: the residual over all that was recorded, and rivals."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from wrenchbed.diagnosis.explain.claims import Explanation
from wrenchbed.diagnosis.gap.closure import twin_of
from wrenchbed.pages.chart import Axis, Chart, Panel, Role, Series, thinned
from wrenchbed.physics.time_derivatives import value
from wrenchbed.physics.wrench import CHANNELS, UNITS
from wrenchbed.reports.simulators import Evidence, largest

SMOOTH_S = 0.5
"""Of a motion, over which rows are averaged: slower changes are the motion's own."""
MOST_ROWS = 200
"""Points of each of many panels."""


def everywhere(e: Evidence, name: str) -> Chart:
    """What is left of its largest channel over every joint, direction, time and load."""
    p = e.prepared
    simulator = "the calibrated simulator" if e.after is None else "the simulator with the effects"
    left = (p.y - (e.before if e.after is None else e.after)) / e.std
    k = largest(left)[0]
    role: Role = "before" if e.after is None else "after"
    panels, note = [], ""
    for label, unit, x in _variables(e, k):
        order = np.argsort(x, kind="stable")
        series, note = thinned(
            [
                Series(
                    "residual", "points", x[order], left[order, k], role=role,
                    ids=e.ids[order],
                )
            ],
            MOST_ROWS, "rows",
        )  # fmt: skip
        y = Axis(f"{CHANNELS[k]}, residual", "noise")
        panels.append(Panel(Axis(label, unit), y, series, zero=True, height=0.8))
    caption = (
        f"Measured minus {simulator}, channel {CHANNELS[k]}, which differs most. A "
        "cause would show as a line, a wave or a step in the panel of its variable."
    )
    title = f"Residual of {CHANNELS[k]} over all that was recorded"
    return Chart(name, title, tuple(panels), columns=3, caption=caption, note=note)


def _variables(e: Evidence, channel: int) -> Iterator[tuple[str, str, np.ndarray]]:
    """Label, unit and values (H,) of what was recorded or follows from it."""
    p, scene = e.prepared, e.prepared.scene
    held = scene.held
    for k, joint in enumerate(scene.robot.joints if scene.jointed else ()):
        turns, x = joint.unit == "rad", scene.joints[held][:, k]
        yield f"joint {k + 1}", "°" if turns else "mm", np.rad2deg(x) if turns else 1e3 * x
    down = np.swapaxes(value(scene.pose[0])[held], 1, 2) @ np.asarray(scene.gravity)
    down = down / max(float(np.linalg.norm(scene.gravity)), 1e-9)
    for k, axis in enumerate("xyz"):
        yield f"gravity along the sensor's {axis}", "1", down[:, k]
    yield "time", "s", scene.t[held]
    yield f"simulated load {CHANNELS[channel]}", UNITS[channel], scene.load[held][:, channel]
    if scene.warmth is not None:
        yield "temperature above the first row's", "K", scene.warmth[held]
    if p.moving:
        speed = np.gradient(scene.joints[held], scene.t[held], axis=0)
        yield "speed of the joints together", "rad/s", np.linalg.norm(speed, axis=1)


def rivals(e: Evidence, entry: Mapping[str, Any], name: str) -> Chart | None:
    """A cause and its likeliest rival over each other, where they differ most.

    None where the cause has no rival that was fitted in its place.
    """
    cause, others = str(entry["effect"]), [str(r) for r in entry["rivals"]]
    found = _instead(e, cause, others)
    if found is None or e.after is None:
        return None
    rival, explanation = found
    keep = [p.index for p in explanation.parts if p.index is not None]
    twin = twin_of(e.found.analysis, explanation.finalist, keep)
    p = e.prepared
    base = e.calibrated
    ours, theirs = e.of(e.twin) - base, e.of(twin) - base
    apart = (ours - theirs) / e.std
    k = int(np.argmax((apart**2).sum(axis=0)))
    order = np.argsort(apart[:, k], kind="stable")
    x, axis = 1.0 + np.arange(len(order)), Axis("rows, sorted by the difference")
    if p.moving:
        order = _around(apart[:, k])
        x, axis = p.scene.t[p.scene.held][order], Axis("time", "s")
    std = np.full(len(order), e.std[k] * np.sqrt(p.noise[k]))
    measured = (p.y - base)[order, k]
    ids = e.ids[order]
    top, note = thinned(
        [
            Series(cause, "line", x, ours[order, k], role="after", ids=ids),
            Series(rival, "line", x, theirs[order, k], role="box", dashed=True, ids=ids),
            Series("measured", "points", x, measured, std, ids=ids),
        ]
    )
    low, _ = thinned([Series("difference of the two", "line", x, apart[order, k], role="rest")])
    panels = (
        Panel(axis, Axis(f"{CHANNELS[k]} minus calibrated", UNITS[k]), top, zero=True, height=1.2),
        Panel(axis, Axis("difference", "noise"), low, zero=True, height=0.7),
    )
    caption = (
        "Both explanations in the channel in which they differ most"
        + (", about the time of it" if p.moving else "; rows at the two ends distinguish them")
        + ". A difference within ±1 noise is seen in many rows only."
    )
    title = f"{cause} or {rival}"
    return Chart(name, title, panels, shared=True, caption=caption, note=note)


def _around(apart: np.ndarray) -> np.ndarray:
    """Indices of the stretch of a motion about its largest difference (H,)."""
    middle = int(np.abs(apart - apart.mean()).argmax())
    first = min(max(0, middle - MOST_ROWS // 2), max(0, len(apart) - MOST_ROWS))
    return np.arange(first, min(len(apart), first + MOST_ROWS))


def _instead(e: Evidence, cause: str, others: list[str]) -> tuple[str, Explanation] | None:
    """The likeliest explanation with a rival in a cause's place."""
    for told in e.found.analysis.ranking.explanations:
        found = [r for r in others if r in told.names]
        if found and cause not in told.names:
            return found[0], told
    return None


def scatter(e: Evidence, entry: Mapping[str, Any], name: str) -> Chart:
    """Rows about their means where a cause shows only between rows: over time, and how large."""
    rows = e.prepared.excerpt
    segments = rows.columns.get("segment")
    if segments is None or rows.metadata.mode != "static":
        return _spectrum(e, str(entry["effect"]), name)
    _, at = np.unique(segments, return_inverse=True)
    count = np.maximum(np.bincount(at), 1)[:, None]
    means = np.stack([np.bincount(at, rows.wrench[:, c]) for c in range(6)], axis=1) / count
    apart = (rows.wrench - means[at]) / _stated(e)
    k = int(np.argmax((apart**2).mean(axis=0)))
    t = rows.t - rows.t[0]
    top, note = thinned([Series("measured", "line", t, apart[:, k], ids=segments)])
    reach = max(4.0, float(np.abs(apart[:, k]).max()))
    edges = np.linspace(-reach, reach, 61)
    counts, _ = np.histogram(apart[:, k], edges)
    middle = (edges[1:] + edges[:-1]) / 2.0
    usual = len(t) * np.diff(edges) * np.exp(-(middle**2) / 2.0) / np.sqrt(2.0 * np.pi)
    panels = (
        Panel(
            Axis("time", "s"), Axis(f"{CHANNELS[k]} about its mean", "stated noise"), top,
            zero=True,
        ),
        Panel(
            Axis(f"{CHANNELS[k]} about its pose's mean", "stated noise"), Axis("rows"),
            (
                Series("rows", "line", middle, counts.astype(float)),
                Series("stated noise", "line", middle, usual, role="before", dashed=True),
            ),
        ),
    )  # fmt: skip
    caption = "Each row less the mean of its pose, in units of the noise that the sensor states."
    return Chart(
        name, f"{entry['effect']}: rows about their means", panels, caption=caption, note=note
    )


def _spectrum(e: Evidence, effect: str, name: str) -> Chart:
    """Rows of a motion less their mean over `SMOOTH_S`: a vibration is a peak, noise is flat."""
    rows = e.prepared.excerpt
    period = float(np.median(np.diff(rows.t)))
    width = max(3, round(SMOOTH_S / period)) | 1
    kernel = np.ones(width) / width
    smooth = np.stack([np.convolve(rows.wrench[:, c], kernel, "valid") for c in range(6)], axis=1)
    inner = slice(width // 2, len(rows) - width // 2)
    apart = (rows.wrench[inner] - smooth) / _stated(e)
    k = int(np.argmax((apart**2).mean(axis=0)))
    frequency = np.fft.rfftfreq(len(apart), period)
    amplitude = 2.0 * np.abs(np.fft.rfft(apart[:, k])) / len(apart)
    t = rows.t[inner] - rows.t[0]
    top, note = thinned([Series("measured", "line", t, apart[:, k])])
    low, _ = thinned([Series("amplitude", "line", frequency, amplitude)])
    unit = "stated noise"
    panels = (
        Panel(Axis("time", "s"), Axis(f"{CHANNELS[k]} about its mean", unit), top, zero=True),
        Panel(Axis("frequency", "Hz"), Axis("amplitude", unit), low),
    )
    caption = f"Each row less the mean of the {SMOOTH_S:g} s about it, and its spectrum."
    return Chart(name, f"{effect}: rows about their means", panels, caption=caption, note=note)


def _stated(e: Evidence) -> np.ndarray:
    """Noise of a row as the sensor states it (6,), else as found."""
    stated = np.asarray(e.prepared.recording.metadata.sensor.noise_std or (0.0,) * 6, dtype=float)
    return np.where(stated > 0.0, stated, e.std)
