"""Whatever reads a wire, on valid messages, on pieces of them, and on random bytes.

A target is a function that raises on a broken promise or on an error that is not a named one, and
its seeds: valid messages that a test cuts and changes.
"""

import contextlib
import random
import struct
from collections.abc import Callable
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from file_fuzz import LOGS, SETTINGS, Runner, corpus, mutated
from robot_emulators import can_bus as client
from robot_emulators.kinematic_plant import kinematic_plant
from robot_emulators.netft_box.pages import Pages
from robot_emulators.netft_box.rdt import Pace
from robot_emulators.netft_box.sensing import BoxSettings
from robot_emulators.plant import PlantRequest
from robot_emulators.ur import rtde_packets
from robot_emulators.ur.controller import Controller, functions
from robot_emulators.ur.dashboard import GREETING, Dashboard
from robot_emulators.ur.rtde import Inputs, Offer, RtdeSession
from robot_emulators.ur.settings import ControllerSettings
from robot_emulators.ur.urscript.machine import compiled
from robot_emulators.ur.urscript.tokens import Collector
from robot_emulators.ur.urscript.values import ScriptFaultError
from wrenchbed.errors import DriverError
from wrenchbed.hardware.transducers.base import Past
from wrenchbed.hardware.transducers.netft import rdt as records
from wrenchbed.hardware.transducers.netft.rdt import DeviceClock

Target = Callable[[bytes], None]


def chunks(data: bytes) -> list[bytes]:
    """Pieces of a stream, of sizes that the data themselves say: one byte each, then so many."""
    pieces, at = [], 0
    while at < len(data):
        size = data[at] + 1
        pieces.append(data[at + 1 : at + 1 + size])
        at += 1 + size
    return pieces


def joined(*pieces: bytes) -> bytes:
    return b"".join(bytes([len(p) - 1]) + p for p in pieces)


def rtde() -> tuple[Target, list[bytes]]:
    """An RTDE client's packets on their way to the UR5 emulator."""
    version = (5, 11, 0, 1)
    outputs = rtde_packets.outputs(version)
    values = {name: rtde_packets.zero(kind) for name, kind in outputs.items()}
    inputs = Inputs(rtde_packets.inputs(version), lambda written: None)
    offer = Offer(version, 500.0, outputs, inputs)

    def run(data: bytes) -> None:
        sent: list[bytes] = []
        session = RtdeSession(offer, sent.append)
        for piece in chunks(data):
            if not session.receive(piece, 1.0):
                break
            assert len(session.splitter.held) < 65536
            if session.due():
                packet = session.data(values)
                assert struct.unpack_from(">H", packet)[0] == len(packet)
        session.end()
        for packet in sent:
            assert struct.unpack_from(">H", packet)[0] == len(packet)
        assert not inputs._owners

    names = b"timestamp,actual_q,actual_TCP_force,robot_mode"
    opening = rtde_packets.packet(rtde_packets.VERSION, b"\0\2") + rtde_packets.packet(
        rtde_packets.CONTROLLER
    )
    recipe = rtde_packets.packet(rtde_packets.OUTPUTS, struct.pack(">d", 125.0) + names)
    written = rtde_packets.packet(
        rtde_packets.INPUTS, b"input_int_register_0,input_double_register_1"
    )
    value = rtde_packets.packet(rtde_packets.DATA, b"\1" + struct.pack(">id", 5, 0.5))
    return run, [
        joined(
            opening,
            recipe,
            rtde_packets.packet(rtde_packets.START),
            rtde_packets.packet(rtde_packets.PAUSE),
        ),
        joined(opening, written, value, value),
        joined(
            rtde_packets.packet(rtde_packets.OUTPUTS, names),
            rtde_packets.packet(rtde_packets.START),
            b"\0\2",
        ),
    ]


def script() -> tuple[Target, list[bytes]]:
    """Programs on their way to the controller: each is translated, or says why not."""
    table = functions((5, 11, 1, 0))

    def run(data: bytes) -> None:
        collector, size = Collector(), 1 + len(data) % 7
        for at in range(0, len(data), size):
            programs = collector.feed(data[at : at + size])
            assert programs is not None and collector.held <= len(data)
            for text in programs:
                with contextlib.suppress(ScriptFaultError):
                    compiled(text, table)

    return run, [
        b"movej([0,1,2,3,4,5],a=1.4,v=1.05,r=0.02)\nmovel(p[0.1,0.2,0.3,0,3,0],a=1.2,v=0.25)\n",
        b"sec s():\n  set_digital_out(0, True)\nend\n# words\nstopj(2)\n",
        b"def f():\n  write_output_integer_register(0 +24, -2)\n  if x:\n  end\nend\n",
    ]


def _controller():
    """An e-Series controller, which knows the most, with the built-in plant."""
    return Controller(ControllerSettings("e"), kinematic_plant(PlantRequest("ur5", 0.008)))


def dashboard() -> tuple[Target, list[bytes]]:
    """Lines on their way to the dashboard: each is answered by one."""
    controller = _controller()

    def run(data: bytes) -> None:
        said: list[bytes] = []
        controller.reboot()
        talk = Dashboard(controller, SimpleNamespace(send=said.append), lambda: None)
        for piece in chunks(data):
            if not talk.receive(piece, 1.0):
                break
            controller.cycle(controller.now + 0.3)
        lines = b"".join(chunks(data)).count(b"\n")
        assert said[0] == GREETING.encode() + b"\n" and len(said) <= 1 + lines
        assert all(answer.endswith(b"\n") and answer.count(b"\n") == 1 for answer in said)

    return run, [
        joined(b"robotmode\npower off\nsafetystatus\n", b"power on\nbrake release\n"),
        joined(b"load a.urp\nplay\nrunning\npause\n", b"programState\nstop\nget loaded program\n"),
        joined(
            b"unlock protective stop\npopup hi\n", b"PolyscopeVersion\nget serial number\nquit\n"
        ),
    ]


def rdt() -> tuple[Target, list[bytes]]:
    """Records of a Net F/T on the way to the transducer."""
    tracker, clock = records.Tracker(1000.0, 7.0), DeviceClock(7000.0)
    past, runs = Past(), [0]

    def run(data: bytes) -> None:
        for piece in chunks(data):
            runs[0] += 1
            now = 1e-3 * runs[0]
            try:
                batch = records.decode(piece)
            except DriverError:
                assert len(piece) % records.SIZE
                continue
            kept = tracker.take(batch) if len(batch) else batch
            if not len(kept):
                continue
            word = int(np.bitwise_or.reduce(kept["status"]))
            assert bool(records.faults(word)) == bool(word)
            assert np.isfinite(clock.take(now, int(kept["ft"][-1]))).all()
            past.add(np.full(len(kept), now), kept["counts"], kept["status"])
            at = past.at(now)
            assert at is None or (np.isfinite(at.wrench).all() and 0.0 <= at.age < 0.1)

    record = struct.pack(">3I6i", 1, 7, 0, 1, 2, 3, 4, 5, 6)
    after = struct.pack(">3I6i", 2, 14, 0x80020000, -1, 2**31 - 1, -(2**31), 0, 0, 0)
    return run, [joined(record, after), joined(record + after), joined(after, record, b"x")]


def http_server() -> tuple[Target, list[bytes]]:
    """Targets and bodies of web requests on their way to the box."""
    bias = np.zeros(6)
    sensing = SimpleNamespace(
        rate=7000, status=0, newest=bias, bias=bias, range=bias + 65.0, per_si=bias + 1e6,
        set_bias=lambda channel, counts: 0,
    )  # fmt: skip
    pace = Pace(7000.0, 10)
    pages = Pages(BoxSettings(), pace, sensing)

    def run(data: bytes) -> None:
        target, _, body = data.decode("latin-1").partition("\n")
        status, _, text = pages.answer(target, body)
        assert status[:3] in ("200", "400", "404") and len(text) < 16384
        assert 1.0 <= pace.rate <= 7000.0 and 1 <= pace.buffer <= 40

    return run, [
        b"/netftapi2.xml?index=3",
        b"/comm.cgi?comrdtrate=500&comrdtbsiz=4&comrdte=1",
        b"/setting.cgi\nsetbias0=1",
    ]


def socketcand() -> tuple[Target, list[bytes]]:
    """A socketcand client's text on its way to the CAN hub."""

    def run(data: bytes) -> None:
        held = b""
        for piece in chunks(data):
            commands, held, _ = client.split(held + piece)
            assert len(held) <= client.LONGEST
            for command in commands:
                frame = client.frame_of(command.words)
                assert frame is None or len(frame.data) <= 8

    return run, [
        joined(b"< open can0 >< rawmode >"),
        joined(b"< send 123 2 a b >", b"< send 12345678 8 1 2 3 4 5 6 7 ff >"),
    ]


TARGETS: dict[str, Callable[[], tuple[Target, list[bytes]]]] = {
    "rdt": rdt, "http-server": http_server,
    "socketcand": socketcand, "rtde": rtde,
    "script": script, "dashboard": dashboard,
}  # fmt: skip


@pytest.mark.parametrize("name", TARGETS)
def test_random_bytes_and_changed_messages_raise_named_errors_only(name):
    run, seeds = TARGETS[name]()
    changes = st.lists(st.tuples(st.integers(0, 299), st.integers(0, 255)), max_size=3)

    @settings(deadline=None, max_examples=250)
    @given(st.sampled_from(seeds) | st.binary(max_size=300), changes, st.integers(0, 300))
    def feed(data, changed, length):
        message = bytearray(data or b"x")
        for at, byte in changed:
            message[at % len(message) : at % len(message) + 1] = [byte]
        run(bytes(message[: length or len(message)]))

    feed()


FILES = LOGS | SETTINGS
ROUNDS = 40


@pytest.mark.sampled
@pytest.mark.parametrize("name", FILES)
def test_mutated_files_are_read_right_or_refused_by_name(name):
    target = FILES[name]()
    dice = random.Random(f"short {name}")
    with closing(Runner(target)) as runner:
        for _ in range(ROUNDS):
            runner.run(*mutated(target, dice))
        assert runner.accepted + runner.refused == ROUNDS
        assert runner.refused or name == "sealed"  # whose readers answer instead of raising
        for data in corpus(name):
            runner(data)
