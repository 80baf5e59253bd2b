"""What an entrant said of a case, read from the contract's ``diagnosis.json``."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wrenchbed.benchmark.scoring.linear import Claim
from wrenchbed.benchmark.sealed.answer import MOST
from wrenchbed.benchmark.sealed.entrants import CLAIM, RESERVED, RUN
from wrenchbed.data.checked import is_number
from wrenchbed.errors import BenchmarkError

VERDICTS = ("none", "identified", "ambiguous", "unknown")
COUNTED = 4
"""Causes of a claim that count, the first ones: naming everything is no diagnosis."""
WRONG = Claim("error", (), {})


@dataclass(frozen=True)
class EntrantClaim:
    """One claim.

    Attributes:
        claim: verdict, classes and probabilities; `WRONG` where there is none.
        where: first subsystem.
        parameters: published finite numbers by effect and name: value and std, which may be None.
        gap: the contract's finite numbers.
        seconds: that it took.
        error: what went wrong, empty if nothing did.
    """

    claim: Claim = WRONG
    where: str | None = None
    parameters: Mapping[str, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    gap: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None
    error: str = ""


def read(folder: Path, recording: str | None = None) -> EntrantClaim:
    """What an entrant said of one case; a claim that breaks the contract is wrong, not skipped.

    Args:
        recording: SHA-256 of the case; a claim about another one is wrong.
    """
    if not folder.is_dir():
        return EntrantClaim(error="no claim")
    seconds, error = None, ""
    if (folder / RUN).is_file():
        try:
            told = json.loads((folder / RUN).read_bytes())
            seconds, error = float(told["seconds"]), str(told["error"])
            if recording is not None and told.get("recording", recording) != recording:
                error = "the claim is about another case"
        except (ValueError, KeyError, TypeError):
            error = f"{folder / RUN}: is broken"
    if error:
        return EntrantClaim(seconds=seconds, error=error)
    try:
        raw = json.loads((folder / CLAIM).read_bytes())
        return _said(raw, seconds)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, *_HOSTILE) as cause:
        return EntrantClaim(
            seconds=seconds, error=f"{folder / CLAIM}: breaks the contract: {cause!r}"
        )


_HOSTILE = (ArithmeticError, RecursionError)
"""Numbers of 400 digits and objects nested without end."""


def _said(raw: Mapping[str, Any], seconds: float | None) -> EntrantClaim:
    verdict = raw["verdict"]
    if verdict not in VERDICTS:
        raise ValueError(f"verdict {verdict!r} is none of {', '.join(VERDICTS)}")
    which = raw["which"]
    if bool(which) != (verdict in ("identified", "ambiguous")):
        raise ValueError(f"verdict {verdict!r} with {len(which)} causes")
    causes = tuple((str(w["effect"]), *map(str, w.get("rivals", ()))) for w in which)
    presence = tuple(_probability(w["probability"]) for w in which)
    told = {str(k): _probability(v) for k, v in raw["probabilities"].items()}
    crowded = [c for c in (*causes, *(k.split("|") for k in told)) if len(c) > MOST]
    if crowded:
        raise ValueError(f"the class of {crowded[0][0]} has more than {MOST} members")
    causes, presence = causes[:COUNTED], presence[:COUNTED]
    names = [n for c in causes for n in c]
    if len(set(names)) != len(names):
        raise ValueError(f"{max(names, key=names.count)} is named twice")
    if abs(sum(told.values()) - 1.0) > 0.02:
        raise ValueError(f"probabilities sum to {sum(told.values()):.3f}")
    where = raw.get("where") or []
    first = str(where[0]["subsystem"]) if where else None
    if first is None and causes:
        first = causes[0][0].partition(".")[0]
    parameters = {str(w["effect"]): _numbers(w.get("parameters")) for w in which[:COUNTED]}
    gap = {k: x for k, v in _items(raw.get("gap")) if (x := _finite(v)) is not None}
    return EntrantClaim(Claim(verdict, causes, told, presence), first, parameters, gap, seconds)


def _numbers(raw: Any) -> dict[str, dict[str, float | None]]:
    """Published parameters that are numbers; others are for people."""
    told = {}
    for name, p in _items(raw):
        value = _finite(dict(_items(p)).get("value"))
        if value is not None:
            std = _finite(dict(_items(p)).get("std"))
            told[name] = {"value": value, "std": std if std is not None and std >= 0 else None}
    return told


def _items(raw: Any) -> list[tuple[str, Any]]:
    return [(str(k), v) for k, v in raw.items()] if isinstance(raw, Mapping) else []


def _finite(raw: Any) -> float | None:
    return float(raw) if is_number(raw) else None


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
    taken = sorted(set(found) & set(RESERVED))
    if taken:
        raise BenchmarkError(f"{claims / taken[0]}: {taken[0]!r} is no name for an entrant")
    if not found:
        raise BenchmarkError(f"{claims}: holds no claims; `wrenchbed blind run` writes them")
    if main is not None and main not in found:
        raise BenchmarkError(f"{claims}: no entrant {main!r}; there are {', '.join(found)}")
    first = main or ("diagnose" if "diagnose" in found else found[0])
    return [first, *(f for f in found if f != first)]
