"""Targets of scripts/fuzz at the UR5's emulator: what its clients send, and what comes of it."""

import contextlib
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

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
    from robot_emulators.ur import packets
    from robot_emulators.ur.inputs import Inputs
    from robot_emulators.ur.rtde import Offer, RtdeSession

    version = (5, 11, 0, 1)
    outputs = packets.outputs(version)
    values = {name: packets.zero(kind) for name, kind in outputs.items()}
    inputs = Inputs(packets.inputs(version), lambda written: None)
    offer = Offer(version, 500.0, outputs, inputs)

    def run(data: bytes) -> None:
        sent: list[bytes] = []
        session = RtdeSession(offer, sent.append)
        for piece in chunks(data):
            if not session.receive(piece, 1.0):
                break
            assert session.held < 65536
            if session.due():
                packet = session.data(values)
                assert struct.unpack_from(">H", packet)[0] == len(packet)
        session.end()
        for packet in sent:
            assert struct.unpack_from(">H", packet)[0] == len(packet)
        assert not inputs._owners

    names = b"timestamp,actual_q,actual_TCP_force,robot_mode"
    opening = packets.packet(packets.VERSION, b"\0\2") + packets.packet(packets.CONTROLLER)
    recipe = packets.packet(packets.OUTPUTS, struct.pack(">d", 125.0) + names)
    written = packets.packet(packets.INPUTS, b"input_int_register_0,input_double_register_1")
    value = packets.packet(packets.DATA, b"\1" + struct.pack(">id", 5, 0.5))
    return run, [
        joined(opening, recipe, packets.packet(packets.START), packets.packet(packets.PAUSE)),
        joined(opening, written, value, value),
        joined(packets.packet(packets.OUTPUTS, names), packets.packet(packets.START), b"\0\2"),
    ]


def script() -> tuple[Target, list[bytes]]:
    """Programs on their way to the controller: each is translated, or says why not."""
    from robot_emulators.ur.controller import functions
    from robot_emulators.ur.script import Collector
    from robot_emulators.ur.urscript.machine import compiled
    from robot_emulators.ur.urscript.values import ScriptFaultError

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
    from robot_emulators.kinematic_plant import kinematic_plant
    from robot_emulators.plant import PlantRequest
    from robot_emulators.ur.controller import Controller
    from robot_emulators.ur.settings import ControllerSettings

    return Controller(ControllerSettings("e"), kinematic_plant(PlantRequest("ur5", 0.008)))


def dashboard() -> tuple[Target, list[bytes]]:
    """Lines on their way to the dashboard: each is answered by one."""
    from robot_emulators.ur.dashboard import GREETING, Dashboard

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


def registers() -> tuple[Target, list[bytes]]:
    """Commands and numbers in input registers, carried out by the controller's program."""
    import warnings

    import numpy as np

    from robot_emulators.ur.outputs import Outputs
    from robot_emulators.ur.packets import Recipe

    controller = _controller()
    outputs, home = Outputs(controller, shared=False), controller.arm.q.copy()
    everything = Recipe(1, list(controller.fields.items()))
    path = f"movej({(home + 0.1).tolist()}, a=2, v=1)\nmovel(p{home.tolist()}, a=1, v=0.2)\n"
    text = (Path(__file__).parent / "rtde_control.script").read_text(encoding="utf-8")
    text = text.replace("# inject move path\n", f"# inject move path\n{path}")
    warnings.simplefilter("ignore", RuntimeWarning)  # a tool a thousand kilometres away overflows

    def write(piece: bytes) -> None:
        """A command, a register that one byte names, and a number in it."""
        command, which, value = struct.unpack_from(">BBd", piece.ljust(10, b"\0"))
        kind, name = (
            ("double", value)
            if which < 128
            else ("int", struct.unpack(">i", piece[2:6].ljust(4, b"\0"))[0])
        )
        number = 1 + which % 24 if kind == "int" else which % 48
        controller.inputs.write({f"input_{kind}_register_{number}": (name,)}, controller.now)
        controller.inputs.write({"input_int_register_0": (command,)}, controller.now)

    def upload() -> None:
        controller.upload([text])
        assert controller._uploaded is None or controller._uploaded.result()
        controller.cycle(controller.now + 0.008)

    def run(data: bytes) -> None:
        controller.reboot()
        upload()
        for piece in chunks(data)[:24]:
            write(piece)
            for _ in range(3):
                controller.cycle(controller.now + 0.008)
            if controller.program is None:
                upload()
        outputs.update(1.0, set(controller.fields))
        everything.pack(controller.values)
        arm = controller.arm
        assert np.isfinite([arm.q, arm.qd]).all() and arm.kinematics.within(arm.q)
        assert (np.abs(arm.qd) <= 1.03 * arm.kinematics.speed).all()

    def give(command: int, which: int = 127, value: float = 0.0) -> bytes:
        return struct.pack(">BBd", command, which, value)

    move = [give(0, k, v) for k, v in enumerate([*(home + 0.1), 1.0, 2.0])]
    pose = [give(0, k, v) for k, v in enumerate([0.4, -0.1, 0.4, 3.1, 0.0, 0.0, 0.2, 1.0])]
    return run, [
        joined(*move, give(1), give(0), give(45), give(0), give(34)),
        joined(*pose, give(3), give(0), give(24), give(16), give(30), give(12), give(16)),
        joined(give(29, 2, 0.1), give(0), give(17, 0, 0.5), give(0), give(59, 1, 9.0), give(65)),
        joined(give(9, 0, 0.1), give(15), give(0), give(10, 2, 0.05), give(42), give(41, 7, 1.0)),
        joined(give(6, 8, 5.0), give(7), give(8), give(25, 2, -1.0), give(62), give(51, 0, 0.1)),
        joined(give(35, 0, 10.0), give(0), give(44), give(39), give(61), give(37), give(31)),
    ]
