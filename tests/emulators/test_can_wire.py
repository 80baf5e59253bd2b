"""The wire model: bits counted by hand and by long division, arbitration, load, error frames."""

import random
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_emulators.can_bus import wire as bits
from robot_emulators.can_bus.hub import NOBODY, Foreign, Hub
from robot_emulators.can_bus.wire import QUEUE, BusArbiter, Frame
from wrenchbed.hardware.drivers.can import options

GENERATOR = 0b1100010110011001
"""x¹⁵ + x¹⁴ + x¹⁰ + x⁸ + x⁷ + x⁴ + x³ + 1, ISO 11898-1."""


def divided(header: int) -> int:
    """Remainder of the header, moved up by 15, in long division."""
    rest = header << 15
    while rest.bit_length() > 15:
        rest ^= GENERATOR << (rest.bit_length() - 16)
    return rest


def counted(can_id: int, data: bytes, extended: bool) -> int:
    """Bits of a frame, written out as text."""
    if extended:
        text = f"0{can_id >> 18:011b}11{can_id & 0x3FFFF:018b}000{len(data):04b}"
    else:
        text = f"0{can_id:011b}000{len(data):04b}"
    text += "".join(f"{byte:08b}" for byte in data)
    text += f"{divided(int(text, 2)):015b}"
    stuffed = ""
    for bit in text:
        stuffed += bit
        if stuffed[-5:] in ("00000", "11111"):
            stuffed += "1" if bit == "0" else "0"
    return len(stuffed) + 13


def test_a_frame_of_zeros_has_a_stuff_bit_after_every_five():
    # 34 zeros from start of frame to the end of the CRC: 6 stuff bits, then 10 + 3 bits
    assert bits.exact(0x000, b"") == 34 + 6 + 13


@given(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.booleans())
def test_exact_bits_are_those_of_the_frame_written_out(can_id, data, extended):
    can_id = can_id if extended else can_id & 0x7FF
    exact = bits.exact(can_id, data, extended)
    assert exact == counted(can_id, data, extended)
    if not extended:
        assert 47 + 8 * len(data) <= exact <= options.worst_bits(len(data))


def test_modelled_load_of_six_drives_and_the_sensor_by_hand():
    worst = 55 + 305 + 6 * (115 + 135)
    load = options.bus_load(250.0, 1_000_000, torque=True)
    assert load == pytest.approx((worst * 250 + 7 * 10 * 65) / 1e6)


def test_the_lowest_id_goes_first_where_several_wait():
    wire = BusArbiter(1_000_000)
    wire.offer(0.0, 1, Frame(0x700, b""))
    for sender, can_id in ((2, 0x301), (3, 0x181), (4, 0x0FF)):
        wire.offer(1e-5, sender, Frame(can_id, b""))
    assert Frame(0x0FF, b"").rank < Frame(0x100, b"").rank <= Frame(0x100 << 18, b"", True).rank
    order = [wire.transmit(1.0).frame.can_id for _ in range(4)]
    assert order == [0x700, 0x0FF, 0x181, 0x301]  # the first was alone when it began
    assert wire.transmit(1.0) is None


def test_a_frame_that_comes_after_the_wire_was_taken_waits_its_turn():
    wire = BusArbiter(500_000)
    wire.offer(0.0, 1, Frame(0x600, bytes(8)))
    wire.offer(0.0, 1, Frame(0x001, b""))  # behind its own sender's first
    wire.offer(1e-6, 2, Frame(0x100, b""))
    sent = [wire.transmit(1.0) for _ in range(3)]
    assert [s.frame.can_id for s in sent] == [0x600, 0x001, 0x100]
    ends, total = [s.end for s in sent], 0
    for s, end in zip(sent, ends, strict=True):
        total += s.frame.bits
        assert end == pytest.approx(total / 500_000)


def test_an_error_frame_costs_bits_and_the_frame_is_repeated():
    wire, frame = BusArbiter(1_000_000), Frame(0x123, bytes(8))
    wire.spoil(2)
    wire.offer(0.0, 1, frame)
    sent = [wire.transmit(1.0) for _ in range(3)]
    assert [s.spoiled for s in sent] == [True, True, False]
    wasted = 2 * (frame.bits // 2 + bits.ERROR_BITS)
    assert sent[-1].end == pytest.approx((wasted + frame.bits) / 1e6)


def test_a_sender_may_have_only_so_many_frames_waiting():
    wire = BusArbiter(1000)
    for _ in range(QUEUE + 7):
        wire.offer(0.0, 1, Frame(0x123, b""))
    assert wire.dropped == 7


def test_foreign_traffic_starves_higher_ids():
    wire, foreign = BusArbiter(1_000_000), Foreign()
    foreign.start(0.0, 0.1, 1.0, 1_000_000)
    wire.offer(1e-3, 5, Frame(0x181, b""))
    now, others = 0.0, 0
    while now < 0.09:
        now += 1e-4
        foreign.offer(now, wire)
        while (sent := wire.transmit(now)) is not None:
            assert sent.sender == NOBODY
            others += 1
    assert others > 500
    while (sent := wire.transmit(1.0)) is not None:
        last = sent
    assert last.sender == 5


def test_the_hub_lets_frames_take_their_time():
    hub = Hub("127.0.4.1", 0, bitrate=50_000, modelled=True)
    heard: list[tuple[float, int]] = []
    hub.attach(lambda t, frame: heard.append((time.monotonic(), frame.can_id)))
    send = hub.attach().send
    rng = random.Random(1)
    frames = [Frame(0x100 + k, rng.randbytes(8)) for k in range(30)]
    hub.start()
    try:
        begun = time.monotonic()
        for frame in frames:
            send(frame)
        while len(heard) < 30 and time.monotonic() < begun + 3.0:
            time.sleep(0.005)
    finally:
        hub.stop()
    due = sum(frame.bits for frame in frames) / 50_000
    assert [can_id for _, can_id in heard] == [frame.can_id for frame in frames]
    assert due <= heard[-1][0] - begun < due + 0.5
