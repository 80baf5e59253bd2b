"""What comes off the wire of a Net F/T: any bytes are taken or refused by name."""

import contextlib
import socket
import struct
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot_emulators.netft_box import rdt as box
from wrenchbed.errors import DriverError, LinkError
from wrenchbed.hardware.transducers.netft import rdt
from wrenchbed.hardware.transducers.netft import transducer as configuration
from wrenchbed.hardware.transducers.netft.rdt import (
    SATURATED,
    DeviceClock,
    Received,
    Tracker,
    broken,
    faults,
)
from wrenchbed.hardware.transducers.netft.transducer import _restarted

WEEK_S = 7 * 86400.0
PAGE = """<?xml version="1.0" encoding="UTF-8"?>
<netft><runstat>00000000</runstat><runrate>7000</runrate><setbias>0;0;0;0;0;0</setbias>
<scfgfu>N</scfgfu><scfgtu>Nm</scfgtu><cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt>
<cfgmr>65;65;200;5;5;5</cfgmr>
<comrdte>Enabled</comrdte><comrdtrate>7000</comrdtrate><comrdtbsiz>1</comrdtbsiz></netft>
"""


def parse(text):
    return configuration.parse(text.encode())


def swapped(name, value):
    start, end = PAGE.index(f"<{name}>") + len(name) + 2, PAGE.index(f"</{name}>")
    return PAGE[:start] + value + PAGE[end:]


def test_a_box_knows_six_commands_and_a_datagram_is_records():
    known = [c for c in range(65536) if box.parse(struct.pack(">HHI", 0x1234, c, 7))]
    assert known == [0x0000, 0x0002, 0x0003, 0x0004, 0x0041, 0x0042]
    assert box.parse(struct.pack(">HHI", 0x1235, 2, 0)) is None and box.parse(b"") is None
    for n in range(4):
        assert rdt.decode(bytes(36 * n))["counts"].shape == (n, 6)
        with pytest.raises(DriverError, match="no whole number"):
            rdt.decode(bytes(36 * n + 1))


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**40),
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(-(2**31), 2**31 - 1), min_size=6, max_size=6),
)
def test_what_the_box_packs_the_client_reads(first, ft, status, counts):
    packed = box.pack(first, np.array([ft, ft + 7]), np.array([status] * 2), [counts] * 2)
    both = rdt.decode(packed)
    assert both[0].tolist()[:3] == (first, ft % 2**32, status)
    assert both["counts"].tolist() == [counts] * 2
    assert both[1].tolist()[:2] == ((first + 1) % 2**32, (ft + 7) % 2**32)


@pytest.mark.parametrize(
    ("name", "unit", "si"),
    [("scfgfu", "N", 1), ("scfgfu", "klbf", 4448.22161526), ("scfgfu", "kgf", 9.80665),
     ("scfgtu", "N·m", 1), ("scfgtu", "N-mm", 1e-3), ("scfgtu", "lbf-ft", 1.3558179483314)],
)  # fmt: skip
def test_units_become_si(name, unit, si):
    channels = slice(3) if name == "scfgfu" else slice(3, 6)
    assert parse(swapped(name, unit)).per_si[channels] == pytest.approx(1e6 / si)


@pytest.mark.parametrize(
    ("name", "value"),
    [("scfgfu", "stone"), ("scfgtu", "N"), ("cfgcpt", "-1"), ("cfgcpf", "1e999"),
     ("comrdtrate", "fast")],
)  # fmt: skip
def test_impossible_fields_are_refused_by_name(name, value):
    with pytest.raises(DriverError, match=f"<{name}>"):
        parse(swapped(name, value))


def test_pages_with_entities_are_refused_and_status_words_read():
    bomb = '<!DOCTYPE a [<!ENTITY b "cc">]><netft>&b;</netft>'
    with pytest.raises(DriverError, match="entities"):
        parse(bomb)
    with pytest.raises(DriverError, match="malformed"):
        parse("<netft><cfgcpf>1</netft>")
    with pytest.raises(DriverError, match="more than"):
        parse("x" * 70000)
    assert faults(0x80020000) == ("transducer saturated or converter error",)
    assert SATURATED == 0x20000 and not broken(0x80020000) and not broken(0x80010000)
    assert broken(0x80000000) and broken(0x80020004) and not broken(0)
    assert faults(0x80008004) == ("temperature error", "unknown bits 0x00008000")


@pytest.mark.parametrize(
    ("answer", "error", "why"),
    [(b"HTTP/1.0 200 OK\r\nContent-Length: 3\r\n\r\nabcde", None, ""),
     (b"HTTP/1.0 200 OK\r\nContent-Length: 5\r\n\r\nabc", LinkError, "broke off after 3"),
     (b"220 ready\r\n\r\n", DriverError, "answers no HTTP"),
     (b"HTTP/1.0 404 Not Found\r\n\r\n", DriverError, "'404 Not Found': is this a Net F/T"),
     (b"HTTP/1.0 200 OK\r\n\r\n" + b"x" * 70_000, DriverError, "more than 65536 bytes")],
)  # fmt: skip
def test_an_answer_is_a_page_or_refused(answer, error, why):
    def serve():
        link, _ = listener.accept()
        with link:
            link.recv(1000)
            link.sendall(answer)

    with socket.create_server(("127.0.3.46", 0)) as listener:
        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(error, match=why) if error else contextlib.nullcontext():
            assert configuration.get(*listener.getsockname(), "/netftapi2.xml") == b"abc"


def rows(*pairs):
    packed = b"".join(struct.pack(">3I6i", *pair, 0, *(0,) * 6) for pair in pairs)
    return rdt.decode(packed)


@settings(deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.sampled_from("....dxs"), min_size=4, max_size=300),
    st.integers(1, 9),
)
def test_losses_and_disorder_are_counted_exactly(start, fates, batch):
    """Fates: . sent, d dropped, x doubled, s sent after the next one."""
    fates = [".", *fates, ".", "."]
    sent, held, dropped, doubled, late = [], None, 0, 0, 0
    for k, fate in enumerate(fates):
        pair = ((start + 1 + k) % 2**32, 7 * k)
        if fate == "d":
            dropped += 1
            continue
        if fate == "s" and held is None and k < len(fates) - 2:
            held = pair
            continue
        sent += [pair] * (2 if fate == "x" else 1)
        doubled += fate == "x"
        if held is not None:
            sent.append(held)
            late, held = late + 1, None
    tracker = Tracker(7000.0, 7.0)
    tracker.last, tracker._begun, tracker._asked = (start, -7), True, False
    kept = sum(len(tracker.take(rows(*sent[k : k + batch]))) for k in range(0, len(sent), batch))
    assert (tracker.lost, tracker.disordered) == (dropped + late, doubled + late)
    assert kept == len(fates) - dropped - late
    assert tracker.last[0] == (start + len(fates)) % 2**32
    assert tracker.restarts == tracker.implausible == 0


def test_a_lone_wild_record_is_left_out_and_a_new_start_is_believed():
    tracker = Tracker(1000.0, 7.0)
    assert len(tracker.take(rows(*((k, 7 * k) for k in range(1, 200))))) == 199
    assert tracker.take(rows((3_000_000_000, 5), (200, 1400)))["rdt"].tolist() == [200]
    assert (tracker.implausible, tracker.lost) == (1, 0)
    tracker.asked()
    assert len(tracker.take(rows((1, 1470), (2, 1477)))) == 2
    assert (tracker.restarts, tracker.lost) == (0, 9)
    assert len(tracker.take(rows(*((k, 1470 + 7 * k) for k in range(3, 500))))) == 497
    tracker.asked()
    tracker.take(rows((1, 7), (2, 14)))
    assert (tracker.restarts, tracker.lost) == (1, 9)


def test_device_clocks_are_unwrapped_measured_and_tell_what_was_held_up():
    clock = DeviceClock(7000.0)
    start = 2**32 - 7000
    for k in range(5000):
        t, late = k * 1e-3, 2e-4 * (k % 7)
        device, _ = clock.take(50.0 + t + late, round(start + 7000 * 1.0002 * t) % 2**32)
    assert device == pytest.approx(start / 7000 + 4.999 * 1.0002, abs=1e-3)
    assert clock.ppm == pytest.approx(200.0, abs=30.0)
    # A millisecond's records in time, then 30 ms of them at once, then in time again.
    clock, late = DeviceClock(7000.0), []
    for k in range(3000):
        t = 80.0 + k * 1e-3
        arrived = max(t, 82.030) if t > 82.0 - 1e-9 else t
        late.append(clock.take(arrived + 3e-4, (2**32 - 7000 + 7 * k) % 2**32)[1] - t)
    assert np.ptp(late) < 1e-6
    slow = DeviceClock(7000.0)
    for k in range(60_000):
        t = 5.0 + k * 1e-3
        assert 0.0 <= t - slow.take(t, round(7000 * (1 - 1e-4) * k * 1e-3))[1] < 4e-4
    leapt, late = DeviceClock(7000.0), []
    for k in range(10_000):
        t = 5.0 + k * 1e-3 + (1.5 if k >= 3000 else 0.0)
        late.append(t - leapt.take(t, 7 * k)[1])
    assert max(late) <= 0.1 + 1e-9 and max(late[8500:]) < 1e-6
    assert leapt.take(40.0, 1)[1] == 40.0


@pytest.mark.parametrize(
    ("last", "seconds", "first", "restarted"),
    [
        (7000, 1.0, 14_000, False),
        (7000, 1.0, 12_000, False),  # read late
        (7000, 1.0, 350, True),
        (7000, 60.0, 8000, True),  # on for 1.1 s, longer than before it was switched off
        (2**32 - 3500, 1.0, 3500, False),  # the count turned over
        (7000, WEEK_S, (7000 + round(7000 * WEEK_S * (1 + 1e-4))) % 2**32, False),
        (7000, WEEK_S, 7000 * 3600, True),
        (7000, WEEK_S / 2 + 3600.0, (7000 + round(7000 * (WEEK_S / 2 + 3600.0))) % 2**32, False),
    ],
)
def test_a_restart_is_told_by_the_count_and_the_time(last, seconds, first, restarted):
    def seen(t, ft):
        return Received(t, ft / 7000.0, ft, 0, np.zeros(6), t, 1)

    assert _restarted(seen(50.0, last), seen(50.0 + seconds, first), 7000.0) is restarted
