"""Effects in one or several recordings of a robot: which numbers are shared, what they add.

In the linear Gaussian model one recording's posterior is the prior of the next: log p(y_A, y_B) =
log p(y_A) + log p(y_B | y_A), and information and scores of the recordings add up. So a set of
causes has one set of numbers for effects of the robot, and one per recording for effects that
belong to it (`Effect.of_recording`); background and stated numbers are each recording's own.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from wrenchbed.diagnosis.evidence.dictionary import Hypothesis
from wrenchbed.diagnosis.evidence.search import MORE, PRIOR
from wrenchbed.diagnosis.explain.finalist import Variables
from wrenchbed.diagnosis.explain.readings_model import ReadingsModel

SHAPE_SPREAD = 2.0
"""Prior standard deviation of a shape parameter (a delay, an angle …), over its typical size."""


class Structure:
    """A set of causes in N recordings, and which of all its numbers (m,) each recording uses.

    The numbers are k variables, then the stated numbers that are claimed to be wrong ("blamed").

    Attributes:
        cases: models of the N recordings.
        parts: causes as hypotheses of each recording (N).
        at: indices of each recording's `Variables` among the variables (N).
        blamed: indices of the blamed stated numbers of each recording (N).
        shape: whether each number is a shape (m,).
        owner: index of the set that each number belongs to (m,).
        sets: part and recording of each set of numbers with a common prior size.
    """

    def __init__(
        self, cases: Sequence[ReadingsModel], parts: Sequence[tuple[Hypothesis, ...]]
    ) -> None:
        """Set of causes from the ``parts`` of each recording, one variant of an effect each."""
        every = enumerate(zip(*parts, strict=True))
        sets = tuple((p, r) for p, same in every for r in _homes(cases, same))
        of_set = [parts[r][p] for p, r in sets]
        stated = [bool(h.effect.stated) for h in of_set]
        order = np.argsort(stated, kind="stable").tolist()
        shape = [
            np.zeros(len(h.columns), dtype=bool) if h.effect.stated else Variables((h,)).shape
            for h in of_set
        ]
        self.owner = np.repeat(np.array(order, dtype=int), [len(shape[s]) for s in order])
        place = {sets[s]: np.flatnonzero(self.owner == s) for s in order}
        first = {p: place[p, r] for p, r in reversed(sets)}
        at, blamed = [], []
        for r, some in enumerate(parts):
            free = [place.get((p, r), first[p]) for p, h in enumerate(some) if not h.effect.stated]
            wrong = [place[s] for s, of in zip(sets, stated, strict=True) if of and s[1] == r]
            at.append(_joined(free).astype(int))
            blamed.append(_joined(wrong).astype(int))
        self.cases, self.parts, self.at, self.blamed, self.sets = cases, parts, at, blamed, sets
        self.shape = _joined([shape[s] for s in order]).astype(bool)

    @property
    def free(self) -> int:
        """Number k of variables: all numbers but the stated ones."""
        return len(self.shape) - sum(map(len, self.blamed))

    @property
    def columns(self) -> np.ndarray:
        """Index of each number's column (N, m) in the dictionary of each recording; −1 if it has
        none, or if derivatives change with the variables' values."""
        result = np.full((len(self.cases), len(self.shape)), -1)
        for r, parts in enumerate(self.parts):
            result[r, self.at[r]] = Variables(parts).column
            result[r, self.blamed[r]] = _joined([h.columns for h in parts if h.effect.stated])
        return result

    @property
    def rows(self) -> list[slice]:
        """Slice of each recording among the readings of all."""
        ends = np.cumsum([0, *(len(c.y) for c in self.cases)])
        return [slice(a, b) for a, b in pairwise(ends.tolist())]

    @property
    def y(self) -> np.ndarray:
        """Readings (C R,) of all recordings."""
        return np.concatenate([c.y for c in self.cases])

    def merged(self, each: Sequence[np.ndarray], last: int = 0) -> np.ndarray:
        """Values of all variables (k,) from those of each recording; where these differ, shared
        ones are those of the recording of index ``last``."""
        result = np.zeros(self.free)
        for r in [*reversed(range(len(each))), last]:
            result[self.at[r]] = each[r]
        return result

    @property
    def start(self) -> np.ndarray:
        """Start values of a fit (k,): amplitudes 0, shapes as their variants state."""
        return self.merged([c.start(of) for c, of in zip(self.cases, self.parts, strict=True)])

    @property
    def widest(self) -> np.ndarray:
        """Largest prior standard deviation of each variable (k,)."""
        return np.where(self.shape, SHAPE_SPREAD, self.scales[self.owner, -1])[: self.free]

    @property
    def scales(self) -> np.ndarray:
        """Prior standard deviations (sets, s) to try for each set of numbers: of a set that
        recordings share, those of the one that shows it best."""
        result = []
        for p, home in self.sets:
            one = self.parts[home][p]
            of = [one] if one.effect.of_recording else [parts[p] for parts in self.parts]
            most = max(of, key=lambda h: h.typical_gap)
            result.append(self.cases[home].searcher.scales(most))
        return np.stack(result)

    @property
    def log_prior(self) -> float:
        """Log prior of the set of causes; each counts once, with its largest over recordings."""
        result = (len(self.parts[0]) - 1) * float(np.log(MORE / PRIOR["one"]))
        for same in zip(*self.parts, strict=True):
            both = zip(self.cases, same, strict=True)
            result += max(c.searcher.prior(h) for c, h in both if h.name in c.searcher.names)
        return result

    def response(self, x: np.ndarray) -> np.ndarray:
        """Whitened readings (C R,) of all recordings that the parts add, at variables x (k,)."""
        every = zip(self.cases, self.parts, self.at, strict=True)
        return np.concatenate([c.response(parts, x[at]) for c, parts, at in every])

    def design(self, x: np.ndarray, f: np.ndarray, which: Iterable[int]) -> np.ndarray:
        """Derivatives (C R, n) of the response, f at x, by n numbers of indices ``which``."""
        some, result = list(which), np.zeros((len(f), len(self.shape)))
        each = zip(self.cases, self.parts, self.at, self.blamed, self.rows, strict=True)
        for (c, parts, at, blamed, rows), column in zip(each, self.columns, strict=True):
            of_blocks = np.flatnonzero(np.isin(at, some))
            result[rows, at[of_blocks]] = c.design(parts, x[at], f[rows], of_blocks.tolist())
            result[rows, blamed] = c.d.E[:, column[blamed]]
        return result[:, some]


def _homes(cases: Sequence[ReadingsModel], same: Sequence[Hypothesis]) -> list[int]:
    """Indices of the recordings that have values of their own of a cause's numbers; one index if
    all recordings share them. ``same``: the cause in each recording."""
    shows = [r for r, (c, h) in enumerate(zip(cases, same, strict=True)) if h.name in c.shown]
    if same[0].effect.stated:
        return [r for r in shows if len(same[r].columns)]
    return shows if same[0].effect.of_recording else shows[:1]


def _joined(some: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *some])
