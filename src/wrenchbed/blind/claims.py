"""What an entrant said of a case, read from the contract's ``diagnosis.json``."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.blind.entrant import CLAIM, RUN
from wrenchbed.diagnosis.linear import Claim
from wrenchbed.errors import BenchmarkError

VERDICTS = ("none", "identified", "ambiguous", "unknown")
WRONG = Claim("error", (), {})


@dataclass(frozen=True)
class Said:
    """One claim.

    Attributes:
        claim: verdict, classes and probabilities; `WRONG` where there is none.
        where: first subsystem.
        parameters: published numbers by effect, those with a standard uncertainty or without.
        gap: the contract's object.
        seconds: that it took.
        error: what went wrong, empty if nothing did.
    """

    claim: Claim = WRONG
    where: str | None = None
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    gap: Mapping[str, Any] = field(default_factory=dict)
    seconds: float | None = None
    error: str = ""


def read(folder: Path) -> Said:
    """What an entrant said of one case; a claim that breaks the contract is wrong, not skipped."""
    if not folder.is_dir():
        return Said(error="no claim")
    seconds, error = None, ""
    if (folder / RUN).is_file():
        try:
            told = json.loads((folder / RUN).read_bytes())
            seconds, error = float(told["seconds"]), str(told["error"])
        except (ValueError, KeyError, TypeError):
            error = f"{folder / RUN}: is broken"
    if error:
        return Said(seconds=seconds, error=error)
    try:
        raw = json.loads((folder / CLAIM).read_bytes())
        return _said(raw, seconds)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as cause:
        return Said(seconds=seconds, error=f"{folder / CLAIM}: breaks the contract: {cause!r}")


def _said(raw: Mapping[str, Any], seconds: float | None) -> Said:
    verdict = raw["verdict"]
    if verdict not in VERDICTS:
        raise ValueError(f"verdict {verdict!r} is none of {', '.join(VERDICTS)}")
    which = raw["which"]
    if bool(which) != (verdict in ("identified", "ambiguous")):
        raise ValueError(f"verdict {verdict!r} with {len(which)} causes")
    causes = tuple((str(w["effect"]), *map(str, w.get("rivals", ()))) for w in which)
    crowded = next((c for c in causes if len(c) > 5), None)
    if crowded is not None:
        raise ValueError(f"{crowded[0]} has more than four rivals")
    presence = tuple(_probability(w["probability"]) for w in which)
    told = {str(k): _probability(v) for k, v in raw["probabilities"].items()}
    if abs(sum(told.values()) - 1.0) > 0.02:
        raise ValueError(f"probabilities sum to {sum(told.values()):.3f}")
    where = raw.get("where") or []
    first = str(where[0]["subsystem"]) if where else None
    if first is None and causes:
        first = causes[0][0].partition(".")[0]
    parameters = {str(w["effect"]): w.get("parameters") or {} for w in which}
    claim = Claim(verdict, causes, told, presence)
    return Said(claim, first, parameters, raw.get("gap") or {}, seconds)


def _probability(value: Any) -> float:
    p = float(value)
    if not -1e-9 <= p <= 1.0 + 1e-9:
        raise ValueError(f"probability {value!r} is not between 0 and 1")
    return float(np.clip(p, 0.0, 1.0))


def entrants(claims: Path, main: str | None = None) -> list[str]:
    """Names of the entrants in a folder of claims, the main one first.

    Raises:
        BenchmarkError: there is none, or not the one that was asked for.
    """
    found = []
    if claims.is_dir():
        found = sorted(f.name for f in claims.iterdir() if f.is_dir() and f.name[0] != ".")
    if not found:
        raise BenchmarkError(f"{claims}: holds no claims; `wrenchbed blind run` writes them")
    if main is not None and main not in found:
        raise BenchmarkError(f"{claims}: no entrant {main!r}; there are {', '.join(found)}")
    first = main or ("diagnose" if "diagnose" in found else found[0])
    return [first, *(f for f in found if f != first)]
