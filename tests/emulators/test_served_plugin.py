"""`wrenchbed twin` serves whatever emulator is installed."""

import gc

import pytest

from robot_emulators.base.emulator import Emulator
from robot_emulators.base.real_time import objects_kept
from wrenchbed import registry
from wrenchbed.cli import main


class Gripper(Emulator):
    """Of another package."""

    name, title, settings = "gripper", "a gripper", {}
    served: list[str] = []  # noqa: RUF012

    def serve(self):
        self.served.append(self.name)
        self.fail(RuntimeError("enough"))
        return {"gripper": "127.0.0.1:1"}

    def stop(self):
        self.served.append("stopped")


def test_an_emulator_of_another_package_is_served(monkeypatch, capsys):
    entry = type("Entry", (), {"load": lambda self: Gripper})()
    monkeypatch.setattr(registry, "_entry_points", lambda kind: {"gripper": entry})
    assert main(["twin", "gripper"]) == 1
    said = capsys.readouterr()
    assert "ready gripper=127.0.0.1:1" in said.out
    assert "enough" in said.err
    assert Gripper.served == ["gripper", "stopped"]


@pytest.mark.parametrize("wrong", ["ur6", "grippr"])
def test_an_unknown_emulator_is_refused_with_those_that_exist(wrong, capsys):
    assert main(["twin", wrong]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert f"there is no emulator {wrong!r}" in said
    assert "medrue, netft, ur5" in said


def test_what_exists_before_is_left_out_of_garbage_collection_while_an_emulator_serves():
    before = gc.get_freeze_count()
    with objects_kept():
        assert gc.get_freeze_count() > before + 10_000
    assert gc.get_freeze_count() == 0
