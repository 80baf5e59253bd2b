"""Packets are kept as they came, within bounds, and drivers read the same from them again."""

import struct
import time

import numpy as np
import pytest
from test_rtde_status import OK, controller, packet, server

from netft_scene import boxed
from wrenchbed.errors import RecordingError
from wrenchbed.hardware.drivers.rtde import identity, outputs
from wrenchbed.hardware.packet_capture.capture import MAGIC, Capture, packets
from wrenchbed.hardware.packet_capture.playback import Playback
from wrenchbed.hardware.transducers.netft import NetftOptions, NetftTransducer, datagrams

assert OK and packet  # the made controller's parts
HOST = "127.0.2.79"


def test_packets_come_back_with_time_direction_and_peer(tmp_path):
    kept = Capture(tmp_path / "raw")
    kept.add("rdt", b"\x01\x02", t=1.5)
    kept.add("http", b"", t=1.6)
    kept.add("rdt", b"ask", sent=True, t=1.7)
    kept.close()
    kept.close()
    found = list(packets(tmp_path / "raw"))
    assert [(p.t, p.peer, p.sent, p.data) for p in found] == [
        (1.5, "rdt", False, b"\x01\x02"), (1.6, "http", False, b""), (1.7, "rdt", True, b"ask"),
    ]  # fmt: skip


def test_files_are_rotated_and_bounded_and_the_first_stays(tmp_path):
    kept = Capture(tmp_path / "raw", file_bytes=1000, most_bytes=5000)
    for k in range(400):
        kept.add("rdt", struct.pack(">I", k) * 10, t=float(k))
    kept.close()
    files = sorted((tmp_path / "raw").glob("*.raw"))
    assert sum(f.stat().st_size for f in files) <= 5000 + 100
    found = [int(p.t) for p in packets(tmp_path / "raw")]
    assert found[0] == 0 and found[-1] == 399 and len(found) < 400
    assert {p.peer for p in packets(tmp_path / "raw")} == {"rdt"}


def test_a_torn_end_is_left_out_and_damage_is_named(tmp_path):
    kept = Capture(tmp_path / "raw")
    kept.add("rdt", b"first", t=1.0)
    kept.add("rdt", b"second", t=2.0)
    kept.close()
    file = tmp_path / "raw" / "000000.raw"
    whole = file.read_bytes()
    file.write_bytes(whole[:-3])
    assert [p.data for p in packets(tmp_path / "raw")] == [b"first"]
    file.write_bytes(b"x" + whole)
    with pytest.raises(RecordingError, match="is no file of packets"):
        list(packets(tmp_path / "raw"))
    file.write_bytes(MAGIC + struct.pack("<dBBI", 1.0, 0, 7, 3) + b"abc")
    with pytest.raises(RecordingError, match="damaged at byte 16"):
        list(packets(tmp_path / "raw"))
    with pytest.raises(RecordingError, match="is not an empty folder"):
        Capture(tmp_path / "raw")
    with pytest.raises(RecordingError, match="holds no packets"):
        list(packets(tmp_path))


def test_a_controller_is_played_again_by_its_own_answers(tmp_path):
    kept = Capture(tmp_path / "raw")
    keep = lambda data, sent: kept.add("rtde", data, sent)  # noqa: E731
    with (
        server(outputs.PORT, controller()),
        outputs.outputs("127.0.2.9", identity.SETTINGS, 1.0, None, keep) as stream,
    ):
        _, real = stream.next(time.monotonic() + 1.0)
    kept.close()
    with Playback(tmp_path / "raw", HOST) as played:
        assert set(played.addresses) == {"rtde"}
        with outputs.outputs(HOST, identity.SETTINGS, 1.0) as stream:
            assert stream.version == (3, 4, 1, 2)
            assert stream.next(time.monotonic() + 1.0)[1] == real
        assert played.done.wait(1.0)
        assert outputs.once(HOST, ["actual_q"], 1.0) == {}  # it was not kept


@pytest.mark.wire
def test_a_box_is_read_again_as_it_was(tmp_path):
    kept = Capture(tmp_path / "raw")
    with boxed("127.0.3.79", rate=1000) as scene:
        port = int(scene.addresses["http"].split(":")[1])
        box = NetftTransducer(NetftOptions("127.0.3.79", http_port=port))
        box.capture = kept
        with box:
            time.sleep(0.5)
            real = box.identity
    kept.close()
    came = [p for p in packets(tmp_path / "raw") if p.peer == "rdt" and not p.sent]
    assert len(came) > 300
    with (
        Playback(tmp_path / "raw", HOST, http_port=18080),
        NetftTransducer(NetftOptions(HOST, http_port=18080)) as again,
    ):
        assert again.identity == real
        time.sleep(0.8)
        sample = again.read()
        last = datagrams.record(came[-1].data, 0)
        assert sample.sequence == last.ft
        assert np.allclose(sample.wrench, np.array(last.counts) / 1e6)
        assert again.health().counters["lost"] == 0
