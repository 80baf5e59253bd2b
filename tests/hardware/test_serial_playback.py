"""A serial line that was kept is read again as it was."""

import time

import numpy as np
import pytest

from serial_scene import NAMES, on_a_line
from wrenchbed.errors import LinkError
from wrenchbed.hardware.packet_capture.capture import Capture, packets
from wrenchbed.hardware.packet_capture.playback import Playback
from wrenchbed.hardware.transducers.address import transducer_at

pytestmark = pytest.mark.wire
HOST = "127.0.2.81"


def kept(name, folder):
    """A line that is kept for half a second: identity, last reading, frames."""
    capture = Capture(folder)
    with on_a_line(name, "127.0.3.98") as scene:
        sensor = scene.made()
        sensor.capture = capture
        with sensor:
            time.sleep(0.5)
            identity = dict(sensor.identity)
        last = sensor._newest
        readings = sensor._framer.frames
    capture.close()
    return identity, last, readings


@pytest.mark.parametrize("name", NAMES)
def test_a_line_is_read_again_as_it_was(name, tmp_path):
    identity, last, readings = kept(name, tmp_path / "raw")
    assert {packet.peer for packet in packets(tmp_path / "raw")} == {name}
    with Playback(tmp_path / "raw", HOST) as played:
        assert set(played.addresses) == {name}
        for _ in range(2):  # from its beginning each time
            with transducer_at(f"{name}://{played.addresses[name]}") as again:
                assert dict(again.identity) == identity
                assert played.done.wait(3.0)
                time.sleep(0.2)
                assert np.array_equal(again.read().wrench, last.sample.wrench)
                assert again.read().sequence == pytest.approx(readings, abs=2)
                assert again.health().counters["stray bytes"] <= 40
            played.done.clear()


def test_what_was_not_asked_then_is_not_answered(tmp_path):
    kept("bota", tmp_path / "raw")
    with Playback(tmp_path / "raw", HOST) as played:
        other = transducer_at(f"bota://{played.addresses['bota']}?sinc=128")
        with pytest.raises(LinkError, match=r"'f,128,0,0,1'|none of this sensor's"):
            other.connect()
