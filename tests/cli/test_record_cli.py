"""`record` on the command line: dry runs, limits, the first move of a real robot, refusals."""

import io
import json
import sys

import numpy as np
import pytest
from test_run_live import PLAN, Arm

import wrenchbed as wb
from wrenchbed.cli import main
from wrenchbed.cli.record import ready
from wrenchbed.errors import ParameterError, SafetyStopError
from wrenchbed.hardware.device_base import only_here
from wrenchbed.hardware.drivers.can import CanDriver, CanOptions
from wrenchbed.hardware.drivers.rtde import RtdeDriver, RtdeOptions

UR5 = wb.load("robots", "ur5")


@pytest.fixture
def plan(tmp_path):
    wb.Plan.of("ur5", UR5.sample(3, np.random.default_rng(0))).write(tmp_path / "p.parquet")
    return tmp_path / "p.parquet"


@pytest.fixture
def record(plan, tmp_path):
    """Runs `record` with further words; gives the exit code and where it writes."""

    def run(*more: str, out: str = "r.parquet"):
        words = ["record", "--robot", "ur5", "--plan", str(plan), "--out", str(tmp_path / out)]
        return main([*words, "--samples", "8", *more]), tmp_path / out

    return run


def test_a_dry_run_shows_every_move_and_simulates_the_campaign(record, capsys):
    code, out = record("--driver", "rtde", "--dry-run", "--speed", "0.1")
    text = capsys.readouterr().out
    assert code == 0
    assert "Every move is within reach and touches nothing" in text
    assert "at 10% of top speed" in text
    assert "joints [rad, m]" in text and "move [s]" in text
    assert "first pose again after" in text
    rec = wb.Recording.read(out)
    assert rec.metadata.source == "sim"
    assert len(rec) == 4 * 8  # three poses, and the first again


@pytest.mark.parametrize(
    ("channels", "there", "absent"),
    [
        ("wrench,effort,pose,imu", ("fx", "tau6", "mz", "ax"), ("q_target1",)),
        ("pose", ("mx", "q6"), ("fx", "tau1", "ax")),
    ],
)
def test_the_channels_that_are_asked_for_are_recorded(record, channels, there, absent):
    code, out = record("--channels", channels)
    columns = wb.Recording.read(out).columns
    assert code == 0 and set(there) <= columns.keys() and not columns.keys() & set(absent)


def test_a_limit_that_a_simulated_robot_does_not_heed_is_refused(record, capfd):
    assert record("--max-force", "5")[0] == 1
    assert "they stop real robots alone" in capfd.readouterr().err
    assert record("--max-force", "5", "--driver", "rtde", "--dry-run")[0] == 0


def test_revisit_shows_the_drift(record, capsys):
    code, _ = record("--revisit", "yes", "--json")
    drift = json.loads(capsys.readouterr().out)["drift"]
    assert code == 0
    assert set(drift) == {"fx", "fy", "fz", "tx", "ty", "tz"}
    assert all(entry["std"] > 0.0 for entry in drift.values())


class Watched(Arm):
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
