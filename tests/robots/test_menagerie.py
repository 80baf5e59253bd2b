"""Robots by name, of a Menagerie that holds one small robot of this project's own."""

import sys

import pytest

from servo_arm import JOINTS, Servos
from wrenchbed import registry
from wrenchbed.cli import main

NAME = "universal_robots_ur5e"


def describe(folder, name=NAME):
    return main(["robot", name, "--frame", "tip", "--out", str(folder / "my.toml")])


@pytest.fixture
def menagerie(tmp_path, monkeypatch):
    """The installed package with an empty cache, and no network."""
    package = pytest.importorskip("mujoco_menagerie")
    monkeypatch.setenv("MENAGERIE_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MENAGERIE_BASE_URL", (tmp_path / "nowhere").as_uri())
    return package


def test_a_robot_of_the_cache_is_described_by_its_name(menagerie, tmp_path, monkeypatch, capsys):
    robot = menagerie.get(NAME)
    folder = menagerie.Cache().model_path(robot)
    folder.mkdir(parents=True)
    (folder / robot.entry(robot.default_model).file).write_text(Servos().xml(), encoding="utf-8")
    (folder / ".complete").write_text("{}", encoding="utf-8")
    assert describe(tmp_path) == 0
    assert registry.load("robots", str(tmp_path / "my.toml")).joint_names == JOINTS


def test_without_a_network_one_line_says_so(menagerie, tmp_path, capsys):
    assert describe(tmp_path) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "network" in error and NAME in error


def test_a_name_that_nobody_knows_is_corrected(menagerie, tmp_path, capsys):
    assert describe(tmp_path, "universal_robots_ur5") == 1
    assert f"did you mean '{NAME}'" in capsys.readouterr().err


def test_without_the_extra_its_name_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    assert describe(tmp_path) == 1
    error = capsys.readouterr().err
    assert "menagerie]" in error and "is no file" in error and error.count("\n") == 1
    assert describe(tmp_path, "arm.xml") == 1
    assert "menagerie" not in capsys.readouterr().err
