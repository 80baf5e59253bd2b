"""Tries to guess the answers from everything but wrench and joints, as a cheat would."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from scipy.stats import rankdata

from wrenchbed.benchmark.sealed import answer as answers_
from wrenchbed.benchmark.sealed import commitments
from wrenchbed.data.recording import Recording

DRAWS = 200
_NEIGHBOURS = 5


@dataclass(frozen=True)
class Attack:
    """How well a cheat guesses.

    Attributes:
        target: what was guessed, ``kind`` or ``subsystem``.
        accuracy: share of cases that the best cheat guessed, each from all others.
        chance: mean of the same with answers shuffled.
        p_value: share of shuffles that were guessed as well.
    """

    target: str
    accuracy: float
    chance: float
    p_value: float


def attack(cases: Path, answers: Path, seed: int = 0) -> list[Attack]:
    """Guess kind and first subsystem of every case from what is public."""
    names = list(commitments.read(cases))
    x = np.array([features(cases, name, k) for k, name in enumerate(names)])
    ranked = rankdata(x, axis=0) / len(x)  # no scale decides
    ranked = ranked[:, np.ptp(x, axis=0) > 0]
    told = [answers_.read(commitments.answer_of(answers, n)) for n in names]
    targets = {
        "kind": [a.kind for a in told],
        "subsystem": [a.effects[0].partition(".")[0] if a.effects else a.kind for a in told],
    }
    rng = np.random.default_rng([seed, 70])
    return [_guess(name, np.array(labels), ranked, rng) for name, labels in targets.items()]


def features(cases: Path, name: str, place: int) -> list[float]:
    """Numbers that anybody can read off a case without its wrench and joints."""
    path = commitments.recording_of(cases, name)
    data = Recording.read(path)
    meta, file = data.metadata, pq.ParquetFile(path).metadata
    t = data.t
    step = np.diff(t)
    rest = step[step < 0.05]
    tool, sensor = meta.tool, meta.sensor
    warm = data.columns.get("temperature")
    return [
        place, path.stat().st_size, path.stat().st_mtime, file.num_row_groups, len(data),
        len(data.columns), len(str(meta.to_json())), float(t[-1]), float(step.max()),
        float(np.std(rest)), float(np.mean(rest)), float(np.median(step)),
        float(len(np.unique(data.columns["segment"]))), tool.mass or 0.0, *(tool.cog or (0.0,) * 3),
        *(tool.inertia or (0.0,) * 6), sensor.mass or 0.0, *(sensor.noise_std or (0.0,) * 6),
        *((0.0, 0.0, 0.0) if warm is None else (1.0, float(np.ptp(warm)), float(warm[0]))),
        float(int(path.stem) % 2), float(t[0]),
    ]  # fmt: skip


def _guess(name: str, labels: np.ndarray, x: np.ndarray, rng: np.random.Generator) -> Attack:
    """The best of many cheats, leave one out, against the best of them with shuffled answers.

    Each votes by nearest neighbours: one for every single feature, and one for all together.
    """
    spread = x + 1e-9 * rng.standard_normal(x.shape)  # equals in random order
    views = [spread, *(column[:, None] for column in spread.T)]
    near = np.stack([_nearest(v) for v in views])
    known, code = np.unique(labels, return_inverse=True)
    every = np.arange(len(known))

    def share(own: np.ndarray) -> float:
        votes = (own[near][..., None] == every).sum(axis=2)
        return float((votes.argmax(axis=2) == own).mean(axis=1).max())

    found = share(code)
    shuffled = np.array([share(rng.permutation(code)) for _ in range(DRAWS)])
    worse = (1 + int((shuffled >= found).sum())) / (1 + DRAWS)
    return Attack(name, found, float(shuffled.mean()), worse)


def _nearest(x: np.ndarray) -> np.ndarray:
    """Indices (n, k) of the nearest other rows of x (n, d)."""
    far = ((x[:, None] - x[None]) ** 2).sum(axis=-1)
    np.fill_diagonal(far, np.inf)
    return np.argsort(far, axis=1)[:, :_NEIGHBOURS]
