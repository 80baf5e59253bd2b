"""Frames of serial sensors: however the stream is cut, and whatever lies between good frames."""

import struct
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robot_emulators.serial_sensors import bota as emulated_bota
from robot_emulators.serial_sensors import robotiq_ft300 as emulated_robotiq
from wrenchbed.errors import DriverError
from wrenchbed.hardware.transducers.bota import frames
from wrenchbed.hardware.transducers.robotiq_ft300 import modbus, packets
from wrenchbed.hardware.transducers.serial_line.checksums import crc16_modbus, crc16_x25
from wrenchbed.hardware.transducers.serial_line.framing import Framer, FrameShape

COUNTS = st.lists(st.integers(-(2**15), 2**15 - 1), min_size=6, max_size=6)


def robotiq(counts) -> bytes:
    """A packet as the emulator's own code makes it."""
    packet = struct.pack("<2B6h", 0x20, 0x4E, *counts)
    return packet + emulated_robotiq.check(packet)


def bota(values) -> bytes:
    """A frame as the emulator's own code makes it."""
    status, stamp, *numbers = values
    data = struct.pack("<H6fIf", status, *numbers, stamp, 25.0)
    return b"\xaa" + data + emulated_bota.check(data)


FLOATS = st.floats(allow_nan=False, width=32)
VALUES = st.tuples(st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1), *[FLOATS] * 6)
SHAPES = {
    "robotiq": (packets.SHAPE, COUNTS.map(robotiq)),
    "bota": (frames.SHAPE, VALUES.map(bota)),
}
each_shape = pytest.mark.parametrize("name", SHAPES)


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    """Bytes cut at places, modulo their number."""
    places = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in pairwise(places)]


def fed(shape: FrameShape, parts) -> tuple[list[bytes], Framer]:
    framer = Framer(shape)
    return [frame for part in parts for frame in framer.feed(part)], framer


def test_published_values_of_both_checks():
    assert crc16_modbus(b"123456789") == 0x4B37
    assert crc16_x25(b"123456789") == 0x906E
    assert crc16_modbus(b"") == 0xFFFF and crc16_x25(b"") == 0x0000


def test_the_check_of_a_published_modbus_request():
    # Modbus over Serial Line 1.02, appendix B: slave 2, function 7, CRC 0x1241, low byte first
    assert crc16_modbus(b"\x02\x07") == 0x1241
    assert emulated_robotiq.check(b"\x02\x07") == b"\x41\x12"


@given(st.binary(max_size=80))
def test_two_implementations_of_the_check_agree(data):
    assert emulated_robotiq.check(data) == struct.pack("<H", crc16_modbus(data))
    assert emulated_bota.check(data) == struct.pack("<H", crc16_x25(data))


def test_a_packet_worked_by_hand():
    # 12.34 N, -0.01 N, 300 N, 0.5 N·m, -30 N·m, 0.001 N·m, low byte first
    counts = bytes.fromhex("d204 ffff 3075 f401 d08a 0100")
    packet = b"\x20\x4e" + counts
    packet += struct.pack("<H", crc16_modbus(packet))
    assert packets.holds(packet)
    assert packets.wrench(packet) == pytest.approx([12.34, -0.01, 300.0, 0.5, -30.0, 0.001])


@each_shape
@settings(max_examples=150, deadline=None)
@given(st.data(), st.lists(st.integers(0, 10**6), max_size=30))
def test_any_cut_of_the_stream_gives_the_same_frames(name, data, cuts):
    shape, frame = SHAPES[name]
    stream = b"".join(data.draw(st.lists(st.one_of(frame, st.binary(max_size=20)), max_size=8)))
    whole, at_once = fed(shape, [stream])
    cut, later = fed(shape, pieces(stream, cuts))
    single, bytewise = fed(shape, [stream[k : k + 1] for k in range(len(stream))])
    assert whole == cut == single
    for framer in (later, bytewise):
        assert (framer.skipped, framer.damaged) == (at_once.skipped, at_once.damaged)
    assert at_once.waiting < shape.size
    assert shape.size * at_once.frames + at_once.skipped + at_once.waiting == len(stream)


@each_shape
@settings(max_examples=150, deadline=None)
@given(st.data())
def test_garbage_between_frames_costs_none(name, data):
    shape, frame = SHAPES[name]
    good = data.draw(st.lists(frame, min_size=1, max_size=6))
    header = shape.header
    noise = st.one_of(st.binary(max_size=40), st.just(header), st.just(header * 3), st.just(b""))
    stream = b"".join(part for one in good for part in (data.draw(noise), one))
    found, _ = fed(shape, [stream + bytes(shape.size)])
    rest = iter(found)
    assert all(one in rest for one in good)  # in order; by chance noise may be a frame too


@each_shape
@settings(max_examples=150, deadline=None)
@given(st.data())
def test_a_damaged_frame_costs_only_itself(name, data):
    shape, frame = SHAPES[name]
    good = data.draw(st.lists(frame, min_size=3, max_size=6, unique=True))
    which = data.draw(st.integers(1, len(good) - 2))
    at = data.draw(st.integers(0, shape.size - 1))
    how = data.draw(st.sampled_from(["lost", "flipped", "doubled"]))
    broken = bytearray(good[which])
    if how == "lost":
        del broken[at]
    elif how == "flipped":
        broken[at] ^= 1 << data.draw(st.integers(0, 7))
    else:
        broken.insert(at, broken[at])
    stream = b"".join([*good[:which], bytes(broken), *good[which + 1 :]])
    found, framer = fed(shape, [stream])
    wanted = [one for k, one in enumerate(good) if k != which]
    if good[which] in found:  # the byte that was doubled lay at an end of the frame
        wanted = good
    assert found == wanted
    assert framer.damaged == len(good) - len(wanted)


@each_shape
@given(st.data())
def test_header_bytes_inside_data_are_data(name, data):
    shape, _ = SHAPES[name]
    if name == "robotiq":
        (word,) = struct.unpack("<h", shape.header)
        one = robotiq([word] * 6)
    else:
        (number,) = struct.unpack("<f", b"\xaa\xaa\xaa\x2a")
        one = bota([0xAAAA, 0xAAAAAAAA, *[number] * 6])
    stream = one * 5
    begin = data.draw(st.integers(0, shape.size - 1))
    found, framer = fed(shape, [stream[begin:]])
    assert found == [one] * (5 if begin == 0 else 4)
    assert framer.damaged == 0


@given(st.binary(max_size=300))
def test_the_emulated_slave_takes_any_bytes(data):
    requests, held = emulated_robotiq.split(data)
    assert all(len(request) >= 8 and request[0] == 9 for request in requests)
    assert len(held) <= 256


@given(st.binary(max_size=6), st.integers(0, 600), st.integers(1, 20))
@example(b"\xff" * 6, 500, 3)
def test_the_emulated_slave_finds_a_request_behind_a_few_bytes(before, first, count):
    request = struct.pack(">BBHH", 9, 3, first, count)
    request += struct.pack("<H", crc16_modbus(request))
    requests, _ = emulated_robotiq.split(before + request)
    assert request in requests


def test_firmware_and_serial_as_the_maker_writes_them():
    assert modbus.version((0x4654, 0x5302, 0x0107)) == "FTS-2.1.7"
    assert modbus.text((0x4654, 0x5300, 0x04D2, 0x0001)) == "FTS-66770"
    assert modbus.text((0, 0, 0, 0)) == ""
    with pytest.raises(DriverError, match="not that of an FT sensor"):
        modbus.version((0x4142, 0, 0))


def test_a_frame_worked_by_hand():
    # status 2; 1, -2, 0.5, 0, 0.25, -1.5; 1 s; 25 °C: IEEE 754, low byte first
    data = bytes.fromhex(
        "0200 0000803f 000000c0 0000003f 00000000 0000803e 0000c0bf 40420f00 0000c841"
    )
    frame = b"\xaa" + data + struct.pack("<H", crc16_x25(data))
    assert len(frame) == frames.SIZE and frames.holds(frame)
    found = frames.decoded(frame)
    assert found.wrench.tolist() == [1.0, -2.0, 0.5, 0.0, 0.25, -1.5]
    assert (found.status, found.stamp) == (2, 1_000_000)
    assert frames.temperature(frame) == 25.0
    assert frames.faults(2) == ("out of range",)
    assert frames.faults(0x8004) == ("readings are invalid", "unknown bits 0x8000")


@given(st.binary(max_size=200))
def test_the_emulated_console_takes_any_bytes(data):
    commands, held = emulated_bota.split(data)
    assert all(command[0] in "fcbCRI#slw" for command in commands)
    assert len(held) <= 64


@given(st.lists(st.integers(1, 12), min_size=1, max_size=40))
def test_the_emulated_console_finds_commands_however_they_are_cut(sizes):
    sent = b"Cc,0,1,0,4f,64,0,0,1R"
    found, held, at = [], b"", 0
    for size in [*sizes, *[1] * len(sent)]:
        commands, held = emulated_bota.split(held + sent[at : at + size])
        found += commands
        at += size
    assert found == ["C", "c,0,1,0,4", "f,64,0,0,1", "R"]


@given(COUNTS)
def test_forces_and_moments_in_si(counts):
    wrench = packets.wrench(robotiq(counts))
    assert wrench == pytest.approx(np.array(counts) / ([100.0] * 3 + [1000.0] * 3))
