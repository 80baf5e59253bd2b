"""What an entrant says of a case, read from the contract's `diagnosis.json` or made by a rule."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wrenchbed.benchmark.efforts.alike import Key
from wrenchbed.benchmark.efforts.case import EffortTruth

MOST = 5
"""Members of a class that still name something, as in the contract."""
JOINT = "joint"
"""Parameter that holds the 1-based joint or link."""


@dataclass(frozen=True)
class EffortClaim:
    """An answer.

    Attributes:
        verdict: of the contract.
        causes: class of effects with joints of each claimed cause, first choice first.
        presence: probability of each.
        unknown: probability of ``unknown``.
        none: probability of ``none``.
        closed: share of the configured gap that the answer closes by its own account.
        seconds: that it took.
        error: what went wrong, empty if nothing did.
    """

    verdict: str
    causes: tuple[tuple[Key, ...], ...] = ()
    presence: tuple[float, ...] = ()
    unknown: float = 0.0
    none: float = 0.0
    closed: float | None = None
    seconds: float = 0.0
    error: str = ""


def of_json(raw: Mapping[str, Any], seconds: float) -> EffortClaim:
    """The claim of a `diagnosis.json`.

    Raises:
        KeyError, TypeError, ValueError: it is not of the contract's form.
    """
    told = list(raw["which"])
    odds = raw.get("probabilities", {})
    return EffortClaim(
        str(raw["verdict"]),
        tuple(_class(entry) for entry in told),
        tuple(float(entry["probability"]) for entry in told),
        float(odds.get("unknown", 0.0)),
        float(odds.get("none", 0.0)),
        _closed(raw.get("gap", {})),
        seconds,
    )


def _closed(gap: Mapping[str, Any]) -> float | None:
    """Share of the configured gap that is closed, as of the oracle; None without a claim."""
    before, after = gap.get("configured"), gap.get("with_effects")
    if before is None or after is None or not float(before) > 0.0:
        return None
    share = 1.0 - max(float(after), 0.0) / float(before)
    return share if math.isfinite(share) else None


def _class(entry: Mapping[str, Any]) -> tuple[Key, ...]:
    """Effects of an entry, each at each of its joints."""
    joint = entry.get("parameters", {}).get(JOINT)
    joints: list[int | None] = [None]
    if joint is not None:
        at = joint if isinstance(joint, int) else joint["value"]
        others = [] if isinstance(joint, int) else joint.get("rivals", [])
        joints = [int(at), *(int(j) for j in others)]
    effects = [str(e) for e in (entry["effect"], *entry.get("rivals", []))]
    if len(effects) > MOST:
        raise ValueError(f"the class of {effects[0]} has more than {MOST} members")
    return tuple(_key(e, j) for e in effects for j in joints)


def _key(effect: str, joint: int | None) -> Key:
    """Joint named in the effect's name or beside it; tool and base have none."""
    name, _, number = effect.rpartition(".")
    if number.isdigit():
        return (name, int(number))
    return (effect, joint if effect.startswith(("drive.", "link.")) else None)


def always_none(_: EffortTruth) -> EffortClaim:
    """Nothing is ever wrong."""
    return EffortClaim("none", none=1.0)


def always_coulomb(_: EffortTruth) -> EffortClaim:
    """Coulomb friction of the first joint is always wrong."""
    return EffortClaim("identified", ((("drive.coulomb", 1),),), (1.0,), closed=0.0)


def oracle(truth: EffortTruth) -> EffortClaim:
    """The truth itself."""
    if truth.kind == "none":
        return always_none(truth)
    if truth.kind == "outside":
        return EffortClaim("unknown", unknown=1.0)
    return EffortClaim("identified", (((truth.family, truth.joint),),), (1.0,), closed=truth.closed)


TRIVIAL = {"always none": always_none, "always coulomb 1": always_coulomb, "oracle": oracle}
"""Entrants by rule, which show what the score is worth."""
