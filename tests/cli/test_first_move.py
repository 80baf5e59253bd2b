"""Nothing real moves before its limits were shown and a person agreed."""

import io
import sys

import pytest
from test_run_live import PLAN, Arm

from wrenchbed.cli import main
from wrenchbed.cli.record import ready
from wrenchbed.errors import ParameterError, SafetyStopError
from wrenchbed.hardware.device import only_here
from wrenchbed.hardware.drivers.can import CanDriver, CanOptions
from wrenchbed.hardware.drivers.rtde import RtdeDriver, RtdeOptions


class Watched(Arm):
    """An arm that notes what was asked of it."""

    def __init__(self, address: str = "192.168.0.20") -> None:
        super().__init__()
        self.place, self.did = address, []

    @property
    def address(self) -> str:
        return self.place

    def _open(self) -> None:
        self.did.append("connect")

    def _activate(self) -> None:
        self.did.append("activate")

    def _recover(self, unlock: bool) -> None:
        self.did.append(f"recover {unlock}")
        if not unlock:
            raise SafetyStopError("look, then call recover(unlock=True)")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def typed(monkeypatch):
    """A terminal at which somebody types a line; its output."""

    def at(line: str) -> Terminal:
        shown = Terminal()
        monkeypatch.setattr(sys, "stdin", Terminal(line + "\n"))
        monkeypatch.setattr(sys, "stderr", shown)
        return shown

    return at


def test_without_a_terminal_a_real_robot_needs_yes_and_is_not_even_connected(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    arm = Watched()
    refused = pytest.raises(ParameterError, match=r"192\.168\.0\.20 .* give --yes")
    with refused, ready(arm, PLAN, recover=False, yes=False):
        pass
    assert arm.did == []
    with ready(arm, PLAN, recover=False, yes=True) as limits:
        assert limits.limits.force is not None
    assert arm.did == ["connect"]  # recording activates it, once the plan is checked


def test_an_emulator_is_not_asked_for_and_has_limits_all_the_same(capsys):
    arm = Watched("")
    with ready(arm, PLAN, recover=False, yes=False) as limits:
        assert limits.limits.workspace is not None
    shown = capsys.readouterr()
    assert "force" in shown.err and "torque" in shown.err and shown.out == ""


@pytest.mark.parametrize("line, agreed", [("y", True), ("yes", True), ("", False), ("no", False)])
def test_the_limits_are_shown_before_the_question_and_only_yes_goes_on(typed, line, agreed):
    shown, arm = typed(line), Watched()
    try:
        with ready(arm, PLAN, recover=False, yes=False):
            assert agreed
    except ParameterError as error:
        assert not agreed and "nothing was moved" in str(error)
    text = shown.getvalue()
    assert 0 < text.index("torque") < text.index("[y/N]")
    assert arm.did == ["connect"]


def test_recover_says_that_somebody_has_looked():
    arm = Watched("")
    with ready(arm, PLAN, recover=True, yes=False):
        pass
    assert arm.did == ["connect", "recover True", "activate"]


def test_only_loopback_addresses_are_emulators():
    assert only_here("127.0.0.2") and only_here("127.5.0.9") and only_here("localhost")
    assert not only_here("192.168.0.20") and not only_here("10.0.0.1") and not only_here("")
    assert RtdeDriver(RtdeOptions(host="127.0.0.2")).address == ""
    assert RtdeDriver(RtdeOptions(host="192.0.2.7")).address == "192.0.2.7"
    assert CanDriver(CanOptions(host="127.0.0.3")).address == ""
    assert CanDriver(CanOptions(interface="virtual")).address == ""
    assert CanDriver(CanOptions(channel="can0")).address == "can0"


def test_record_on_a_real_address_is_refused_without_yes(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    PLAN.write(tmp_path / "p.parquet")
    words = ["record", "--robot", "ur5", "--driver", "rtde", "--host", "192.0.2.7", "--plan",
             str(tmp_path / "p.parquet"), "--out", str(tmp_path / "r.parquet")]  # fmt: skip
    assert main(words) == 1
    assert "give --yes" in capsys.readouterr().err
    assert not (tmp_path / "r.parquet").exists()
