"""NETCANOEM frames by hand from the manual's table, the pairing of gauges, and the twin's board."""

import struct
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_emulators.can_bus import Frame
from robot_emulators.medrue.gauge_board import BoardEmulator
from wrenchbed import registry
from wrenchbed.errors import DriverError
from wrenchbed.hardware.drivers.can import ati_gauge_board as reader
from wrenchbed.hardware.drivers.can.ati_gauge_board import in_si
from wrenchbed.hardware.drivers.can.netcanoem_frames import PATIENCE_S, Pairs, Reply, faults, parse

EVEN = Reply(0, (0, 1, 3, 5))
ODD = Reply(1, (2, 4, 6))


@pytest.mark.parametrize(
    "can_id, raw, reply",
    [
        (0x680, "8010 0001 ffff 7fff", (0, (0x8010, 1, -1, 32767))),
        (0x681, "8000 0100 fffe", (1, (-32768, 256, -2))),
        (0x682, "3f800000 c0000000", (2, (1.0, -2.0))),
        (0x684, "42c80000 00000000", (4, (100.0, 0.0))),
        (0x685, "4654313232383800", None),
        (0x686, "02", (6, (2,))),
        (0x687, "000f4240 00989680", (7, (1_000_000, 10_000_000))),
        (0x688, "02 03", (8, (2, 3))),
        (0x689, "0800", None),
        (0x680, "", None),
        (0x681, "8000 0100 fffe 0000", None),
        (0x690, "8010 0001 ffff 7fff", None),
        (0x200, "8010 0001 ffff 7fff", None),
    ],
)
def test_frames_by_hand(can_id, raw, reply):
    assert parse(can_id, bytes.fromhex(raw), 0x68) == reply


def test_pairs_are_put_together_in_order_and_never_of_two_requests():
    pairs = Pairs()
    assert pairs.poll(0.0)
    assert pairs.take(0.001, EVEN) is None
    assert pairs.take(0.0011, ODD).gauges == (1, 2, 3, 4, 5, 6)
    assert (pairs.lost, pairs.odd) == (0, 0)
    assert pairs.poll(0.004)
    assert pairs.take(0.005, ODD) is None and pairs.take(0.0051, EVEN) is None
    assert pairs.odd == 1
    pairs = Pairs()
    pairs.poll(0.0)
    pairs.take(0.001, EVEN)
    assert not pairs.poll(0.004)  # waits for the rest
    assert not pairs.poll(PATIENCE_S + 0.005)  # gives up, and is quiet for a turn
    assert pairs.take(PATIENCE_S + 0.006, ODD) is None  # late, thrown away
    assert pairs.poll(PATIENCE_S + 0.009)
    assert pairs.take(PATIENCE_S + 0.010, Reply(1, (9, 9, 9))) is None
    assert pairs.lost == 1 and pairs.odd == 2


@given(st.lists(st.tuples(st.sampled_from(["poll", "even", "odd", "lose"]), st.integers(0, 40))))
def test_no_order_of_frames_mixes_requests(events):
    """Each request's frames carry its number; whatever is lost, swapped or late by less than the
    patience, a reading never holds two numbers."""
    pairs, t, number = Pairs(), 0.0, 0
    pending: list[tuple[int, str]] = []
    for kind, wait in events:
        t += wait * 1e-4
        if kind == "poll":
            before = pairs.lost
            if pairs.poll(t):
                number += 1
                pending = [(number, "even"), (number, "odd")]
            elif pairs.lost > before:
                pending = []
        elif kind == "lose":
            pending = pending[1:]
        else:
            for frame in [p for p in pending if p[1] == kind][:1]:
                pending.remove(frame)
                value = (frame[0],) * 3
                made = Reply(0, (0, *value)) if kind == "even" else Reply(1, value)
                reading = pairs.take(t, made)
                assert reading is None or len(set(reading.gauges)) == 1


def test_more_answers_than_requests_are_a_clash_and_late_ones_are_not():
    pairs = Pairs()
    for k in range(3):
        pairs.poll(0.01 * k)
        for _ in range(2):
            pairs.take(0.01 * k + 0.001, EVEN)
            pairs.take(0.01 * k + 0.001, ODD)
    assert pairs.clash(0.03) and not pairs.clash(3.0)
    late = Pairs()
    polls = sum(late.poll(0.03 * k) for k in range(40))
    for k in range(polls):
        late.take(1.3 + 1e-4 * k, EVEN)
    assert not late.clash(1.4)


def board(slot=2, base=0x68):
    sent: list[Frame] = []
    load = np.array([3.0, -2.0, 10.0, 0.05, -0.04, 0.1])
    matrix = registry.load("sensors", "ati-mini40").gauges
    one = BoardEmulator(sent.append, base, slot, 1_000_000, lambda t: load, matrix)
    return one, sent, load


def ask(one, sent, opcode, data=b"", t=1.0):
    sent.clear()
    one.hear(t, Frame(one.base << 4 | opcode, data))
    return [(frame.can_id & 0xF, frame.data) for frame in sent]


def test_the_boards_answers_and_status_words_by_hand():
    one, sent, _ = board()
    assert ask(one, sent, 0x6, b"\x02") == [(6, b"\x02")]
    assert ask(one, sent, 0x7) == [(7, bytes.fromhex("000f4240000f4240"))]
    assert ask(one, sent, 0x8) == [(8, b"\x02\x03")]
    assert [op for op, _ in ask(one, sent, 0x2, b"\x00")] == [2, 3, 4]
    assert [len(data) for _, data in ask(one, sent, 0x0)] == [8, 6]
    assert ask(one, sent, 0x2, b"\x06") == [] and ask(one, sent, 0x2) == []
    ask(one, sent, 0x6, b"\x05")
    (_, first), _ = ask(one, sent, 0x0)
    assert struct.unpack_from(">H", first)[0] == 0x8040
    assert faults(0x8000 | 1 << 4 | 1 << 11) == ("supply high", "temperature high")
    assert faults(0x8000) == ("error without a name",) and faults(0) == ()


class Late:
    """A link to a board whose answers come late by more than a question is waited for."""

    def __init__(self, late):
        self._board, self._sent, _ = board()
        self._late, self._asked = late, 0

    def send(self, can_id, data):
        self._asked += 1
        if self._asked in self._late and self._late[0] == 3:  # a piece of a row before this one
            return [self.hand_on(op, bytes(8)) for op in (2, 2, 3)]
        replies = ask(self._board, self._sent, can_id & 0xF, data)
        wait = 0.08 if self._asked in self._late else 0.0
        threading.Timer(wait, lambda: [self.hand_on(op, raw) for op, raw in replies]).start()

    def hand_on(self, op, raw):
        self.one.take(parse(0x680 | op, raw, 0x68))


@pytest.mark.parametrize("late", [(), (9, 13), (4, 5, 6), (3,)])
def test_late_answers_never_make_a_wrong_matrix(monkeypatch, late):
    monkeypatch.setattr(reader, "ANSWER_S", 0.05)
    link = Late(late)
    link.one = reader.BoardQueries(link, 0x68)
    found = link.one.calibrate(2)
    assert np.array_equal(found.raw, link._board.matrix().astype(float))


@pytest.mark.parametrize("units, scale", [((2, 3), 1.0), ((4, 6), 1e3), ((1, 3), 4.4482216)])
def test_units_become_si(units, scale):
    matrix = in_si(np.eye(6) * 5.0, (10, 10), units, 0)
    assert matrix[0, 0] == pytest.approx(0.5 * scale, rel=1e-6)


@pytest.mark.parametrize(
    "raw, counts, units, named",
    [(np.full((6, 6), np.nan), (1, 1), (2, 3), "no usable matrix"),
     (np.eye(6), (0, 1), (2, 3), "0 counts"),
     (np.eye(6), (1, 1), (9, 3), "units 9 and 3")],
)  # fmt: skip
def test_a_calibration_that_makes_no_sense_is_refused(raw, counts, units, named):
    with pytest.raises(DriverError, match=named):
        in_si(raw, counts, units, 0)
