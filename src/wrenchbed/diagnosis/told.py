"""Causes as ``diagnosis.json`` tells them: parameters with their uncertainties."""

from typing import Any

import numpy as np

from wrenchbed.diagnosis import closure
from wrenchbed.diagnosis.analysis import Analysis
from wrenchbed.diagnosis.claims import Explanation, stated
from wrenchbed.diagnosis.rows import RowFinding
from wrenchbed.diagnosis.verdict import Cause, Verdict

_HALVINGS = 5
"""Of the last step, to find the edge of a range within which nothing changes."""


def cause_entry(
    a: Analysis, verdict: Verdict, cause: Cause, gap: closure.Closure, spread: float
) -> dict[str, Any]:
    """One item of ``which``; ``spread`` multiplies standard uncertainties, see `Reliability`."""
    f = verdict.explanation.finalist
    name, *rivals = cause.names
    parameters: dict[str, Any]
    if cause.part.index is None:
        parameters = _wrong_numbers(a, verdict.explanation, name, spread)
    else:
        part = f.parts[cause.part.index]
        values = a.refitter.values(f.parts, f.x)[cause.part.index]
        std = _uncertainty(a, f, cause.part.index, spread)
        parameters = part.effect.publish(a.prepared.model.robot, part.variant, values, std)
    return {
        "effect": name,
        "probability": cause.probability,
        "rivals": rivals,
        "parameters": parameters,
        "closed_share": gap.shares.get(name),
    }


def _uncertainty(a: Analysis, f: Any, part: int, spread: float) -> dict[str, float]:
    """Standard uncertainties of a part's variables by name, SI; what its form may miss included."""
    robot = a.prepared.model.robot
    known = {p.name: p.tolerance for p in f.parts[part].effect.parameters(robot)}
    std = np.sqrt(np.maximum(np.diagonal(f.covariance), 0.0))
    effect = f.parts[part].effect
    variables = a.refitter.variables(f.parts)
    told = {}
    for i, (k, name, shape) in enumerate(variables):
        if k == part:
            form = 0.0 if shape else effect.size_error * float(f.x[i])
            flat = _flat(a, f, i) if shape and effect.rough else 0.0
            told[name] = (flat or float(np.hypot(spread * std[i], form))) * known[name]
    return told


def _flat(a: Analysis, f: Any, i: int) -> float:
    """Rms distance of a variable from where it might as well be: no reading changes in between.

    A jump may have come at any time between two poses.
    """
    reading, reach = a.refitter.response(f.parts, f.x), []

    def same(step: float) -> bool:
        x = f.x.copy()
        x[i] += step
        return bool(np.array_equal(a.refitter.response(f.parts, x), reading))

    for sign in (-1.0, 1.0):
        outside = next((s for s in 2.0 ** np.arange(-14, 1) if not same(sign * s)), 2.0)
        inside = outside / 2.0
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2.0
            inside, outside = (middle, outside) if same(sign * middle) else (inside, middle)
        reach.append(inside)
    left, right = reach
    if max(reach) <= 2.0**-14:  # nothing flat
        return 0.0
    return float(np.sqrt((left**2 - left * right + right**2) / 3.0))


def _wrong_numbers(a: Analysis, e: Explanation, name: str, factor: float) -> dict[str, Any]:
    """The errors of a stated number: what it should be more than what is stated."""
    d, told = a.dictionary, stated(a.refitter, e.finalist)
    std = np.sqrt(np.maximum(np.diagonal(told.covariance), 0.0))
    hypothesis = next(h for h in d.hypotheses if h.name == name)
    known = hypothesis.effect.parameters(a.prepared.model.robot)
    result = {}
    for i, k in enumerate(d.stated):
        effect, parameter = d.label[k]
        if effect == name:
            unit = known[known.index(parameter)].unit
            size = float(d.size[k])
            value, spread = float(told.mean[i]) * size, float(std[i]) * size * factor
            result[parameter] = {"value": value, "std": spread, "unit": unit}
    return result


def row_entry(r: RowFinding) -> dict[str, Any]:
    return {
        "effect": r.effect,
        "probability": r.probability,
        "rivals": [],
        "parameters": r.parameters,
        "closed_share": None,
    }
