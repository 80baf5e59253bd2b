"""What a check is: its name, its clause of the standard, and how much it may do."""

import enum
from collections.abc import Callable
from dataclasses import dataclass

from wrenchbed.hardware.conformity.bench import Bench


class Level(enum.IntEnum):
    """How much a check does to a drive."""

    READ = 0
    """It reads, and sends requests that a drive refuses."""
    WRITE = 1
    """It writes objects that are set back, and sends NMT commands and SYNC."""
    MOVE = 2
    """It switches the power stage on."""


class Verdict(enum.StrEnum):
    """What came of a check."""

    PASS = "pass"
    FAIL = "fail"
    NOT_APPLICABLE = "not applicable"
    NOT_ASKED = "not asked"


@dataclass(frozen=True)
class Check:
    """One rule of a standard.

    Attributes:
        name: of it, in words with dots.
        clause: of the standard.
        text: what must hold.
        level: how much it does.
        run: raises `FailedError` where the rule is broken.
    """

    name: str
    clause: str
    text: str
    level: Level
    run: Callable[[Bench], None]


@dataclass(frozen=True)
class Finding:
    """A check and its verdict.

    Attributes:
        check: what was asked.
        verdict: the answer.
        why: reason of a verdict other than pass.
        evidence: the last frames, ``>`` to the drive and ``<`` from it.
    """

    check: Check
    verdict: Verdict
    why: str = ""
    evidence: tuple[str, ...] = ()


Run = Callable[[Bench], None]


class Checks(list[Check]):
    """Checks of one subject, in order."""

    def rule(self, name: str, clause: str, level: Level) -> Callable[[Run], Run]:
        """Add a function as a check; its docstring says what must hold."""

        def add(run: Run) -> Run:
            text = " ".join((run.__doc__ or "").split())
            self.append(Check(name, clause, text, level, run))
            return run

        return add
