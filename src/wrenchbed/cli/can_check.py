"""`wrenchbed can-check`: does a drive on a CAN bus keep to CiA 301 and CiA 402?"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Group
from rich.table import Table as Rows
from rich.text import Text

from wrenchbed.cli import console
from wrenchbed.cli.console import Flag, Json
from wrenchbed.data.outputs import Kind
from wrenchbed.errors import ParameterError
from wrenchbed.files import write_text
from wrenchbed.hardware.conformity.bench import BenchSettings
from wrenchbed.hardware.conformity.checks import Finding, Level, Verdict
from wrenchbed.hardware.conformity.port import LinkPort, Port
from wrenchbed.hardware.conformity.suite import CHECKS, Conformity, check_drive
from wrenchbed.hardware.transducers.netcanoem.link import open_bus
from wrenchbed.pages.document import Card, Document, Section, Table
from wrenchbed.pages.provenance import provenance

FAILED = 3
"""Exit code where a check failed."""
_MOST_NODE = 127
_NO_REMOTE = ("socketcand",)
"""Interfaces of python-can that lose remote frames."""
_SUBJECTS = {
    "object": "Object dictionary", "device": "Object dictionary", "errors": "Object dictionary",
    "values": "Object dictionary", "sdo": "SDO", "nmt": "NMT, heartbeat, guarding, EMCY",
    "heartbeat": "NMT, heartbeat, guarding, EMCY", "guarding": "NMT, heartbeat, guarding, EMCY",
    "emergency": "NMT, heartbeat, guarding, EMCY", "pdo": "PDO", "state": "States",
    "fault": "States", "connection": "States", "modes": "Modes of operation",
    "pp": "Modes of operation", "pv": "Modes of operation", "hm": "Modes of operation",
    "csp": "Modes of operation", "stop": "Modes of operation",
}  # fmt: skip
"""First word of a check's name → the subject that it belongs to."""


@dataclass(frozen=True)
class BusArguments:
    """The bus, as for `record --driver can`.

    Attributes:
        channel: CAN channel, for instance can0.
        host: Address of the machine that shares its CAN bus (socketcand).
        port: TCP port of it.
        interface: Of python-can; socketcand where a host is given, else the kernel's SocketCAN.
        bitrate: For interfaces that set it [bit/s].
    """

    channel: str = "can0"
    host: str = ""
    port: int = 29536
    interface: str = ""
    bitrate: int = 1_000_000


@dataclass(frozen=True)
class AllowArguments:
    """What the checks may do; without these they read only.

    Attributes:
        write: Write objects, which are set back, and send NMT commands to this node and SYNC.
            Disconnect other nodes first: they hear SYNC, too.
        move: Switch the power stage on, and check every transition; asks before. Includes --write.
        distance: With --move: the axis may move by so much in either direction, to check its modes
            [count].
        speed: With --distance: at most so fast [count/s]; the distance in a second.
        yes: Do not ask.
    """

    write: Flag = False
    move: Flag = False
    distance: int = 0
    speed: int = 0
    yes: Flag = False

    @property
    def level(self) -> Level:
        """The highest level that is allowed."""
        return Level.MOVE if self.move else Level.WRITE if self.write else Level.READ


def can_check(
    node: tyro.conf.Positional[int],
    /,
    bus: BusArguments,
    allow: AllowArguments,
    report: Path | None = None,
    as_json: Json = False,
) -> int:
    """Check a drive on a CAN bus against CiA 301 and CiA 402; reads only unless told otherwise.

    Exit code 0: nothing found; 3: a check failed; 1: an error.

    Args:
        node: Id of the drive, 1 … 127.
        report: Page to write: every check with its clause, verdict and frames.
        as_json: Print the result as JSON.
    """
    _check(node, allow)
    console.check_out(report, Kind.PAGE)
    with _opened(bus) as port:
        if allow.move:
            _confirm(node, allow)
        settings = BenchSettings(node, distance=allow.distance, speed=allow.speed)
        with console.progress(f"node {node}", len(CHECKS)) as done:
            found = check_drive(port, settings, allow.level, done)
    if report is not None:
        words = ["--write"] * allow.write + ["--move"] * allow.move
        command = console.command("can-check", node, *words)
        write_text(report, page(found, command).html())
    console.answer(found.to_json(), as_json, _shown(found))
    return FAILED if found.failed else 0


def _check(node: int, allow: AllowArguments) -> None:
    if not 1 <= node <= _MOST_NODE:
        raise ParameterError(f"node {node}: give an id from 1 to {_MOST_NODE}")
    if allow.distance < 0 or allow.speed < 0:
        raise ParameterError("--distance and --speed must not be negative")
    if allow.distance and not allow.move:
        raise ParameterError("--distance is for motions: give --move, too")


@contextmanager
def _opened(bus: BusArguments) -> Iterator[Port]:
    """The bus while the block runs."""
    link = open_bus(bus.interface, bus.channel, bus.host, bus.port, bus.bitrate)
    kind = bus.interface or ("socketcand" if bus.host else "socketcan")
    try:
        yield LinkPort(link, kind not in _NO_REMOTE)
    finally:
        link.close()


def _confirm(node: int, allow: AllowArguments) -> None:
    """Ask the person at the terminal.

    Raises:
        ParameterError: there is nobody to ask, or the answer is another one.
    """
    if allow.yes:
        return
    if not sys.stdin.isatty():
        raise ParameterError("--move switches the power stage on: confirm on a terminal, or --yes")
    moves = f"its axis moves by up to {allow.distance} counts" if allow.distance else "it stands"
    console.say(
        f"The power stage of drive {node} will be switched on, brakes open, {moves}. "
        f"Keep the emergency stop in reach. Type {node} to go on."
    )
    if sys.stdin.readline().strip() != str(node):
        raise ParameterError("not confirmed: nothing was switched on")


def _shown(found: Conformity) -> Group:
    """Counts by subject, and what failed."""
    table = Rows(box=None, padding=(0, 2, 0, 0), header_style="dim")
    table.add_column("")
    for verdict in Verdict:
        table.add_column(verdict.value, justify="right", no_wrap=True)
    for subject in dict.fromkeys(_SUBJECTS.values()):
        counts = [
            sum(f.verdict is v and _subject(f.check.name) == subject for f in found.findings)
            for v in Verdict
        ]
        style = "bold red" if counts[1] else ""
        table.add_row(subject, *(str(n) if n else "" for n in counts), style=style)
    failed: list[Text] = []
    for f in found.failed:
        failed += [
            Text(f"\nfail  {f.check.name}  ({f.check.clause})", style="bold red"),
            Text(f"  {f.check.text}"),
            Text(f"  {f.why}"),
            *(Text(f"  {line}", style="dim") for line in f.evidence[-4:]),
        ]
    return Group(Text(_headline(found), style="bold"), "", table, *failed)


def _headline(found: Conformity) -> str:
    name = found.device.get("name", "a drive without a name")
    asked = len(found.findings) - found.count(Verdict.NOT_ASKED)
    failed = len(found.failed)
    told = f"{failed} of {asked} checks fail" if failed else f"none of {asked} checks fails"
    return f"Node {found.node} ({name}): {told}."


def _subject(name: str) -> str:
    return _SUBJECTS[name.partition(".")[0]]


def _frames(finding: Finding) -> tuple[str, ...]:
    """The evidence that a page shows: all of a failed check, the last question of others."""
    return finding.evidence if finding.verdict is Verdict.FAIL else finding.evidence[-2:]


def page(found: Conformity, command: str = "") -> Document:
    """Every check with its clause, verdict and evidence, as a page."""
    cards = [
        Card(verdict.value, str(found.count(verdict)), f"checks of {len(found.findings)}")
        for verdict in Verdict
    ]
    device = Table.of("What the drive says it is", ("", "value"), sorted(found.device.items()))
    sections = [Section("The drive", "", (device,))]
    for subject in dict.fromkeys(_SUBJECTS.values()):
        rows = [
            (c.name, c.clause, c.text, f.verdict.value, f.why, " / ".join(_frames(f)))
            for f in found.findings
            if _subject((c := f.check).name) == subject
        ]
        columns = ("check", "clause", "what must hold", "verdict", "why", "frames")
        sections.append(Section(subject, "", (Table.of(f"{subject}: checks", columns, rows),)))
    lead = f"{_headline(found)} Frames: > to the drive, < from it; id and data, hexadecimal."
    return Document(
        f"CiA 301 and CiA 402: node {found.node}", lead, tuple(sections),
        data=provenance([], command), cards=tuple(cards),
    )  # fmt: skip
