"""The emulator's RTDE bytes against bytes written by hand, and its parser against anything."""

import struct

import pytest

from robot_emulators.errors import EmulatorError
from robot_emulators.ur import rtde_packets as wire
from robot_emulators.ur.rtde import Inputs, Offer, RtdeSession
from robot_emulators.ur.rtde_packets import inputs, outputs

CB3, E = (3, 15, 8, 106339), (5, 11, 1, 108318)


class Sent(list):
    def take(self) -> bytes:
        said = b"".join(self)
        self.clear()
        return said


def offer(version=CB3, written=lambda values: None) -> Offer:
    return Offer(version, 125.0, outputs(version), Inputs(inputs(version), written))


def session(of: Offer | None = None) -> tuple[RtdeSession, Sent]:
    sent = Sent()
    return RtdeSession(of or offer(), sent.append), sent


def packet(kind: str, payload: bytes = b"") -> bytes:
    return struct.pack(">HB", len(payload) + 3, ord(kind)) + payload


def say(one: tuple[RtdeSession, Sent], data: bytes) -> bytes:
    assert one[0].receive(data, 1.0)
    return one[1].take()


def test_versions_are_negotiated_and_reported():
    one = session()
    assert say(one, bytes.fromhex("0005560002")) == bytes.fromhex("00045601")
    assert say(one, bytes.fromhex("0005560003")) == bytes.fromhex("00045600")
    assert one[0].protocol == 2
    answer = say(one, bytes.fromhex("000376"))
    assert answer == bytes.fromhex("001376000000030000000f0000000800019f63")


def test_an_output_recipe_and_its_data():
    one = session()
    say(one, bytes.fromhex("0005560002"))
    request = packet("O", struct.pack(">d", 125.0) + b"timestamp,robot_mode,payload_cog,")
    assert say(one, request) == b"\x00\x19\x4f" + b"\x01" + b"DOUBLE,INT32,VECTOR3D"
    assert not one[0].due()
    assert say(one, packet("S")) == bytes.fromhex("00045301")
    assert one[0].due()
    values = {"timestamp": (1.5,), "robot_mode": (7,), "payload_cog": (0.0, -2.0, 0.25)}
    assert one[0].data(values) == bytes.fromhex(
        "0028" "55" "01" "3ff8000000000000" "00000007"
        "0000000000000000" "c000000000000000" "3fd0000000000000"
    )  # fmt: skip
    assert say(one, packet("P")) == bytes.fromhex("00045001")
    assert not one[0].due()


def test_recipes_name_unknown_outputs_and_protocol_1_has_neither_frequency_nor_number():
    one = session()
    say(one, bytes.fromhex("0005560002"))
    answer = say(one, packet("O", struct.pack(">d", 125.0) + b"timestamp,nonsense"))
    assert answer == packet("O", b"\x00DOUBLE,NOT_FOUND")
    say(one, packet("S"))
    assert not one[0].due()
    one = session()
    assert say(one, packet("O", b"robot_mode,runtime_state")) == packet("O", b"INT32,UINT32")
    data = one[0].data({"robot_mode": (-1,), "runtime_state": (2,)})
    assert data == bytes.fromhex("000b55ffffffff00000002")


def test_inputs_are_claimed_and_freed():
    shared = offer()
    first, second = session(shared), session(shared)
    ask = packet("I", b"input_int_register_0,input_double_register_3,")
    assert say(first, ask) == packet("I", b"\x01INT32,DOUBLE")
    assert say(first, ask) == packet("I", b"\x02INT32,DOUBLE")
    assert say(second, ask) == packet("I", b"\x00IN_USE,IN_USE")
    answer = say(second, packet("I", b"input_int_register_1,x"))
    assert answer == packet("I", b"\x00INT32,NOT_FOUND")
    first[0].end()
    assert say(second, ask) == packet("I", b"\x01INT32,DOUBLE")


def test_input_data_is_taken_before_start_short_is_dropped_long_is_cut():
    written = []
    one = session(offer(written=written.append))
    say(one, packet("I", b"input_int_register_0,speed_slider_fraction"))
    body = bytes.fromhex("01fffffffe3fe0000000000000")
    expected = {"input_int_register_0": (-2,), "speed_slider_fraction": (0.5,)}
    assert say(one, packet("U", body)) == b""
    assert say(one, packet("U", body + b"more")) == b""
    assert say(one, packet("U", body[:-1])) == b""
    assert say(one, packet("U", b"\x07" + body[1:])) == b""
    assert say(one, packet("U")) == b""
    assert written == [expected, expected]


@pytest.mark.parametrize(
    "asked, packets",
    [(500.0, 125), (125.0, 125), (25.0, 25), (40.0, 40), (0.0, 125), (-1.0, 125),
     (float("nan"), 125), (float("inf"), 125)],
)  # fmt: skip
def test_the_frequency_that_a_client_asks_for(asked, packets):
    one = session()
    say(one, bytes.fromhex("0005560002") + packet("O", struct.pack(">d", asked) + b"timestamp"))
    say(one, packet("S"))
    assert sum(one[0].due() for _ in range(125)) == packets


def test_text_messages_and_series_differ_by_version():
    said = wire.text("hot", "me", 2, version=2)
    assert said == bytes.fromhex("000b4d03") + b"hot" + b"\x02me\x02"
    assert wire.text("hot", "me", 2, version=1) == bytes.fromhex("00074d02") + b"hot"
    assert set(outputs(E)) - set(outputs(CB3)) == {"ft_raw_wrench"}
    assert outputs((3, 10, 0, 0)).keys().isdisjoint({"payload", "payload_cog"})
    assert "input_int_register_24" not in inputs((3, 8, 0, 0))


def test_what_a_client_sends_is_bounded():
    one = session()
    every = packet("O", ",".join(outputs(CB3)).encode())  # as the maker's library asks
    assert say(one, every) == packet("O", ",".join(outputs(CB3).values()).encode())
    long = ",".join(["timestamp"] * 2000).encode()
    assert say(one, packet("O", long)) == packet("O", b"NOT_FOUND")
    assert say(one, packet("I", long)) == packet("I", b"\x00NOT_FOUND")
    one = session()
    for _ in range(300):
        answer = say(one, packet("I", b"input_int_register_0"))
    assert answer == packet("I", b"\x00NOT_FOUND")
    assert len(one[0].inputs) == 255
    with pytest.raises(EmulatorError):
        wire.Splitter().feed(b"\x00\x02\x55")
    assert not session()[0].receive(b"\x00\x00\x00", 1.0)
