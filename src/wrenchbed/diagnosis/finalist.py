"""A structure after its refit: which hypotheses, their values, and what they leave."""

from dataclasses import dataclass

import numpy as np

from wrenchbed.diagnosis.dictionary import Hypothesis


@dataclass(frozen=True, eq=False)
class Finalist:
    """A structure after its refit.

    Attributes:
        parts: its hypotheses.
        rung: background rung that fits best.
        x: fitted variables (k,) in typical sizes: amplitudes and shapes, no stated numbers.
        covariance: of ``design``'s columns (m, m), background and stated numbers included.
        residual: what is left (6 R,), whitened, the stated numbers' part still in it.
        y: the data as linearised at x (6 R,).
        design: derivatives of the response by x, then the columns of blamed stated numbers.
        spread: prior standard deviation of each (m,).
        log_posterior: summed over rungs and sizes.
        scale: size of each part's prior that fits best (parts,).
    """

    parts: tuple[Hypothesis, ...]
    rung: int
    x: np.ndarray
    covariance: np.ndarray
    residual: np.ndarray
    y: np.ndarray
    design: np.ndarray
    spread: np.ndarray
    log_posterior: float
    scale: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(h.name for h in self.parts)
