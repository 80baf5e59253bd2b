"""The page of a fit: parameters, what the data cannot tell, correlations and residuals."""

from pathlib import PurePath

import numpy as np

from wrenchbed.calibration.calibrate import left_by
from wrenchbed.calibration.fit import Fit
from wrenchbed.calibration.fit_words import UNKNOWN, FitWords, worst_channel
from wrenchbed.calibration.observations import Observations
from wrenchbed.data.recording import Recording
from wrenchbed.pages import ReportPage, numbers
from wrenchbed.pages.chart import Axis, Chart, Matrix, Panel, Scale, Series, thinned
from wrenchbed.pages.document import provenance
from wrenchbed.pages.draw import draw
from wrenchbed.physics.wrench import CHANNELS

MOST_PRINTED = 14
"""Most parameters for which each correlation is printed in its cell."""
_CORRELATION = Scale("correlation", -1.0, 1.0, (-1.0, 0.0, 1.0), diverging=True)


def fit_page(fit: Fit, recording: Recording, command: str = "") -> ReportPage:
    """The HTML page of a fit to a recording; ``command``: the command line that made it, if any. A
    `MissingExtraError` without matplotlib or jinja2."""
    words, name = FitWords(fit), PurePath(fit.recording).name
    data, residual = left_by(fit, recording)
    white = residual / np.maximum(fit.noise.row, 1e-9)
    order, axis = _order(recording, data)
    each = draw(_each(fit, white, order, axis))
    several = sum(p.std is not None for p in fit.identified) > 1
    correlation = draw(_correlation(fit)) if several else None
    channel, times = worst_channel(fit)
    verdict, badge = _verdict(fit)
    context = {
        "verdict": verdict,
        "badge": badge,
        "name": name,
        "robot": fit.robot,
        "words": words,
        "channels": CHANNELS,
        "load": _load(fit, words),
        "worst": f"{times:.1f} × noise",
        "worst_channel": channel,
        "observed": fit.observability,
        "of_what": "means of poses" if fit.rows != fit.poses else "rows",
        "largest": _largest(white, order, axis),
        "each": each,
        "correlation": correlation,
        "data": [
            ("recording", fit.recording),
            ("robot and data", words.data),
            ("rows left out", str(fit.left_out)),
            *provenance([fit.recording]),
        ],
        "command": command,
    }
    return ReportPage(context, "fit.html", [each, *([correlation] if correlation else [])])


def _verdict(fit: Fit) -> tuple[str, str]:
    """(colour key, text) of the badge on a fit's page, which states its verdict."""
    if fit.refuted is not None:
        return "unknown", "✗ refuted"
    if not fit.converged:
        return "unknown", "✗ not converged"
    return ("partial", "◔ more is left") if fit.noise.inflated else ("none", "✓ converged")


def _load(fit: Fit, words: FitWords) -> dict[str, str]:
    """Texts of the fitted mass ("figure") and of the centre of gravity ("text"), with their σ."""
    mass = next((p for p in words.parameters if p.name == "tool.mass"), None)
    figure = f"{fit.tool['mass']:.4g} kg" if mass is None else f"{mass.value} ± {mass.std} kg"
    cog = numbers.minus(", ".join(f"{1e3 * x:.4g}" for x in fit.tool["cog"]))
    fitted = [p for p in words.parameters if p.name.startswith("tool.cog.")]
    if len(fitted) == len(fit.tool["cog"]) and UNKNOWN not in {p.std for p in fitted}:
        cog = ", ".join(f"{p.value} ± {p.std}" for p in fitted)
    return {"figure": figure, "text": f"Centre of gravity ({cog}) mm in the sensor's axes."}


def _order(recording: Recording, data: Observations) -> tuple[np.ndarray, Axis]:
    """Numbers of the poses in the recording (M,), or times [s]; and their axis, for M
    observations."""
    if recording.metadata.mode == "dynamic":
        t = data.t - data.t[0]
        return t, Axis("time", "s", low=float(t.min()), high=float(t.max()))
    order, segment = 1.0 + np.arange(len(data)), recording.columns.get("segment")
    if segment is not None:
        row = np.clip(np.searchsorted(recording.t, data.t), 0, len(segment) - 1)
        order = np.asarray(segment[row], dtype=float)
    low, high = float(order.min()) - 0.5, float(order.max()) + 0.5  # none at the edge
    return order, Axis("number of the pose", low=low, high=high)


def _each(fit: Fit, white: np.ndarray, order: np.ndarray, axis: Axis) -> Chart:
    """Chart of residuals ``white`` (M, 6) [noise of a row] over ``order`` (M,), with the noise's
    band."""
    panels, note, moving = [], "", axis.label == "time"
    expected = fit.noise.expected / np.maximum(fit.noise.row, 1e-9)
    reach = 1.1 * float((np.abs(white) + expected).max())
    for k, channel in enumerate(CHANNELS):
        std = None if moving else np.full(len(order), expected[k])
        points = Series("residual", "line" if moving else "points", order, white[:, k], std,
                        "after", ids=np.arange(1, len(order) + 1))  # fmt: skip
        series, note = thinned([points], what="observations")
        y = Axis(f"{channel}, residual", "noise", low=-reach, high=reach)
        panels.append(Panel(axis, y, series, zero=True, height=0.8))
    caption = "Measured minus fitted, in units of the noise of a row. All channels have one scale."
    if not moving:
        caption += (
            " Upright lines: what the noise leaves of a pose's mean, one standard deviation; what "
            "lies many of them from zero is no noise."
        )
    title = "Residual of each channel, one by one"
    return Chart("each", title, tuple(panels), 2, True, caption, note)


def _largest(white: np.ndarray, order: np.ndarray, axis: Axis) -> str:
    row, k = np.unravel_index(int(np.argmax(np.abs(white))), white.shape)
    at = f"at {order[row]:.4g} s" if axis.label == "time" else f"of pose {order[row]:.0f}"
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
