"""A set of causes as fitted: its parts (causes), their variables, and the residual."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import zip_longest

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis


class Variables:
    """Free variables ``x`` (k,) of a set of causes in one recording: of each cause, a hypothesis of
    ``parts``, the amplitudes, then the shape parameters.

    Attributes:
        part: index of the cause that each variable belongs to (k,).
        name: name of each variable among the effect's parameters (k,).
        shape: whether each is a shape, as a delay, not an amplitude (k,), boolean.
        column: index in the dictionary of each one's derivative (k,), −1 if it changes with x.
    """

    def __init__(self, parts: Sequence[Hypothesis]) -> None:
        every = [
            (k, name, name in h.variant.shape, -1 if h.variant.shape else column)
            for k, h in enumerate(parts)
            if not h.effect.stated
            for name, column in zip_longest(
                (*h.variant.free, *h.variant.shape), h.columns.tolist(), fillvalue=-1
            )
        ]
        self.part = np.array([k for k, *_ in every], dtype=int)
        self.name = tuple(str(name) for _, name, *_ in every)
        self.shape = np.array([shape for *_, shape, _ in every], dtype=bool)
        self.column = np.array([column for *_, column in every], dtype=int)

    def __len__(self) -> int:
        return len(self.name)

    def of_parts(self, parts: Collection[int]) -> np.ndarray:
        """Indices of the variables that belong to some causes of the set, given by index."""
        return np.flatnonzero(np.isin(self.part, list(parts)))


@dataclass(frozen=True, eq=False)
class Finalist:
    """A set of causes, active at once, as fitted to one recording.

    Attributes:
        parts: the causes, each a variant of an effect.
        rung: index of the background level (size of small imperfections) that fits best.
        x: fitted variables (k,) in typical sizes: amplitudes and shapes, no stated numbers.
        covariance: covariance (m, m) of the numbers of ``design``, background counted.
        residual: measured minus fitted (C R,), whitened; errors of stated numbers are still in it.
        y: readings linearised at x (C R,).
        design: derivatives by x, then columns of stated numbers claimed as wrong (C R, m).
        spread: prior standard deviation of each column of ``design`` (m,).
        log_posterior: log of prior times evidence, over all background levels and sizes.
        each: the same fit in each recording fitted together; empty for a single one.
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
    each: Sequence["Finalist"] = field(default=(), repr=False)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(h.name for h in self.parts)

    @cached_property
    def variables(self) -> Variables:
        """Description of each free variable ``x``."""
        return Variables(self.parts)

    @cached_property
    def effects(self) -> tuple[int, ...]:
        """Indices of the causes that are effects, not stated numbers."""
        return tuple(k for k, h in enumerate(self.parts) if not h.effect.stated)
