"""The page of a fit: parameters, what the data cannot tell, correlations and residuals."""

from dataclasses import replace
from pathlib import PurePath

import numpy as np

from wrenchbed.calibration.calibrate import left_by
from wrenchbed.calibration.fit import Fit
from wrenchbed.calibration.fit_words import UNKNOWN, FitWords, fit_words, worst_channel
from wrenchbed.calibration.observations import Observations
from wrenchbed.data.recording import Recording
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Axis, Chart, Matrix, Panel, Scale, Series, thinned
from wrenchbed.pages.draw import draw
from wrenchbed.pages.provenance import provenance
from wrenchbed.physics.wrench import CHANNELS

MOST_PRINTED = 14
"""Parameters up to which each correlation is printed in its cell."""
_CORRELATION = Scale("correlation", -1.0, 1.0, (-1.0, 0.0, 1.0), diverging=True)


def fit_page(fit: Fit, recording: Recording, command: str = "") -> ReportPage:
    """The page of a fit.

    Args:
        fit: from `calibrate`.
        recording: that it was fitted to.
        command: that made it; left out if empty.

    Raises:
        MissingExtraError: matplotlib or jinja2 is not installed.
    """
    words = fit_words(fit)
    data, residual = left_by(fit, recording)
    white = residual / np.maximum(fit.noise.row, 1e-9)
    order, label = _order(recording, data)
    each = draw(_each(fit, white, order, label))
    several = sum(p.std is not None for p in fit.identified) > 1
    correlated = draw(_correlation(fit)) if several else None
    verdict, badge = _badge(fit)
    context = {
        "verdict": verdict,
        "badge": badge,
        "name": PurePath(fit.recording).name,
        "robot": fit.robot,
        "headline": _headline(words),
        "words": words,
        "channels": CHANNELS,
        "load": _load(fit, words),
        "fits": _fits(fit),
        "told": _told(fit, words),
        "of_what": "of the means of poses" if fit.rows != fit.poses else "of rows",
        "largest": _largest(white, order, label),
        "each": each,
        "correlation": correlated,
        "next": _next(fit, PurePath(fit.recording).name),
        "data": [
            ("recording", fit.recording),
            ("robot and data", words.data),
            ("rows left out", str(fit.left_out)),
            *provenance([fit.recording]),
        ],
        "command": command,
    }
    return ReportPage(context, "fit", [each, *([correlated] if correlated else [])])


def _badge(fit: Fit) -> tuple[str, str]:
    """Colour and badge."""
    if fit.refuted is not None:
        return "unknown", "✗ refuted"
    if not fit.converged:
        return "unknown", "✗ not converged"
    return ("partial", "◔ more is left") if fit.noise.inflated else ("none", "✓ converged")


def _headline(words: FitWords) -> str:
    if words.refuted:
        return f"The data refute these values: {words.refuted.rstrip('.')}."
    return _sentence("; ".join(words.status.split("; ")[:2]))


def _load(fit: Fit, words: FitWords) -> dict[str, str]:
    """Mass with its uncertainty where it was fitted, and the centre of gravity."""
    mass = next((p for p in words.parameters if p.name == "tool.mass"), None)
    figure = f"{fit.tool['mass']:.4g} kg" if mass is None else f"{mass.value} ± {mass.std} kg"
    cog = numbers.minus(", ".join(f"{1e3 * x:.4g}" for x in fit.tool["cog"]))
    fitted = [p for p in words.parameters if p.name.startswith("tool.cog.")]
    if len(fitted) == len(fit.tool["cog"]) and UNKNOWN not in {p.std for p in fitted}:
        cog = ", ".join(f"{p.value} ± {p.std}" for p in fitted)
    return {"figure": figure, "text": f"Centre of gravity ({cog}) mm in the sensor's axes."}


def _fits(fit: Fit) -> dict[str, str]:
    channel, times = worst_channel(fit)
    means = "Means of poses" if fit.rows != fit.poses else "Rows"
    text = f"{means} scatter about the fit by so much more than the noise explains, "
    return {"figure": f"{times:.1f} × noise", "text": f"{text}at worst in {channel}."}


def _told(fit: Fit, words: FitWords) -> dict[str, str]:
    if not words.limits:
        return {"figure": "All that was asked", "text": "Every parameter shows by itself."}
    silent, alike = len(fit.observability.no_effect), len(fit.observability.redundancies)
    parts = [f"{silent} parameters change no reading"] * bool(silent)
    parts += [f"{alike} combinations of others change none"] * bool(alike)
    return {"figure": words.limits[0], "text": f"{_sentence('; '.join(parts))} Listed below."}


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _order(recording: Recording, data: Observations) -> tuple[np.ndarray, str]:
    """Numbers of poses as the recording has them (M,), or times [s]; and what they are."""
    segment = recording.columns.get("segment")
    if recording.metadata.mode == "dynamic":
        return data.t - data.t[0], "time [s]"
    if segment is None:
        return 1.0 + np.arange(len(data)), "number of the pose"
    row = np.clip(np.searchsorted(recording.t, data.t), 0, len(segment) - 1)
    return np.asarray(segment[row], dtype=float), "number of the pose"


def _each(fit: Fit, white: np.ndarray, order: np.ndarray, label: str) -> Chart:
    """Every observation's residual, one panel a channel, with what noise alone makes of it."""
    name, _, unit = label.partition(" [")
    moving = label.startswith("time")
    across = Axis(name, unit.rstrip("]"), low=float(order.min()), high=float(order.max()))
    if not moving:  # none at the edge
        across = replace(across, low=float(order.min()) - 0.5, high=float(order.max()) + 0.5)
    panels, note = [], ""
    expected = fit.noise.expected / np.maximum(fit.noise.row, 1e-9)
    reach = 1.1 * float((np.abs(white) + expected).max())
    for k, channel in enumerate(CHANNELS):
        std = np.full(len(order), expected[k])
        ids = np.arange(1, len(order) + 1)
        points = Series("residual", "points", order, white[:, k], std, role="after", ids=ids)
        if moving:
            points = replace(points, kind="line", std=None)
        series, note = thinned([points], what="observations")
        y = Axis(f"{channel}, residual", "noise", low=-reach, high=reach)
        panels.append(
            Panel(across, y, series, zero=True, height=0.8)
        )  # fmt: skip
    caption = "Measured minus fitted, in units of the noise of a row. All channels have one scale."
    if not moving:
        caption += (
            " Upright lines: what the noise leaves of a pose's mean, one standard deviation; what "
            "lies many of them from zero is no noise."
        )
    return Chart(
        "each", "Residual of each channel, one by one", tuple(panels), 2, True, caption, note
    )


def _largest(white: np.ndarray, order: np.ndarray, label: str) -> str:
    row, k = np.unravel_index(int(np.argmax(np.abs(white))), white.shape)
    at = f"at {order[row]:.4g} s" if "time" in label else f"of pose {order[row]:.0f}"
    return numbers.minus(
        f"The largest is {CHANNELS[k]} {at}: {white[row, k]:+.2g} times the noise of a row."
    )


def _correlation(fit: Fit) -> Chart:
    known = [k for k, p in enumerate(fit.identified) if p.std is not None]
    names = tuple(fit.identified[k].name for k in known)
    values = fit.correlation[np.ix_(known, known)]
    texts = tuple(tuple(numbers.minus(f"{v:.2f}") for v in row) for row in values)
    matrix = Matrix(names, names, values, _CORRELATION, texts, len(names) <= MOST_PRINTED)
    panel = Panel(Axis("with"), Axis(""), matrix=matrix)
    blind = len(fit.identified) - len(known)
    caption = "Near ±1 the data determine only a combination of the two."
    if blind:
        caption += f" Without {blind} parameters that are fixed in sum only."
    return Chart("correlation", "Correlation of the parameters", (panel,), caption=caption)


def _next(fit: Fit, name: str) -> list[str]:
    if fit.refuted is not None or not fit.converged:
        return [
            "Do not use these values. "
            f"`wrenchbed report {name}` shows where simulator and recording part."
        ]
    if fit.noise.inflated:
        return [f"`wrenchbed diagnose {name} --out found` says what the model lacks."]
    return [
        "`wrenchbed export FIT --to ur --out FILE` writes the load as a robot's controller takes "
        "it; `wrenchbed list exports` names other forms.",
        f"`wrenchbed diagnose {name} --out found` tests for effects below the noise of a row.",
    ]
