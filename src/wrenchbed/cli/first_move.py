"""Before a live robot moves: its limits are shown, and a person agrees."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.table import Table

import wrenchbed as wb
from wrenchbed.campaigns.recording.live_limits import LiveLimits, live_limits
from wrenchbed.cli import console
from wrenchbed.errors import DriverError, ParameterError
from wrenchbed.hardware.drivers.base import Driver
from wrenchbed.hardware.drivers.base.live import LiveDriver

_YES = ("y", "yes")


@contextmanager
def ready(link: Driver, plan: wb.Plan, *, recover: bool, yes: bool) -> Iterator[LiveLimits | None]:
    """Connected and able to move; errors name the flag instead of the Python method.

    The block gets the limits of a live driver, which were shown.

    Args:
        link: closed.
        plan: that it will run.
        recover: somebody has looked at a robot that stopped.
        yes: a person agreed already that a real robot moves.

    Raises:
        ParameterError: nobody agreed, and there is no terminal to ask at.
    """
    address = link.address if isinstance(link, LiveDriver) else ""
    ask = bool(address) and not yes
    if ask and not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise ParameterError(
            f"the robot at {address} would move, and there is no terminal to ask at: look that "
            "its surroundings are free, then give --yes"
        )
    try:
        link.connect()
        try:
            limits = _shown(link, plan) if isinstance(link, LiveDriver) else None
            if ask:
                _agree(address)
            if recover:
                link.recover(unlock=True)
            else:
                link.activate()
            yield limits
        finally:
            link.close()
    except DriverError as error:
        text = str(error).replace("call recover(unlock=True)", "give --recover")
        raise type(error)(text.replace("call recover()", "give --recover")) from error


def _shown(link: LiveDriver, plan: wb.Plan) -> LiveLimits:
    """The complete limits, printed."""
    found = live_limits(link, plan)
    console.note(_table(link, found))
    return found


def _table(link: LiveDriver, found: LiveLimits) -> Table:
    limits, origin = found.limits, found.origin
    assert limits.workspace is not None
    lower, upper = limits.workspace
    model = link.answers.get("model")
    title = f"{model or link.robot.name} at {link.address or 'this machine (emulator)'}: limits"
    table = console.table("limit", "value", "from", title=title)
    for k, axis in enumerate("xyz"):
        where = origin["workspace"] if k == 0 else ""
        table.add_row(f"sensor's {axis}", f"{lower[k]:+.2f} … {upper[k]:+.2f} m", where)
    table.add_row("force", f"{limits.force:.3g} N", origin["force"])
    table.add_row("torque", f"{limits.torque:.3g} N·m", origin["torque"])
    table.add_row("speed of moves", f"{limits.speed:.0%} of top speed", "")
    return table


def _agree(address: str) -> None:
    """Ask at the terminal.

    Raises:
        ParameterError: the answer is not yes.
    """
    console.note(f"The robot at {address} will move. Is nobody in its reach? [y/N]")
    if sys.stdin.readline().strip().lower() not in _YES:
        raise ParameterError("not agreed: nothing was moved")
