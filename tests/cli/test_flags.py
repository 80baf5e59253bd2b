"""Every flag keeps its spelling and its default."""

import re
from importlib.metadata import version

import pytest

from wrenchbed.cli import main

FLAGS = {
    "list": "json=False",
    "plan": (
        "accuracy=None, for=None, goal=None, index=None, json=False, least-poses=None, "
        "motion=poses, n=100, out=required, points=None, pool=None, rate=125.0, seconds=60.0, "
        "seed=0, touch-cost=None, touch-std=None"
    ),
    "record": (
        "channel=None, driver=sim, dry-run=False, effect=repeatable, effort=None, force=False, "
        "host=None, json=False, max-force=None, max-torque=None, noise=None, out=required, "
        "parameters=None, plan=required, rate=None, recording=None, recover=False, "
        "resume=False, revisit=auto, robot=required, samples=100, seed=None, "
        "sensor=None, set=repeatable, speed=None, tracking=None, "
        "workspace=None, yes=False"
    ),
    "import": (
        "fit=None, force=False, gravity=None, guess=False, json=False, map=None, mode=None, "
        "out=required, rest=None, robot=None, sensor=None, tool-mass=None"
    ),
    "calibrate": (
        "channels=None, constants=None, force=False, free=none, hold=none, json=False, "
        "loss=linear, out=None, prior=False, report=None, touch-std=None, touches=None, truth=None"
    ),
    "diagnose": (
        "channels=None, drives=None, dry-run=False, fast=False, json=False, look-alikes=0, "
        "out=None, rate=100.0, samples=60, seed=0"
    ),
    "doctor": "host=None, json=False, robot=ur5, seconds=3.0, sensor=None",
    "view": "port=9876, rrd=None",
    "report": "out=report.html",
    "simulate": "force=False, json=False, like=required, noise=off, out=required, seed=0",
    "export": (
        "force=False, frame=None, json=False, mcap=None, mjcf=None, mount=None, out=None, to=None, "
        "urdf=None"
    ),
    "twin": (
        "effect=repeatable, faults=None, host=127.0.0.1, noise=real, parameters=None, "
        "seed=0, set=repeatable, table=None"
    ),
    "campaign": (
        "force=False, json=False, only=None, out=required, plan=None, poses=100, "
        "robots=100, samples=50, seed=0, vary=noise,parameters, "
        "workers=None"
    ),
    "study": "json=False, out=None, quick=False, robots=None, seed=0",
    "blind make": (
        "answers=required, cases=300, json=False, mode=static, on=None, out=required, "
        "processes=2, robot=ur5, seed=None"
    ),
    "blind run": "json=False, limit=300.0, method=repeatable, out=required, processes=2",
    "blind score": "commitments=None, json=False, method=None, out=None",
    "blind seal": "answers=required, json=False, out=required",
}
"""Flags and defaults that other programs may rely on."""


def flags(text):
    """Flags with their defaults, from the help of a verb."""
    entries = []
    for line in (line.strip("│ ") for line in text.splitlines()):
        if not line or re.match(r"--[a-z]|[╭╰─-]", line):
            entries.append(line)
        elif entries:
            entries[-1] += f" {line}"
    known = {}
    for entry in (e for e in entries if re.match("--[a-z]", e)):
        end = re.search(r"\((?:default: ?([^()]*)|(required|repeatable))\)$", entry)
        assert end, entry
        known[entry[2:].split()[0]] = end[2] or end[1] or "none"
    return ", ".join(f"{flag}={known[flag]}" for flag in sorted(known))


def printed(arguments, capfd):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert not caught.value.code
    return capfd.readouterr().out


@pytest.mark.parametrize("verb", FLAGS)
def test_flags_and_defaults_stay(verb, capfd, monkeypatch):
    monkeypatch.setenv("COLUMNS", "115")
    text = printed([*verb.split(), "--help"], capfd)
    assert flags(re.sub(r"\x1b\[[0-9;]*m", "", text)) == FLAGS[verb]


def test_the_version_is_printed(capfd):
    assert printed(["--version"], capfd) == f"wrenchbed {version('wrenchbed')}\n"
