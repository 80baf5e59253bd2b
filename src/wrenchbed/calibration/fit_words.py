"""Text and rounded numbers of a fit, the same for terminal and pages."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.calibration.fit import Fit, IdentifiedValue
from wrenchbed.pages.numbers import HUMAN, decimals, minus
from wrenchbed.physics.wrench import CHANNELS

STRONG = 0.9
"""Least correlation reported: two parameters' uncertainties then exceed twice those alone."""
MOST_PAIRS = 6
UNKNOWN = "in sum only"


@dataclass(frozen=True)
class ParameterWords:
    """One parameter of a fit as texts, in common units and with justified digits.

    Attributes:
        start: value at which the fit started.
        interval: 95 % interval, empty where the data determine only a combination.
        change: from ``start`` to ``value``, in the same unit.
    """

    name: str
    value: str
    std: str
    start: str
    interval: str
    change: str
    unit: str


class FitWords:
    """Texts of a fit, for terminal and pages.

    Attributes:
        data: robot and amount of data.
        parameters: each identified parameter.
        residuals: label and numbers of the six channels, one line each.
        limits: sentences on what the data do not identify.
        status: convergence, and how far to trust the values.
        refuted: why the data refute the values, empty if they do not.
        sections: pairs (heading, lines) of all sections that are not empty; the status comes last.
    """

    def __init__(self, fit: Fit) -> None:
        rows, noise, seats = f"{fit.rows} rows", fit.noise, fit.touches
        amount = rows if fit.rows == fit.poses else f"{fit.poses} poses, {rows}"
        touches = "" if seats is None else (
            f"{seats.count} with {1e3 * seats.std:g} mm per axis; the least fitting, number "
            f"{seats.worst}, lies {seats.distance:.1f} σ from where all else puts it"
        )  # fmt: skip
        position = "" if fit.target_rms is None else (
            f"{1e3 * fit.target_rms:.3g} mm rms expected in the robot's target workspace"
        )  # fmt: skip
        self.data = f"{fit.robot}, {amount}"
        self.status, self.refuted = fit.status, fit.refuted or ""
        self.parameters = tuple(map(parameter_words, fit.identified))
        self.residuals = (
            ("residual rms", tuple(map(_short, fit.residual_rms))),
            (f"one row, {noise.source}", tuple(map(_short, noise.row))),
            ("effective rows", tuple(f"{w:.0f}" for w in noise.effective)),
        )
        self.limits = _limits(fit)
        sections = (
            ("what this data cannot tell", self.limits),
            ("strongly correlated", _pairs(fit)),
            ("touches", (touches,)),
            ("position of the tool", (position,)),
            ("refuted by the data", (self.refuted,)),
            ("status", (self.status,)),
        )
        self.sections = tuple((title, lines) for title, lines in sections if any(lines))


def parameter_words(p: IdentifiedValue) -> ParameterWords:
    """Make the texts of one identified parameter."""
    shown, factor = HUMAN.get(p.unit, (p.unit, 1.0))
    value, start = factor * p.value, factor * p.nominal
    began = minus(f"{start:.4g}") if abs(start) > 1e-12 else "0"
    if p.std is None or p.interval95 is None:
        return ParameterWords(p.name, minus(f"{value:.4f}"), UNKNOWN, began, "", "", shown)
    std, half = factor * p.std, factor * p.interval95
    digits = decimals(std)
    return ParameterWords(
        p.name,
        minus(f"{value:.{digits}f}"),
        f"{std:.2g}" if std < 1e-9 else f"{std:.{digits}f}",
        began,
        minus(f"{value - half:.{digits}f} … {value + half:.{digits}f}"),
        minus(f"{value - start:+.{digits}f}"),
        shown,
    )


def worst_channel(fit: Fit) -> tuple[str, float]:
    """Channel whose residual exceeds its expected noise most, and the ratio of the two."""
    times = fit.noise.scatter / np.maximum(fit.noise.expected, 1e-300)
    k = int(np.argmax(times))
    return CHANNELS[k], float(times[k])


def _short(x: float) -> str:
    digits = 4 if x >= 1e-3 else 6
    return f"{x:.{digits}f}" if x >= 1e-5 else f"{x:.1e}" if x > 0 else "0"


def _limits(fit: Fit) -> tuple[str, ...]:
    """Sentences on what the data cannot identify; empty if they identify everything."""
    o = fit.observability
    no_effect = [f"no effect on any reading: {', '.join(o.no_effect)}"] * bool(o.no_effect)
    lines = no_effect + [r.sentence for r in o.redundancies]
    return (f"rank {o.rank} of {len(o.names)} parameters", *lines) if lines else ()


def _pairs(fit: Fit) -> tuple[str, ...]:
    """Lines on pairs of parameters with a correlation near ±1."""
    known = [k for k, p in enumerate(fit.identified) if p.std is not None]
    correlations = [
        (float(fit.correlation[i, j]), fit.identified[i].name, fit.identified[j].name)
        for n, i in enumerate(known)
        for j in known[:n]
    ]
    strong = sorted((f for f in correlations if abs(f[0]) >= STRONG), key=lambda f: -abs(f[0]))
    texts = [minus(f"{b} and {a}: {r:+.3f}") for r, a, b in strong[:MOST_PAIRS]]
    more = len(strong) - MOST_PAIRS
    return (*texts, f"{more} more pairs above {STRONG:g}") if more > 0 else tuple(texts)
