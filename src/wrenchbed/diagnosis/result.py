"""A diagnosis as people and programs read it: ``diagnosis.json`` (docs/contracts.md)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, NamedTuple

import numpy as np

from wrenchbed.data.recording import TARGET
from wrenchbed.diagnosis.gap.gap_bootstrap import Closure, Interval
from wrenchbed.diagnosis.next.blind import BlindSpot
from wrenchbed.effects.chain import ActiveEffect
from wrenchbed.files import write_json
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.twin.twin import Twin

_AS_FOUND = ("where", "which", "probabilities", "cannot_tell", "minor", "fitted")
"""Fields of `Diagnosis` that its JSON has under the same names."""


class Scale(NamedTuple):
    """Noise and material residual of one channel.

    Attributes:
        noise: standard deviation of a row's noise.
        material: residual that counts as a gap of 1.
        unit: unit of both.
    """

    noise: float
    material: float
    unit: str


def named_by(entry: Mapping[str, Any]) -> tuple[str, ...]:
    """Names in an entry of ``which`` of diagnosis.json (format 1 or 2): effect, then rivals."""
    rivals = (r["effect"] if isinstance(r, Mapping) else r for r in entry.get("rivals", ()))
    return (str(entry["effect"]), *map(str, rivals))


def cause(
    effect: str, probability: float, parameters: Mapping[str, Any],
    rivals: Sequence[Mapping[str, Any]] = (), closed_share: float | None = None,
    elements: Sequence[str] = (),
) -> dict[str, Any]:  # fmt: skip
    """Make an entry of ``which`` of diagnosis.json; ``closed_share``: of the gap, 0…1, if known."""
    return {
        "effect": effect,
        "elements": list(elements),
        "combination": None,
        "probability": probability,
        "rivals": list(rivals),
        "parameters": parameters,
        "size": {},
        "closed_share": closed_share,
        "channels": {},
    }


def rival(effect: str, probability: float, numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Make an entry of ``rivals`` of a cause, with elements and parameters of ``numbers``."""
    return {
        "effect": effect,
        "elements": numbers.get("elements", []),
        "probability": probability,
        "parameters": numbers.get("parameters", {}),
    }


def families(gap: Closure) -> dict[str, float]:
    """For each family of channels (`family`) its share, 0…1, of the gap that the effects close."""
    closed = dict.fromkeys((family(c) for c in gap.per_channel), 0.0)
    for channel, gaps in gap.per_channel.items():
        closed[family(channel)] += max(gaps["before"] - gaps.get("after", gaps["before"]), 0.0)
    total = sum(closed.values())
    return {k: v / total if total > 0.0 else 0.0 for k, v in closed.items()}


def family(channel: str) -> str:
    """Family of a channel: ``force`` (fx …), ``torque`` (tx …), ``place`` (mx …) or ``effort``."""
    if channel in CHANNELS:
        return "force" if channel.startswith("f") else "torque"
    return "place" if channel in TARGET else "effort"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Answers about a recording: where the residual lies, which causes, how far, and what next.

    Attributes:
        recording: path or name of the recording.
        robot: registry name.
        verdict: ``none``, ``identified``, ``ambiguous``, ``partial`` or ``unknown``.
        gap: gaps on held-out rows, which no fit used.
        where: subsystems with their share of the gap, as in docs/contracts.md.
        which: claimed causes, as in docs/contracts.md.
        probabilities: probability of each leading cause, ``none`` and ``unknown``; sum 1.
        cannot_tell: sentences on causes that these data do not separate.
        blind: effects that these data could not have shown.
        next: experiments that would separate the causes, as in docs/contracts.md.
        twin: simulator corrected by the causes of the means.
        seconds: duration of the diagnosis [s].
        notes: what a reader should know of the data: its noise, what was left out.
        between: effects that show between rows only, which the written twin has besides.
        set90: names, `none` and `unknown` possible, that contain the truth in 90 % of cases.
        others: names of further recordings of the robot that took part.
        minor: detected effects with less gap than a cause, as in docs/contracts.md.
        fitted: numbers that every fit frees, as in docs/contracts.md.
        scale: noise and material residual by channel.
        familiar: sentence on the learning cases, and whether this recording is like them.
        familiar_p: conformal p-value that it is like them; None if not tested.
        outliers: poses or stretches that were set aside, as in docs/contracts.md.
    """

    recording: str
    robot: str
    verdict: str
    gap: Closure
    where: Sequence[Mapping[str, Any]]
    which: Sequence[Mapping[str, Any]]
    probabilities: Mapping[str, float]
    cannot_tell: Sequence[str]
    next: Sequence[Mapping[str, Any]]
    twin: Twin
    seconds: float = 0.0
    notes: Sequence[str] = field(default_factory=tuple)
    between: Sequence[ActiveEffect] = ()
    set90: Sequence[str] = ()
    outliers: Sequence[Mapping[str, Any]] = ()
    blind: Sequence[BlindSpot] = ()
    others: Sequence[str] = ()
    minor: Sequence[Mapping[str, Any]] = ()
    fitted: Sequence[Mapping[str, Any]] = ()
    scale: Mapping[str, Scale] = field(default_factory=dict)
    familiar: str = ""
    familiar_p: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Contents of ``diagnosis.json``."""
        g = self.gap
        return plain(
            {
                "format": 2,
                "recording": PurePath(self.recording).name,
                "robot": self.robot,
                "verdict": self.verdict,
                "gap": {
                    "configured": g.configured,
                    "calibrated": g.calibrated.value,
                    "calibrated_ci95": _ends(g.calibrated),
                    "with_effects": _value(g.with_effects),
                    "with_effects_ci95": _ends(g.with_effects),
                    "floor": g.floor,
                    "closed": _value(g.closed),
                    "closed_ci95": _ends(g.closed),
                    "closed_from": g.closed_from,
                    "closed_by_black_box": g.black_box,
                    "held_out_rows": g.rows,
                    "per_channel": {c: dict(v) for c, v in g.per_channel.items()},
                    "unit": {c: s.noise for c, s in self.scale.items()},
                    "material": {c: s.material for c, s in self.scale.items()},
                    "rms": self.rms,
                },
                **{name: getattr(self, name) for name in _AS_FOUND},
                "familiar": {"p_value": self.familiar_p, "sentence": self.familiar},
                "blind": [spot.to_json() for spot in self.blind],
                "next": list(self.next),
                "recordings": [PurePath(r).name for r in (self.recording, *self.others)],
                "folds": g.folds,
                "set90": list(self.set90),
                "outliers": list(self.outliers),
                "notes": list(self.notes),
            }
        )

    @property
    def rms(self) -> dict[str, dict[str, Any]]:
        """Rms residual beyond noise, by channel, ``before`` and ``after`` the effects; and unit."""
        return {
            c: {k: s.material * float(np.sqrt(max(v, 0.0))) for k, v in gaps.items()}
            | {"unit": s.unit}
            for c, gaps in self.gap.per_channel.items()
            if (s := self.scale.get(c)) is not None
        }

    def write(self, folder: str | Path) -> None:
        """Write ``diagnosis.json`` and ``twin.json`` to a folder."""
        folder = Path(folder)
        write_json(folder / "diagnosis.json", self.to_json())
        name = None if self.twin.recording is None else PurePath(self.twin.recording).name
        twin = replace(self.twin, active=(*self.twin.active, *self.between), recording=name)
        twin.write(folder / "twin.json")


def _value(x: Interval | None) -> float | None:
    return None if x is None else x.value


def _ends(x: Interval | None) -> list[float] | None:
    return None if x is None else [x.low, x.high]


def plain(x: Any) -> Any:
    """Copy in which numbers of numpy are Python's, and those that are not finite None."""
    if isinstance(x, Mapping):
        return {str(k): plain(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [plain(v) for v in x]
    if isinstance(x, np.ndarray):
        return plain(x.tolist())
    if isinstance(x, bool | np.bool_):
        return bool(x)
    if isinstance(x, int | np.integer):
        return int(x)
    if isinstance(x, float | np.floating):
        return float(x) if np.isfinite(x) else None
    return x
