"""Baselines: simple ways to name a cause, which every benchmark of the diagnosis prints beside it.

They start from the same calibrated simulator and the same dictionary of effects as the diagnosis,
with noise and tolerances only: no background of small imperfections, no refit, and no answer for
what no effect makes. That is what a careful user without them sees.
"""

from collections.abc import Callable

import numpy as np
from scipy.special import logsumexp

from wrenchbed.benchmark.scoring.case_rows import Claim
from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.evidence.dictionary import build
from wrenchbed.diagnosis.evidence.likelihood import LARGE, BackgroundLevel
from wrenchbed.diagnosis.evidence.search import NONE
from wrenchbed.diagnosis.explain.structures import case
from wrenchbed.diagnosis.prepare.baseline import calibrate
from wrenchbed.diagnosis.prepare.prepare_recording import prepare

_RANK = 1e-10
"""Least eigenvalue that counts, relative to the largest one."""


def none(recording: Recording) -> Claim:
    """Claim of no cause, for every recording."""
    return Claim(NONE, (), {NONE: 1.0})


def bic(recording: Recording) -> Claim:
    """The single effect, or none, of least BIC; probabilities from exp(−ΔBIC/2)."""
    prepared = prepare(recording).leading
    baseline = calibrate(prepared)
    d = build(prepared, baseline.robot_theta, baseline.tolerance)
    y = case(d, prepared, baseline)
    effects = d.E[:, : sum(bool(parameter) for _, parameter in d.label)]
    allowed = np.minimum(d.tolerance**2, LARGE)
    variance = np.tile(prepared.variance, d.rows)
    solved = BackgroundLevel(d.E[:, d.stated], variance, allowed).solve(effects)
    precision, score = effects.T @ solved, solved.T @ y
    logs = {NONE: 0.0}
    for h in d.hypotheses:
        values, vectors = np.linalg.eigh(precision[np.ix_(h.columns, h.columns)])
        kept = values > _RANK * max(float(values[-1]), 1e-300)
        fall = float(((vectors[:, kept].T @ score[h.columns]) ** 2 / values[kept]).sum())
        free = int(kept.sum()) + len(h.variant.shape)
        value = 0.5 * (fall - free * float(np.log(len(y))))
        logs[h.name] = max(value, logs.get(h.name, -np.inf))
    total = logsumexp(list(logs.values()))
    probabilities = {k: float(np.exp(v - total)) for k, v in logs.items()}
    best = max(probabilities, key=lambda k: probabilities[k])
    causes = () if best == NONE else ((best,),)
    return Claim("identified" if causes else NONE, causes, probabilities)


BASELINES: dict[str, Callable[[Recording], Claim]] = {"none": none, "bic": bic}
