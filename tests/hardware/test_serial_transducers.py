"""Transducers at a serial port: values, and each fault by a message that names port and remedy."""

import contextlib
import os
import threading
import time
import tty

import numpy as np
import pytest

from netft_scene import until
from robot_emulators.serial_sensors import line
from serial_scene import NAMES, on_a_line
from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware.transducers.address import transducer_at
from wrenchbed.hardware.transducers.serial_line.port import SerialPort

pytestmark = pytest.mark.wire


@pytest.fixture(scope="module", params=NAMES)
def scene(request):
    with on_a_line(request.param, f"127.0.3.{90 + NAMES.index(request.param)}") as found:
        yield found


@pytest.fixture
def transducer(scene):
    with scene.made() as found:
        time.sleep(0.1)
        yield found
    time.sleep(0.05)


@contextlib.contextmanager
def dummy_port(answer: bytes = b"", always: bytes = b""):
    """A serial port behind which somebody answers, talks all the time, or does neither."""
    device, client = os.openpty()
    tty.setraw(client)
    os.set_blocking(device, False)
    ended = threading.Event()

    def talk():
        while not ended.wait(0.01):
            with contextlib.suppress(OSError):
                if os.read(device, 4096):
                    os.write(device, answer)
            with contextlib.suppress(OSError):
                os.write(device, always)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield os.ttyname(client), device
    finally:
        ended.set()
        thread.join()
        os.close(device)
        os.close(client)


def test_readings_are_the_load_in_si(scene, transducer):
    readings = []
    for _ in range(40):
        readings.append(transducer.read().wrench)
        time.sleep(0.01)
    assert np.mean(readings, axis=0) == pytest.approx(scene.load, abs=0.08)
    assert np.abs(scene.load).max() > 5.0


def test_it_says_what_it_is(transducer):
    assert transducer.identity["serial"] and transducer.identity["firmware"]


def test_a_zero_makes_the_present_load_zero(transducer):
    time.sleep(0.2)
    transducer.zero()
    time.sleep(0.1)
    assert np.abs(transducer.read().wrench) == pytest.approx(np.zeros(6), abs=0.6)


def test_damaged_messages_are_counted_and_the_others_are_right(scene, transducer):
    before = transducer.health().counters["damaged"]
    scene.fault("flip", 1.0, share=0.3)
    time.sleep(0.2)
    worst = 0.0
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        worst = max(worst, np.abs(transducer.read().wrench - scene.load).max())
        time.sleep(0.005)
    assert worst < 1.5
    counters = transducer.health().counters
    assert counters["damaged"] > before + 5 and counters["lost"] > 5
    until(lambda: transducer.health().ok)


@pytest.mark.parametrize("kind", ["lose", "garbage"])
def test_lost_and_added_bytes_make_no_wrong_reading(scene, transducer, kind):
    scene.fault(kind, 0.8, share=0.02 if kind == "lose" else 0.5)
    end, worst = time.monotonic() + 1.0, 0.0
    while time.monotonic() < end:
        worst = max(worst, np.abs(transducer.read().wrench - scene.load).max())
        time.sleep(0.005)
    assert worst < 1.5
    assert transducer.health().counters["stray bytes"] > 0
    until(lambda: transducer.health().ok)


def test_single_bytes_are_put_together(scene, transducer):
    scene.fault("pieces", 0.5)
    before = transducer.read().sequence
    time.sleep(0.4)
    assert transducer.read().sequence > before + 20
    assert transducer.health().counters["stray bytes"] == 0


def test_a_silent_line_is_stale_then_lost_and_comes_back(scene, transducer):
    scene.fault("stall", 1.3)
    until(lambda: transducer.health().state == "stale")
    until(lambda: transducer.health().state == "lost")
    detail = transducer.health().detail
    assert scene.path in detail and "check its cable and power" in detail
    until(lambda: transducer.health().ok)
    lost = transducer.read().lost
    assert lost * scene.emulator.sensor.period == pytest.approx(1.3, abs=0.2)


def test_a_frozen_stream_is_a_fault(scene, transducer):
    assert transducer.health().ok
    scene.fault("freeze", 2.0)
    took = until(lambda: transducer.health().state == "fault", 1.5)
    assert took > 0.4
    detail = transducer.health().detail
    assert scene.path in detail and "frozen" in detail and "switch it off and on" in detail
    until(lambda: transducer.health().ok, 3.0)


def test_a_channel_at_the_end_of_its_range_is_saturated(scene, transducer):
    scene.fault("saturate", 0.5, channel=1)
    until(lambda: transducer.read().saturated & 2)
    until(lambda: not transducer.read().saturated)


@pytest.fixture(scope="module")
def bota():
    with on_a_line("bota", "127.0.3.95") as found:
        yield found


@pytest.mark.parametrize(
    ("bits", "words", "state", "saturated"),
    [
        (1, "readings are skipped: raise sinc", "ok", 0),
        (2, "out of range", "ok", 0x3F),
        (4, "readings are invalid", "fault", 0),
        (8, "its calibration is switched off", "fault", 0),
        (0x0100, "unknown bits 0x0100", "fault", 0),
    ],
)
def test_status_bits_are_told_in_words(bota, bits, words, state, saturated):
    with bota.made() as transducer:
        assert transducer.health().detail == ""
        bota.fault("status", 0.4, bits=bits)
        until(lambda: transducer.read().status == bits)
        sample, health = transducer.read(), transducer.health()
        assert words in " ".join(sample.faults) and words in health.detail
        assert (sample.saturated, health.state) == (saturated, state)
        until(lambda: transducer.health().detail == "")


def test_a_clock_that_stands_still_is_a_fault(bota):
    with bota.made() as transducer:
        bota.fault("clock_stops", 1.0)
        until(lambda: transducer.health().state == "fault")
        assert "its clock stands still" in transducer.health().detail


def test_a_sensor_that_started_anew_has_lost_its_filter(bota):
    time.sleep(1.0)
    with bota.made("?sinc=128") as transducer:
        bota.fault("restart")
        until(lambda: transducer.health().state == "fault", 3.0)
        assert "lost its filter setting: connect again" in transducer.health().detail
        transducer.close()
        transducer.connect()
        time.sleep(0.3)
        first = transducer.read().sequence
        time.sleep(0.5)
        assert transducer.health().ok
        assert transducer.read().sequence - first == pytest.approx(200, abs=20)


@pytest.mark.parametrize("query", ["sinc=64", "sinc=512&chop=0", "sinc=1024"])
def test_the_filter_sets_the_rate(bota, query):
    with bota.made(f"?{query}") as transducer:
        first = transducer.read()
        time.sleep(0.6)
        last = transducer.read()
        sinc = int(transducer.identity["sinc"])
        rate = (last.sequence - first.sequence) / (last.device_time - first.device_time)
        assert rate == pytest.approx(51200 / sinc, rel=0.01)
        assert last.lost == 0


@pytest.mark.parametrize("query", ["sinc=4096", "sinc=3", "chop=2", "sinc=64.5"])
def test_an_impossible_filter_is_refused(query):
    with pytest.raises(ParameterError, match=query.split("=")[0]):
        transducer_at(f"bota:///dev/ttyUSB0?{query}")


def test_lost_frames_are_known_by_the_sensors_clock(bota):
    with bota.made() as transducer:
        bota.fault("flip", 0.5, share=1.0)
        time.sleep(0.7)
        counters = transducer.health().counters
        assert counters["lost"] == pytest.approx(400, abs=30)


def test_an_unplugged_cable_is_named_and_the_port_can_be_opened_again(scene):
    with scene.made() as transducer:
        scene.fault("unplug", 0.6)
        until(lambda: transducer.health().state == "lost", 0.5)
        detail = transducer.health().detail
        assert scene.path in detail and "unplugged" in detail and "plug it in" in detail
        with pytest.raises(LinkError, match="there is no such port: plug the sensor in"):
            scene.made().connect()
        time.sleep(0.7)
        transducer.close()
        transducer.connect()
        assert transducer.health().ok and transducer.read().wrench[2] > 5.0


def test_a_sensor_that_an_earlier_program_left_streaming_is_read(scene):
    first = scene.made()
    first.connect()
    first._ended.set()
    first._thread.join()
    first._port.close()  # as a killed program does: nothing is stopped
    with scene.made() as again:
        assert again.health().ok


def test_two_programs_cannot_have_one_port(scene, transducer):
    with pytest.raises(LinkError, match="another program uses it: end that program"):
        scene.made().connect()


def test_a_mute_sensor_is_said_to_be_silent(scene):
    scene.fault("stall", 5.0)
    with pytest.raises(LinkError, match="check its power") as error:
        scene.made().connect()
    assert scene.path in str(error.value)
    scene.fault("stall", 0.001)
    time.sleep(0.01)


def test_another_device_at_the_port_is_told_from_silence(scene):
    name = scene.emulator.name
    with dummy_port() as (path, _), pytest.raises(LinkError, match="check its power") as error:
        transducer_at(f"{name}://{path}").connect()
    assert path in str(error.value)
    with (
        dummy_port(answer=b"ERROR 17: what is this?\r\n") as (path, _),
        pytest.raises(
            LinkError, match=r"none of this sensor's: .* give the sensor's port"
        ) as error,
    ):
        transducer_at(f"{name}://{path}").connect()
    assert path in str(error.value)


def test_a_device_that_never_stops_talking_is_another_one(scene):
    with (
        dummy_port(always=b"$GPGGA,123519,4807.038,N,01131.000,E*47\r\n") as (path, _),
        pytest.raises(LinkError, match="another device is at this port") as error,
    ):
        transducer_at(f"{scene.emulator.name}://{path}").connect()
    assert path in str(error.value)


def test_a_sensor_at_another_bit_rate_is_not_understood(scene, monkeypatch):
    monkeypatch.setattr(scene.emulator.sensor._line, "_baud", 9600)
    with pytest.raises(LinkError) as error:
        scene.made().connect()
    assert scene.path in str(error.value)
    assert "check its power" in str(error.value) or "another bit rate" in str(error.value)


@pytest.mark.parametrize(
    ("port", "match"),
    [
        ("/dev/no-such-port", "there is no such port: plug the sensor in"),
        ("/dev/null", "is no serial port"),
        ("/tmp", "is a folder"),
    ],
)
@pytest.mark.parametrize("name", NAMES)
def test_a_port_that_cannot_be_opened(name, port, match):
    with pytest.raises(LinkError, match=match) as error:
        transducer_at(f"{name}://{port}").connect()
    assert port in str(error.value)


def test_elsewhere_than_on_linux_it_is_refused_by_name(monkeypatch):
    monkeypatch.setattr("sys.platform", "darwin")
    with pytest.raises(DriverError, match="Linux only"):
        SerialPort("/dev/ttyUSB0", 19200)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "rest", ["", "dev/ttyUSB0", "/dev/ttyUSB0?speed=3", "/dev/ttyUSB0?frozen_s=x",
             "/dev/ttyUSB0?frozen_s=-1"],
)  # fmt: skip
def test_a_wrong_address_shows_the_right_form(name, rest):
    with pytest.raises(ParameterError, match=f"give {name}:///dev/ttyUSB0"):
        transducer_at(f"{name}://{rest}")


def test_an_unknown_kind_lists_the_forms():
    with pytest.raises(ParameterError, match=r"netft://HOST.*robotiq-ft300:///dev/ttyUSB0"):
        transducer_at("serial:///dev/ttyUSB0")


def test_an_emulated_line_is_its_users_alone(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    folder = line._folder()
    assert folder.stat().st_mode & 0o777 == 0o700
    folder.chmod(0o777)
    with pytest.raises(DriverError, match="not this user's alone"):
        line._folder()
