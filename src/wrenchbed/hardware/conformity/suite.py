"""All checks on one drive, and what came of them."""

import contextlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from wrenchbed.errors import LinkError
from wrenchbed.hardware.conformity import (
    motions,
    network,
    objects,
    process_data,
    states,
    transfers,
)
from wrenchbed.hardware.conformity.bench import (
    PRE_OPERATIONAL,
    Bench,
    BenchSettings,
    FailedError,
    NotApplicableError,
    RefusedError,
)
from wrenchbed.hardware.conformity.checks import Check, Finding, Level, Verdict
from wrenchbed.hardware.conformity.port import Port

CHECKS: tuple[Check, ...] = (
    *objects.CHECKS, *transfers.CHECKS, *network.CHECKS, *process_data.CHECKS, *states.CHECKS,
    *motions.CHECKS,
)  # fmt: skip
"""Every check, in the order in which they run."""
_ASKS = {Level.WRITE: "--write", Level.MOVE: "--move"}


@dataclass(frozen=True)
class Conformity:
    """What the checks of a drive found.

    Attributes:
        node: its id.
        device: name, vendor, product and revision, as far as it tells.
        level: what was allowed.
        findings: one for each check.
    """

    node: int
    device: dict[str, str]
    level: Level
    findings: tuple[Finding, ...]

    def count(self, verdict: Verdict) -> int:
        """Checks with a verdict."""
        return Counter(f.verdict for f in self.findings)[verdict]

    @property
    def failed(self) -> tuple[Finding, ...]:
        """Checks that failed."""
        return tuple(f for f in self.findings if f.verdict is Verdict.FAIL)

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "node": self.node, "device": self.device, "level": self.level.name.lower(),
            "count": {verdict.value: self.count(verdict) for verdict in Verdict},
            "checks": [
                {
                    "name": f.check.name, "clause": f.check.clause, "text": f.check.text,
                    "verdict": f.verdict.value, "why": f.why, "evidence": list(f.evidence),
                }
                for f in self.findings
            ],
        }  # fmt: skip


def check_drive(
    port: Port, settings: BenchSettings, level: Level = Level.READ,
    report: Callable[[int, str], None] = lambda n, label: None, checks: Sequence[Check] = CHECKS,
) -> Conformity:  # fmt: skip
    """Run all checks up to a level.

    Args:
        port: the bus.
        settings: which node, and what is allowed.
        level: of the checks that run; the others are not asked.
        report: called with 1 and a check's name after each one.
        checks: to run.

    Raises:
        LinkError: the node answers nothing, or the bus is gone.
    """
    bench = Bench(port, settings)
    try:
        bench.read(0x1000)
    except FailedError as error:
        raise LinkError(
            f"node {settings.node} does not answer: check its id, bit rate, power and termination"
        ) from error
    except RefusedError:
        pass
    device = _device(bench)
    findings = []
    for check in checks:
        findings.append(_run(bench, check, level))
        report(1, check.name)
    return Conformity(settings.node, device, level, tuple(findings))


def _device(bench: Bench) -> dict[str, str]:
    told: dict[str, str] = {}
    for name, index in (("name", 0x1008), ("hardware", 0x1009), ("software", 0x100A)):
        with contextlib.suppress(RefusedError, FailedError):
            told[name] = bench.upload(index).decode("ascii", "replace").rstrip("\0 ")
    for sub, name in enumerate(("vendor", "product", "revision", "serial"), start=1):
        with contextlib.suppress(RefusedError, FailedError):
            told[name] = f"0x{bench.read(0x1018, sub):X}"
    return told


def _run(bench: Bench, check: Check, level: Level) -> Finding:
    if check.level > level:
        return Finding(check, Verdict.NOT_ASKED, f"give {_ASKS[check.level]}")
    verdict, why = Verdict.PASS, ""
    try:
        bench.begin()
        if check.level > Level.READ:
            bench.nmt(PRE_OPERATIONAL)
        check.run(bench)
    except NotApplicableError as error:
        verdict, why = Verdict.NOT_APPLICABLE, str(error)
    except (FailedError, RefusedError) as error:
        verdict, why = Verdict.FAIL, str(error)
    evidence = tuple(bench.trace)
    left = _clean_up(bench, check)
    if left and verdict is Verdict.PASS:
        verdict, why = Verdict.FAIL, left
    return Finding(check, verdict, why, evidence)


def _clean_up(bench: Bench, check: Check) -> str:
    """Bring the drive back to what it was before a check; what did not work."""
    if check.level is Level.READ:
        return ""
    stays = motions.go_back(bench) if check.level is Level.MOVE else ""
    if check.level is Level.MOVE or check.name.startswith("state."):
        states.leave(bench)
    else:
        bench.nmt(PRE_OPERATIONAL)
    return "; ".join(filter(None, [stays, *bench.restore()]))
