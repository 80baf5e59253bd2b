"""From a prepared recording to ranked explanations."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import EffectDictionary, build
from wrenchbed.diagnosis.evidence.search import Searcher
from wrenchbed.diagnosis.explain.refit import Refitter
from wrenchbed.diagnosis.explain.structures import Ranking, rank
from wrenchbed.diagnosis.prepare.accelerometer import TILT
from wrenchbed.diagnosis.prepare.baseline import Baseline, calibrate
from wrenchbed.diagnosis.prepare.prepared import Prepared


@dataclass(frozen=True, eq=False)
class Analysis:
    """A recording's linear and nonlinear analysis.

    Attributes:
        prepared: the recording.
        baseline: its calibrated simulator.
        searcher: dictionary and background of the design.
        refitter: of this recording's readings.
        ranking: explanations, best first.
    """

    prepared: Prepared
    baseline: Baseline
    searcher: Searcher
    refitter: Refitter
    ranking: Ranking

    @property
    def dictionary(self) -> EffectDictionary:
        return self.searcher.d

    @property
    def calibrated(self) -> np.ndarray:
        """Whitened residual (R, 6) after bias, mass and CoG."""
        return self.dictionary.without_stated(self.refitter.y).reshape(-1, 6)


def analyse(prepared: Prepared) -> Analysis:
    """Calibrate, build the dictionary there, and rank what explains the rest."""
    coarse = prepared.coarse
    baseline = calibrate(coarse)
    t = prepared.testimony
    odds = {} if t is None else {TILT: t.log_bayes}
    searcher = Searcher(build(coarse, baseline.robot_theta, baseline.tolerance), odds)
    refitter = Refitter(searcher, case(searcher.d, coarse, baseline))
    return Analysis(prepared, baseline, searcher, refitter, rank(searcher, refitter))


def case(d: EffectDictionary, prepared: Prepared, baseline: Baseline) -> np.ndarray:
    """Readings (6 R,) against the dictionary's baseline, the stated numbers as stated."""
    moved = stated_vector(d, baseline)
    return prepared.rows(prepared.y).ravel() - d.baseline + d.E[:, d.stated] @ moved


def stated_vector(d: EffectDictionary, baseline: Baseline) -> np.ndarray:
    """Mass and CoG of the baseline against the stated ones (S,), in typical sizes; bias 0."""
    moved = np.zeros(len(d.stated))
    for effect, change in baseline.moved.items():
        moved[d.of_stated(effect)] = change
    return moved / d.size[d.stated]
