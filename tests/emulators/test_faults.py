"""What an emulator does wrong when it is told: scripts, live lines, and values that are refused."""

import pytest

from robot_emulators.base import arguments as asks
from robot_emulators.base import faults as timed
from robot_emulators.base.faults import Faults, TimedFault
from robot_emulators.errors import FaultError

SCRIPT = """
[[fault]]
at = 0.05
link = "rdt"
kind = "drop"
seconds = 1.5
share = 0.3

[[fault]]
link = "rdt"
kind = "stall"
"""


def test_a_script_is_sorted_and_run_in_time(tmp_path):
    path = tmp_path / "faults.toml"
    path.write_text(SCRIPT)
    script = timed.read(path)
    assert [f.kind for f in script] == ["stall", "drop"]
    assert script[1] == TimedFault("rdt", "drop", 0.05, 1.5, {"share": 0.3})
    done = []
    faults = Faults()
    faults.on("rdt", "drop", lambda f: done.append(f.kind), {"share": asks.number(0.0, 1.0)})
    faults.on("rdt", "stall", lambda f: done.append(f.kind))
    faults.start(script)
    for _ in range(100):
        if len(done) == 2:
            break
        faults._stopped.wait(0.02)
    assert done == ["stall", "drop"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[fault]]\nlink='rdt'", r"fault 1: kind = None must be a name"),
        ("[[fault]]\nlink='a'\nkind='b'\nat=-1", "at = -1 must be a number, at least 0 s"),
        ("faults = 3", r"holds \[\[fault\]\] entries and nothing else"),
        ("[[fault", "not valid TOML"),
    ],
)
def test_a_bad_script_is_refused_by_field(tmp_path, text, message):
    path = tmp_path / "f.toml"
    path.write_text(text)
    with pytest.raises(FaultError, match=message):
        timed.read(path)


def test_an_unknown_fault_lists_what_exists():
    faults = Faults()
    faults.on("rdt", "drop", print)
    with pytest.raises(FaultError, match=r"no fault rdt melt\. Known: rdt drop"):
        faults.inject(TimedFault("rdt", "melt"))


ASKS = {
    "share": asks.number(0.0, 1.0, 0.1), "node": asks.integer(1, 127, 1),
    "how": asks.word(("short", "long"), "short"), "silent": asks.flag(True),
    "joints": asks.numbers(2, 0.5), "name": asks.text("cfgcpf"),
}  # fmt: skip


def told(**values):
    """What a handler is given for these values."""
    faults, got = Faults(), []
    faults.on("rdt", "drop", got.append, ASKS)
    faults.inject(TimedFault("rdt", "drop", values={"joints": [0.1, -0.1]} | values))
    return got[0].values


def test_values_of_a_fault_have_defaults():
    assert told(node=3) == {
        "share": 0.1, "node": 3, "how": "short", "silent": True, "joints": [0.1, -0.1],
        "name": "cfgcpf",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"shre": 0.9}, "rdt drop knows no 'shre'. Known: at, seconds, share, node"),
        ({"share": 1.1}, "share = 1.1 must be a number 0 … 1"),
        ({"share": "half"}, "share = 'half' must be a number"),
        ({"share": float("nan")}, "must be a number"),
        ({"share": [1]}, "must be a number"),
        ({"node": 1.5}, "node = 1.5 must be a whole number 1 … 127"),
        ({"node": True}, "must be a whole number"),
        ({"how": "wide"}, "must be one of short, long"),
        ({"silent": 0}, "must be true or false"),
        ({"joints": [0.1]}, "must be 2 numbers, none beyond 0.5"),
        ({"joints": [0.1, 0.6]}, "must be 2 numbers, none beyond 0.5"),
        ({"joints": None}, "must be 2 numbers"),
        ({"name": 5}, "must be text"),
    ],
)
def test_values_that_a_fault_does_not_take_are_refused(values, why):
    with pytest.raises(FaultError, match=why):
        told(**values)


def test_a_fault_that_breaks_does_not_end_the_others():
    faults, answers = Faults(), []

    def broken(fault):
        raise RuntimeError("a bug")

    faults.on("rdt", "drop", broken)
    faults.on("rdt", "stall", print)
    lines = ['{"link": "rdt", "kind": "drop"}', "[", '{"link": "rdt", "kind": "stall"}']
    faults._take(lines, answers.append)
    assert [answer.split(":")[0] for answer in answers] == ["refused", "refused", "done"]
