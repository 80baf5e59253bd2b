"""Targets that feed bytes to whatever reads a wire: drivers, transducers and emulators.

A target is a function that raises on a broken promise or on an error that is not a named one, and
its seeds: valid messages that a test cuts and changes.
"""

import struct
from collections.abc import Callable
from types import SimpleNamespace

import ur5_fuzz
from ur5_fuzz import Target, chunks, joined


def rdt() -> tuple[Target, list[bytes]]:
    """Records of a Net F/T on the way to the transducer."""
    import numpy as np

    from wrenchbed.errors import DriverError
    from wrenchbed.hardware.transducers.netft import rdt as records
    from wrenchbed.hardware.transducers.netft.rdt import DeviceClock, History

    tracker, clock = records.Tracker(1000.0, 7.0), DeviceClock(7000.0)
    history, runs = History(1.5, 1e-3), [0]

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
            for table in records.TABLES.values():
                word = int(np.bitwise_or.reduce(kept["status"]))
                assert bool(table.faults(word)) == bool(word)
            assert np.isfinite(clock.take(now, int(kept["ft"][-1]))).all()
            history.add(now, kept)
            at = history.at(now)
            assert at is None or (np.isfinite(at.counts).all() and 0.0 <= at.age < 0.1)

    record = struct.pack(">3I6i", 1, 7, 0, 1, 2, 3, 4, 5, 6)
    after = struct.pack(">3I6i", 2, 14, 0x80020000, -1, 2**31 - 1, -(2**31), 0, 0, 0)
    return run, [joined(record, after), joined(record + after), joined(after, record, b"x")]


def rdt_server() -> tuple[Target, list[bytes]]:
    """Requests on their way to the box, and records that it makes of any numbers."""
    import numpy as np

    from robot_emulators.netft_box import rdt as records

    def run(data: bytes) -> None:
        request = records.parse(data)
        if request is not None:
            assert data == struct.pack(">HHI", 0x1234, *request)
        if len(data) >= 8:
            first, ft = struct.unpack_from(">II", data)
            n = len(data) % 5
            words = np.full(n, ft, dtype=np.int64)
            packed = records.pack(first, words, words, np.zeros((n, 6)))
            assert len(packed) == 36 * n

    commands = (0, 2, 3, 4, 0x41, 0x42, 0x77)
    return run, [struct.pack(">HHI", 0x1234, c, 5) for c in commands]


def http_server() -> tuple[Target, list[bytes]]:
    """Targets and bodies of web requests on their way to the box."""
    import numpy as np

    from robot_emulators.netft_box.pages import Pages
    from robot_emulators.netft_box.rdt import Pace
    from robot_emulators.netft_box.sensing import BoxSettings

    bias = np.zeros(6)
    sensing = SimpleNamespace(
        rate=7000, status=0, newest=bias, bias=bias, range=bias + 65.0,
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


def xml() -> tuple[Target, list[bytes]]:
    """A web page on its way to the transducer."""
    import numpy as np

    from wrenchbed.errors import DriverError
    from wrenchbed.hardware.transducers.netft import configuration

    def run(data: bytes) -> None:
        try:
            said = configuration.parse(data, 7000.0)
        except DriverError as error:
            assert len(str(error)) < 400
        else:
            assert np.isfinite(said.per_si).all() and (said.per_si > 0.0).all()

    fields = {
        "runstat": "0", "runrate": "7000", "scfgfu": "N", "scfgtu": "lbf-in", "cfgcpf": "1000000",
        "cfgcpt": "1e6", "cfgmr": "65;65;200;5;5;5", "comrdte": "Enabled", "comrdtrate": "7000",
    }  # fmt: skip
    page = "".join(f"<{k}>{v}</{k}>" for k, v in fields.items()).encode()
    page = b'<?xml version="1.0" encoding="UTF-8"?><netft>' + page + b"</netft>"
    return run, [page, b"<!DOCTYPE a><a/>"]


def netcanoem() -> tuple[Target, list[bytes]]:
    """CAN frames on their way to the NETCANOEM transducer."""
    from wrenchbed.hardware.drivers.can import frames
    from wrenchbed.hardware.drivers.can.frames import Pairs

    pairs, base = Pairs(), 0x6A
    polls = [0]

    def run(data: bytes) -> None:
        for piece in chunks(data):
            polls[0] += 1
            if len(piece) < 2 or piece[0] & 0x80:
                pairs.poll(1e-4 * polls[0])
                continue
            arbitration = struct.unpack_from(">H", piece)[0] % 0x800
            reply = frames.parse(arbitration, piece[2:10], base)
            if reply is not None and reply.opcode in (frames.GAUGES, frames.ODD):
                reading = pairs.take(1e-4 * polls[0], reply)
                assert reading is None or len(reading.gauges) == 6
                pairs.clash(1e-4 * polls[0])
            if reply is not None and reply.opcode == frames.GAUGES:
                status = reply.values[0]
                named = [k for k in range(15) if frames.STATUS[k] and status >> k & 1]
                assert len(frames.faults(status)) == max(len(named), status >> 15 & 1)

    def frame(opcode: int, payload: bytes) -> bytes:
        return struct.pack(">H", base << 4 | opcode) + payload

    even = frame(0, struct.pack(">Hhhh", 0x8002, 1, -2, 32767))
    odd = frame(1, struct.pack(">hhh", 4, 5, -32768))
    more = [frame(2, bytes(8)), frame(5, b"FT12345\0"), frame(6, b"\1"), frame(7, bytes(8)),
            frame(8, b"\2\3"), frame(15, b"\3\7\0\1")]  # fmt: skip
    return run, [joined(b"\x80", even, odd), joined(even, b"\x80", odd), joined(*more)]


def socketcand() -> tuple[Target, list[bytes]]:
    """A socketcand client's text on its way to the CAN hub."""
    from robot_emulators.can_bus import socketcand as client

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
    "rdt": rdt, "rdt-server": rdt_server, "http-server": http_server, "xml": xml,
    "netcanoem": netcanoem, "socketcand": socketcand, "rtde": ur5_fuzz.rtde,
    "script": ur5_fuzz.script, "dashboard": ur5_fuzz.dashboard, "registers": ur5_fuzz.registers,
}  # fmt: skip
